#include "config/lines_yaml.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <span>

namespace brdfgate {
namespace {

using std::chrono::duration;

constexpr std::size_t kMaxRing = 16;

const std::vector<std::string> kModes{"steady", "pulsed"};
const std::vector<std::string> kEdges{"rising", "falling"};
const std::vector<std::string> kBiases{"as_is", "none", "pull_up", "pull_down"};

template <typename Duration>
Duration from_ms(double ms) {
  return std::chrono::round<Duration>(duration<double, std::milli>(ms));
}

std::string ms_text(duration<double, std::milli> time) {
  return number_text(time.count());
}

std::string read_chip(const YamlNode& node) {
  std::string chip = node.text("chip");
  if (chip.empty()) node.fail_at("chip", "empty", "a path, name or label: see gpiodetect");
  return chip;
}

std::string read_line(const YamlNode& node) {
  std::string line = node.as_text();
  if (line.empty()) node.fail("empty", "a line's name, or its number on the chip: see gpioinfo");
  return line;
}

void read_light_lines(const YamlNode& list, std::vector<std::string>& into) {
  for (const YamlNode& node : list.items()) {
    const std::string line = read_line(node);
    if (std::count(into.begin(), into.end(), line) != 0) {
      node.fail(shown(line) + " a second time", "a line of its own for each light");
    }
    into.push_back(line);
  }
}

void read_gpio(const YamlNode& node, GpioLightsSettings& gpio) {
  gpio.chip = read_chip(node);
  const YamlNode lines = node.at("lines");
  read_light_lines(lines, gpio.lines);
  if (gpio.lines.size() != 2) {
    lines.fail(std::to_string(gpio.lines.size()) + " lines", "2: light 1, then light 2");
  }
  if (node.has("ring")) {
    const YamlNode ring = node.at("ring");
    if (ring.size() > kMaxRing) {
      ring.fail(std::to_string(ring.size()) + " lines", "at most " + std::to_string(kMaxRing));
    }
    read_light_lines(ring, gpio.lines);
  }
  gpio.active_low = node.boolean_or("active_low", false);
}

/// What the lights burn at least in one go: settling and every exposure of the bracket.
double least_burning_ms(const LightsConfig& lights, const CameraConfig& camera) {
  const double settle = duration<double, std::milli>(lights.gpio.settle).count();
  const auto& bracket = camera.bracket_ms;
  if (lights.mode == LightsMode::pulsed) return settle + bracket.back();
  return std::accumulate(bracket.begin(), bracket.end(), settle);
}

GpioOutputLine read_output(const YamlNode& node) {
  GpioOutputLine output;
  output.line = read_line(node.at("line"));
  output.active_low = node.boolean_or("active_low", false);
  node.finish();
  return output;
}

void put(YAML::Emitter& out, const char* key, const std::string& value) {
  out << YAML::Key << key << YAML::Value << value;
}

void put_flag(YAML::Emitter& out, const char* key, bool value) {
  put(out, key, value ? "true" : "false");
}

void put_light_lines(YAML::Emitter& out, const char* key, std::span<const std::string> lines) {
  out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginSeq;
  for (const std::string& line : lines)
    out << line;
  out << YAML::EndSeq;
}

void put_lights(YAML::Emitter& out, const LightsConfig& lights) {
  const GpioLightsSettings& gpio = lights.gpio;
  out << YAML::Key << "lights" << YAML::Value << YAML::BeginMap;
  if (!gpio.chip.empty()) {
    put(out, "chip", gpio.chip);
    put_light_lines(out, "lines", std::span(gpio.lines).first(2));
    put_light_lines(out, "ring", std::span(gpio.lines).subspan(2));
    put_flag(out, "active_low", gpio.active_low);
  }
  put(out, "settle_ms", ms_text(gpio.settle));
  put(out, "max_on_ms", ms_text(gpio.max_on));
  put(out, "mode", kModes.at(static_cast<std::size_t>(lights.mode)));
  out << YAML::EndMap;
}

void put_trigger(YAML::Emitter& out, const TriggerConfig& trigger) {
  out << YAML::Key << "trigger" << YAML::Value << YAML::BeginMap;
  put(out, "chip", trigger.gpio.chip);
  put(out, "line", trigger.gpio.line);
  put(out, "edge", kEdges.at(static_cast<std::size_t>(trigger.gpio.edge)));
  put(out, "bias", kBiases.at(static_cast<std::size_t>(trigger.gpio.bias)));
  put(out, "debounce_ms", ms_text(trigger.gpio.debounce));
  put_flag(out, "needs_enable", trigger.needs_enable);
  out << YAML::EndMap;
}

void put_output(YAML::Emitter& out, const char* key, const std::optional<GpioOutputLine>& line) {
  if (!line) return;
  out << YAML::Key << key << YAML::Value << YAML::BeginMap;
  put(out, "line", line->line);
  put_flag(out, "active_low", line->active_low);
  out << YAML::EndMap;
}

}  // namespace

LightsConfig read_lights(const YamlNode& root, const CameraConfig& camera) {
  const bool simulated = camera.backend == CameraBackend::simulated;
  LightsConfig lights;
  if (simulated && !root.has("lights")) return lights;
  const YamlNode node = root.at("lights");
  if (!simulated) read_gpio(node, lights.gpio);
  const double settle_ms = node.number_or("settle_ms", 0, {0, 10000});
  lights.gpio.settle = from_ms<std::chrono::nanoseconds>(settle_ms);
  const double max_on_ms = node.number_or("max_on_ms", 10000, {1, 600000});
  lights.gpio.max_on = from_ms<std::chrono::milliseconds>(max_on_ms);
  if (node.has("mode")) lights.mode = static_cast<LightsMode>(node.choice("mode", kModes));
  const double least_ms = least_burning_ms(lights, camera);
  if (max_on_ms <= least_ms) {
    node.fail_at("max_on_ms", number_text(max_on_ms) + " ends before the bracket",
                 "more than " + number_text(least_ms) + ": settle_ms and the exposures");
  }
  node.finish();
  return lights;
}

std::optional<TriggerConfig> read_trigger(const YamlNode& root) {
  if (!root.has("trigger")) return std::nullopt;
  const YamlNode node = root.at("trigger");
  TriggerConfig trigger;
  trigger.gpio.chip = read_chip(node);
  trigger.gpio.line = read_line(node.at("line"));
  trigger.gpio.edge = static_cast<GpioEdge>(node.choice("edge", kEdges));
  if (node.has("bias")) trigger.gpio.bias = static_cast<GpioBias>(node.choice("bias", kBiases));
  trigger.gpio.debounce =
      from_ms<std::chrono::microseconds>(node.number_or("debounce_ms", 0, {0, 1000}));
  trigger.needs_enable = node.boolean_or("needs_enable", true);
  node.finish();
  return trigger;
}

std::optional<GpioOutputsSettings> read_outputs(const YamlNode& root) {
  if (!root.has("outputs")) return std::nullopt;
  const YamlNode node = root.at("outputs");
  GpioOutputsSettings outputs;
  outputs.chip = read_chip(node);
  std::vector<std::string> seen;
  const auto read = [&](const char* key, std::optional<GpioOutputLine>& into) {
    if (!node.has(key)) return;
    const YamlNode line = node.at(key);
    into = read_output(line);
    if (std::count(seen.begin(), seen.end(), into->line) != 0) {
      line.fail(shown(into->line) + " a second time", "a line of its own");
    }
    seen.push_back(into->line);
  };
  read("pass", outputs.pass);
  read("reject", outputs.reject);
  read("busy", outputs.busy);
  if (seen.empty()) node.fail("no line", "pass, reject or busy");
  node.finish();
  return outputs;
}

void put_lines(YAML::Emitter& out, const StationConfig& config) {
  put_lights(out, config.lights);
  if (config.trigger) put_trigger(out, *config.trigger);
  if (config.outputs) {
    out << YAML::Key << "outputs" << YAML::Value << YAML::BeginMap;
    put(out, "chip", config.outputs->chip);
    put_output(out, "pass", config.outputs->pass);
    put_output(out, "reject", config.outputs->reject);
    put_output(out, "busy", config.outputs->busy);
    out << YAML::EndMap;
  }
}

}  // namespace brdfgate
