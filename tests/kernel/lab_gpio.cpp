// Lights, trigger and outputs on a real kernel's GPIO chips (gpio-sim): the contracts that the
// simulated ones keep, and what wires do. Runs in the kernel lab, as root.
#include <atomic>

#include "app/machine_lines.hpp"
#include "catch.hpp"
#include "gpio_sim.hpp"
#include "hal/gpio/gpio_lights.hpp"
#include "hal/gpio/gpio_outputs.hpp"
#include "hal/gpio/gpio_trigger.hpp"
#include "unit/hal/lights_contract.hpp"
#include "unit/hal/trigger_contract.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using namespace std::chrono_literals;

namespace {

constexpr const char* kLabel = "lab-chip";
constexpr auto kPatient = 30s;

GpioLightsSettings lights_on(const std::string& chip, std::vector<std::string> lines = {"2", "3"}) {
  GpioLightsSettings settings;
  settings.chip = chip;
  settings.lines = std::move(lines);
  settings.settle = 3ms;
  settings.max_on = 60s;
  return settings;
}

GpioTriggerSettings trigger_on(const std::string& chip, const std::string& line = "5") {
  GpioTriggerSettings settings;
  settings.chip = chip;
  settings.line = line;
  return settings;
}

/// Which of these lines is at `active`; throws when several are.
LightIndex burning(const GpioSim& sim, const std::vector<int>& lines, bool active) {
  LightIndex found = kNoLight;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (sim.level(lines[i]) != active) continue;
    if (found != kNoLight) throw std::runtime_error("several lights burn");
    found = static_cast<LightIndex>(i) + 1;
  }
  return found;
}

std::string complaint(const std::function<void()>& what) {
  try {
    what();
  } catch (const DeviceError& error) {
    return error.what();
  }
  return "(no error)";
}

bool says(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

std::size_t open_descriptors() {
  const std::filesystem::directory_iterator fds("/proc/self/fd");
  return static_cast<std::size_t>(std::distance(begin(fds), end(fds)));
}

void press(GpioSim& sim, int line) {
  sim.pull(line, true);
  sim.pull(line, false);
}

/// How often the kernel's thread for the trigger's edges went to sleep, its work done.
long edges_handled() {
  for (const auto& process : std::filesystem::directory_iterator("/proc")) {
    std::string name;
    std::ifstream(process.path() / "comm") >> name;
    if (name.rfind("irq/", 0) != 0 || name.find("-brdf") == std::string::npos) continue;
    std::ifstream status(process.path() / "status");
    const std::string key = "voluntary_ctxt_switches:";
    for (std::string line; std::getline(status, line);)
      if (line.rfind(key, 0) == 0) return std::stol(line.substr(key.size()));
  }
  throw std::runtime_error("nobody waits for edges");
}

/// Two edges within an interrupt's latency are one, on any hardware: not sooner than that.
void press_and_be_heard(GpioSim& sim, int line) {
  const long before = edges_handled();
  sim.pull(line, true);
  if (!GpioSim::await([&] { return edges_handled() > before; })) {
    throw std::runtime_error("an edge raised no interrupt");
  }
  sim.pull(line, false);
}

}  // namespace

TEST_CASE("GPIO lights keep the lights' contract, lines by number") {
  check_lights_contract([] {
    const auto sim = std::make_shared<GpioSim>(kLabel);
    const auto lights = std::make_shared<GpioLights>(lights_on(sim->path()));
    return LightsUnderTest{
        std::make_shared<std::pair<decltype(sim), decltype(lights)>>(sim, lights), lights.get(),
        [=] { return burning(*sim, {2, 3}, true); }};
  });
}

TEST_CASE("GPIO lights keep the lights' contract, a ring of named lines that are active low") {
  check_lights_contract([] {
    const auto sim = std::make_shared<GpioSim>(
        kLabel, std::map<int, std::string>{{0, "LED1"}, {1, "LED2"}, {6, "RING1"}, {7, "RING2"}});
    GpioLightsSettings settings = lights_on(kLabel, {"LED1", "LED2", "RING1", "RING2"});
    settings.active_low = true;
    const auto lights = std::make_shared<GpioLights>(settings);
    return LightsUnderTest{
        std::make_shared<std::pair<decltype(sim), decltype(lights)>>(sim, lights), lights.get(),
        [=] { return burning(*sim, {0, 1, 6, 7}, false); }};
  });
}

