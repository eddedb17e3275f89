// The station file's sections lights, trigger and outputs: what hangs on GPIO lines.
#pragma once

#include <optional>

#include "config/station_config.hpp"
#include "config/yaml_reader.hpp"

namespace brdfgate {

/// The section is optional with a simulated camera, whose lights are simulated too and have no
/// chip and lines. The limit on burning time must leave room for the bracket.
LightsConfig read_lights(const YamlNode& root, const CameraConfig& camera);
std::optional<TriggerConfig> read_trigger(const YamlNode& root);
std::optional<GpioOutputsSettings> read_outputs(const YamlNode& root);

/// The way back, as far as the sections are there.
void put_lines(YAML::Emitter& out, const StationConfig& config);

}  // namespace brdfgate
