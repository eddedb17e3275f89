// The sections lights, trigger and outputs.
#include "catch.hpp"
#include "config/station_config.hpp"
#include "support/input_error.hpp"
#include "support/mutate.hpp"
#include "support/station_text.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using namespace std::chrono_literals;

namespace {

constexpr const char* kLines = R"(
lights: {settle_ms: 2.5, max_on_ms: 500, mode: pulsed}
trigger:
  chip: gpiochip0
  line: 17
  edge: falling
  bias: pull_up
  debounce_ms: 1.5
  needs_enable: false
outputs:
  chip: pinctrl-bcm2711
  pass: {line: GPIO5}
  reject: {line: GPIO6, active_low: true}
)";

/// A station with a real camera, whose lights are real too.
std::string real_station(const std::string& lights) {
  std::string text = kStationText;
  const auto cut = [&text](const std::string& from, const std::string& to) {
    const auto begin = text.find(from);
    text.erase(begin, text.find(to, begin) - begin);
  };
  cut("simulator:\n", "inspection:\n");
  cut("  scenes:", "\nrig:");
  return replaced(
             text, "  backend: simulated\n",
             "  backend: libcamera\n  device: {pixel_format: SRGGB10, line_time_us: 14.81}\n") +
         lights;
}

constexpr const char* kLights = R"(
lights:
  chip: pinctrl-bcm2711
  lines: [GPIO23, 24]
  ring: [GPIO5, GPIO6]
  active_low: true
  settle_ms: 2
  max_on_ms: 3000
)";

StationConfig read_text(const TempDir& dir, const std::string& text) {
  return read_station_config(dir.write("station.yaml", text));
}

}  // namespace

TEST_CASE("Lines of the machine are read, and survive their own print") {
  const TempDir dir;
  const StationConfig config = read_text(dir, std::string(kStationText) + kLines);
  CHECK(config.lights.gpio.settle == 2500us);
  CHECK(config.lights.gpio.max_on == 500ms);
  CHECK(config.lights.mode == LightsMode::pulsed);
  CHECK(config.simulator.light_settle_s == Approx(0.0025));
  REQUIRE(config.trigger);
  CHECK(config.trigger->gpio.chip == "gpiochip0");
  CHECK(config.trigger->gpio.line == "17");
  CHECK(config.trigger->gpio.edge == GpioEdge::falling);
  CHECK(config.trigger->gpio.bias == GpioBias::pull_up);
  CHECK(config.trigger->gpio.debounce == 1500us);
  CHECK_FALSE(config.trigger->needs_enable);
  REQUIRE(config.outputs);
  CHECK(config.outputs->pass->line == "GPIO5");
  CHECK_FALSE(config.outputs->pass->active_low);
  CHECK(config.outputs->reject->active_low);
  CHECK_FALSE(config.outputs->busy);
  CHECK(to_yaml(read_text(dir, to_yaml(config))) == to_yaml(config));
}

TEST_CASE("Without the sections there is no line, and the lights settle at once") {
  const TempDir dir;
  const StationConfig config = read_text(dir, kStationText);
  CHECK(config.lights.gpio.chip.empty());
  CHECK(config.lights.gpio.settle == 0ns);
  CHECK(config.lights.mode == LightsMode::steady);
  CHECK_FALSE(config.trigger);
  CHECK_FALSE(config.outputs);
}

TEST_CASE("Lights on GPIO lines are read, and survive their own print") {
  const TempDir dir;
  const StationConfig config = read_text(dir, real_station(kLights));
  CHECK(config.lights.gpio.chip == "pinctrl-bcm2711");
  CHECK(config.lights.gpio.lines == std::vector<std::string>{"GPIO23", "24", "GPIO5", "GPIO6"});
  CHECK(config.lights.gpio.active_low);
  CHECK(config.lights.gpio.settle == 2ms);
  CHECK(config.lights.gpio.max_on == 3000ms);
  CHECK(config.lights.mode == LightsMode::steady);
  CHECK(to_yaml(read_text(dir, to_yaml(config))) == to_yaml(config));
}

TEST_CASE("Every rule of lights on GPIO lines complains at its place with its path") {
  struct Bad {
    std::string from, to, path, what;
  };
  const auto bad = GENERATE(values<Bad>({
      {"  chip: pinctrl-bcm2711\n", "", "lights.chip", "missing"},
      {"chip: pinctrl-bcm2711", "chip: ''", "lights.chip", "a path, name or label"},
      {"[GPIO23, 24]", "[GPIO23]", "lights.lines", "1 lines; expected 2"},
      {"[GPIO23, 24]", "[GPIO23, GPIO23]", "lights.lines[1]", "a second time"},
      {"[GPIO23, 24]", "[GPIO23, '']", "lights.lines[1]", "a line's name"},
      {"[GPIO5, GPIO6]", "[GPIO5, GPIO23]", "lights.ring[1]", "a second time"},
      {"[GPIO5, GPIO6]", "[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17]",
       "lights.ring", "at most 16"},
      {"active_low: true", "active_low: low", "lights.active_low", "true or false"},
  }));
  const TempDir dir;
  const std::string message = input_error(
      [&] { return read_text(dir, real_station(replaced(kLights, bad.from, bad.to))); });
  CAPTURE(bad.to, message);
  CHECK(contains(message, "(" + bad.path + "): "));
  CHECK(contains(message, bad.what));
  CHECK(
      contains(input_error([&] { return read_text(dir, real_station("")); }), "(lights): missing"));
}

TEST_CASE("Every rule of the lines complains at its place with its path") {
  struct Bad {
    std::string from, to, path, what;
  };
  const auto bad = GENERATE(values<Bad>({
      {"settle_ms: 2.5", "settle_ms: -1", "lights.settle_ms", "0..10000"},
      {"max_on_ms: 500", "max_on_ms: 0", "lights.max_on_ms", "out of range"},
      {"max_on_ms: 500", "max_on_ms: 62", "lights.max_on_ms", "more than 62.5"},
      {"mode: pulsed", "mode: strobe", "lights.mode", "one of steady, pulsed"},
      {"lights: {", "lights: {chip: gpiochip0, ", "lights.chip", "unknown key"},
      {"  chip: gpiochip0\n", "", "trigger.chip", "missing"},
      {"chip: gpiochip0", "chip: ''", "trigger.chip", "a path, name or label"},
      {"line: 17", "line: ''", "trigger.line", "a line's name"},
      {"edge: falling", "edge: both", "trigger.edge", "one of rising, falling"},
      {"bias: pull_up", "bias: up", "trigger.bias", "pull_up"},
      {"debounce_ms: 1.5", "debounce_ms: 1001", "trigger.debounce_ms", "0..1000"},
      {"line: GPIO6", "line: GPIO5", "outputs.reject", "a second time"},
      {"  pass: {line: GPIO5}\n  reject: {line: GPIO6, active_low: true}\n", "", "outputs",
       "pass, reject or busy"},
      {"pass: {line: GPIO5}", "passed: {line: GPIO5}", "outputs.passed", "unknown key"},
  }));
  const TempDir dir;
  const std::string message = input_error([&] {
    return read_text(dir, std::string(kStationText) + replaced(kLines, bad.from, bad.to));
  });
  CAPTURE(bad.to, message);
  CHECK(contains(message, "(" + bad.path + "): "));
  CHECK(contains(message, bad.what));
}