TEST_CASE("A chip is found by path, name and label") {
  const GpioSim sim(kLabel);
  for (const std::string& chip : {sim.path(), sim.name(), std::string(kLabel)}) {
    CAPTURE(chip);
    GpioLights lights(lights_on(chip));
    lights.on(2);
    CHECK(burning(sim, {2, 3}, true) == 2);
  }
}

TEST_CASE("Lights are dark when they are gone, whatever burned") {
  const GpioSim sim(kLabel);
  {
    GpioLights lights(lights_on(kLabel));
    lights.on(1);
    CHECK(sim.level(2));
  }
  CHECK(burning(sim, {2, 3}, true) == kNoLight);
}

TEST_CASE("No light burns longer than its limit, and the limit is told") {
  const GpioSim sim(kLabel);
  GpioLightsSettings settings = lights_on(kLabel);
  settings.max_on = 1500ms;
  GpioLights lights(settings);
  lights.on(1);
  const std::int64_t on_ns = lights.switched_at_ns();
  // The line falls a moment before that is noted.
  REQUIRE(GpioSim::await([&] { return !sim.level(2) && lights.switched_at_ns() != on_ns; }));
  CHECK(lights.switched_at_ns() - on_ns >= 1'500'000'000);
  CHECK_THROWS_AS(lights.verify(), LightsError);
  CHECK(says(complaint([&] { lights.verify(); }), "light 1 was switched off after 1500 ms"));

  SECTION("it burns again when it is switched again") {
    lights.all_off();
    CHECK_NOTHROW(lights.verify());
    lights.on(1);
    CHECK(sim.level(2));
  }
  SECTION("switching on what burns does not give it more time") {
    lights.on(1);
    const std::int64_t first = lights.switched_at_ns();
    CHECK(GpioSim::await([&] {
      lights.on(1);
      return lights.switched_at_ns() != first;
    }));
  }
  SECTION("another light has its own time") {
    lights.on(2);
    CHECK(sim.level(3));
    CHECK_NOTHROW(lights.verify());
  }
}

TEST_CASE("A line that another program holds is an error until it is let go") {
  const GpioSim sim(kLabel);
  auto other = std::make_unique<GpioLights>(lights_on(kLabel, {"3", "4"}));
  GpioLights lights(lights_on(kLabel));
  CHECK(says(complaint([&] { lights.verify(); }), "another program"));
  CHECK(says(complaint([&] { lights.on(1); }), "another program"));
  CHECK(burning(sim, {2, 3}, true) == kNoLight);
  other.reset();
  lights.on(1);
  CHECK(burning(sim, {2, 3}, true) == 1);
}

TEST_CASE("A missing chip or line is told by its name") {
  GpioLights nowhere(lights_on(kLabel));
  CHECK(says(complaint([&] { nowhere.on(1); }), "lab-chip: open: no such GPIO chip"));
  const GpioSim sim(kLabel, {{2, "LED1"}});
  CHECK_NOTHROW(nowhere.on(1));
  nowhere.all_off();
  GpioLights number(lights_on(kLabel, {"4", "8"}));
  CHECK(says(complaint([&] { number.on(1); }), "line 8"));
  GpioLights name(lights_on(kLabel, {"LED1", "LED2"}));
  CHECK(says(complaint([&] { name.on(1); }), "LED2"));
}

TEST_CASE("A chip that disappears is an error, and lights work when it is back") {
  GpioSim sim(kLabel);
  GpioLights lights(lights_on(kLabel));
  lights.on(1);
  sim.unplug();
  CHECK_THROWS_AS(lights.verify(), LightsError);
  CHECK_THROWS_AS(lights.on(2), LightsError);
  lights.all_off();
  sim.plug();
  CHECK(burning(sim, {2, 3}, true) == kNoLight);
  CHECK_NOTHROW(lights.verify());
  lights.on(2);
  CHECK(burning(sim, {2, 3}, true) == 2);
}

TEST_CASE("Lights leak no descriptor in ten thousand switchings and a hundred lives") {
  const GpioSim sim(kLabel);
  const std::size_t before = open_descriptors();
  for (int life = 0; life < 100; ++life) {
    GpioLights lights(lights_on(kLabel));
    for (int i = 0; i < 50; ++i) {
      lights.on(1 + i % 2);
      lights.all_off();
    }
  }
  CHECK(open_descriptors() == before);
}

TEST_CASE("The GPIO trigger keeps the trigger's contract") {
  check_trigger_contract([] {
    const auto sim = std::make_shared<GpioSim>(kLabel);
    const auto trigger = std::make_shared<GpioTrigger>(trigger_on(kLabel));
    return TriggerUnderTest{
        std::make_shared<std::pair<decltype(sim), decltype(trigger)>>(sim, trigger), trigger.get(),
        [=] { press_and_be_heard(*sim, 5); }};
  });
}

TEST_CASE("Only the configured edge fires") {
  GpioSim sim(kLabel, {{5, "START"}});
  sim.pull(5, true);
  GpioTriggerSettings settings = trigger_on(kLabel, "START");
  settings.edge = GpioEdge::falling;
  GpioTrigger trigger(settings);
  CHECK_FALSE(trigger.wait(0ms));
  sim.pull(5, false);
  CHECK(trigger.wait(kPatient));
  sim.pull(5, true);
  CHECK_FALSE(trigger.wait(50ms));
}

TEST_CASE("A bouncing contact fires once, a spike not at all") {
  GpioSim sim(kLabel);
  GpioTriggerSettings settings = trigger_on(kLabel);
  settings.debounce = 1000ms;
  GpioTrigger trigger(settings);
  for (int i = 0; i < 3; ++i)
    press(sim, 5);
  sim.pull(5, true);
  CHECK(trigger.wait(kPatient));
  CHECK_FALSE(trigger.wait(1300ms));
  sim.pull(5, false);
  CHECK_FALSE(trigger.wait(1300ms));
  press(sim, 5);
  CHECK_FALSE(trigger.wait(1300ms));
}

TEST_CASE("A trigger whose chip disappears is an error") {
  GpioSim sim(kLabel);
  GpioTrigger trigger(trigger_on(kLabel));
  sim.unplug();
  CHECK_THROWS_AS(trigger.wait(100ms), DeviceError);
}

TEST_CASE("The trigger's watch tells of a lost line once, and fires again when it is back") {
  GpioSim sim(kLabel);
  std::atomic<int> fired{0};
  std::atomic<int> losses{0};
  std::atomic<int> returns{0};
  const TriggerWatch watch([] { return std::make_unique<GpioTrigger>(trigger_on(kLabel)); },
                           {[&] { ++fired; }, [&](bool lost) { ++(lost ? losses : returns); }});
  // The watch takes the line when its thread runs: press until it does.
  REQUIRE(GpioSim::await([&] {
    press(sim, 5);
    return fired > 0;
  }));
  sim.unplug();
  REQUIRE(GpioSim::await([&] { return losses == 1; }));
  sim.plug();
  REQUIRE(GpioSim::await([&] { return returns == 1; }));
  const int before = fired;
  press(sim, 5);
  CHECK(GpioSim::await([&] { return fired > before; }));
  CHECK(losses == 1);
}

TEST_CASE("Output lines are fail-safe from the start to the end, and say what they are told") {
  GpioSim sim(kLabel);
  GpioOutputsSettings settings;
  settings.chip = kLabel;
  settings.pass = GpioOutputLine{"0"};
  settings.reject = GpioOutputLine{"1", true};  // an unpowered board rejects
  settings.busy = GpioOutputLine{"2", true};
  const auto levels = [&] { return std::array{sim.level(0), !sim.level(1), !sim.level(2)}; };
  const std::array safe{false, true, true};
  {
    GpioOutputs outputs(settings);
    CHECK(levels() == safe);
    outputs.set({.pass = true, .reject = false, .busy = false});
    CHECK(levels() == std::array{true, false, false});
    outputs.set({.pass = false, .reject = true, .busy = false});
    CHECK(levels() == std::array{false, true, false});
    outputs.set({.pass = true, .reject = false, .busy = false});
  }
  CHECK(levels() == safe);
}

TEST_CASE("Verdict lines survive a chip that goes and comes back") {
  GpioSim sim(kLabel);
  GpioOutputsSettings settings;
  settings.chip = kLabel;
  settings.pass = GpioOutputLine{"0"};
  VerdictLines lines(settings);
  const GpioOutputState passed{.pass = true, .reject = false, .busy = false};
  lines.show(passed);
  CHECK(sim.level(0));
  sim.unplug();
  lines.show(kFailSafeOutputs);
  sim.plug();
  CHECK_FALSE(sim.level(0));
  CHECK(GpioSim::await([&] {
    lines.show(passed);
    return sim.level(0);
  }));
}
