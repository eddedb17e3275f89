// What good parts show of local departures, in a recipe file.
#pragma once

#include <yaml-cpp/yaml.h>

#include "config/yaml_reader.hpp"
#include "model/recipe.hpp"

namespace brdfgate {

/// A mapping: parts, limit, material (base64 of little-endian float64, column by column) and images
/// (base64 of little-endian int16 in steps of 1/8192). Throws InputError for what does not fit.
void write_defect_reference(YAML::Emitter& out, const DefectReference& reference);
/// Throws InputError with file:line:column and field path.
DefectReference read_defect_reference(const YamlNode& node, std::size_t clusters, int components,
                                      int channels);

}  // namespace brdfgate
