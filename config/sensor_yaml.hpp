// The sensor's raw format in YAML: station files and recordings share it.
#pragma once

#include <string>
#include <string_view>

#include "config/yaml_reader.hpp"
#include "model/frame.hpp"

namespace brdfgate {

/// Reads width, height (2..16384 pixels, even with a mosaic), bits (8..16), mosaic, the black level
/// under `black_level_key` (0 or more, below the full well) and full_well_dn (up to 2^bits - 1).
/// Leaves finish() to the caller, whose mapping may hold more.
SensorFormat read_sensor_format(const YamlNode& node, std::string_view black_level_key);

/// mono, rggb, bggr, grbg or gbrg.
const std::string& mosaic_name(Mosaic mosaic);

}  // namespace brdfgate
