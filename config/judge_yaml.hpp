// The judge's settings in YAML: one table of keys and ranges for the station file and for recipes.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "config/yaml_reader.hpp"
#include "model/recipe.hpp"

namespace brdfgate {

/// Reads every setting; all are required. Throws InputError for a missing, unknown or out-of-range
/// one.
JudgeSettings read_judge_settings(const YamlNode& node);

/// Key and value of every setting, in the table's order, as text that reads back exactly.
std::vector<std::pair<std::string, std::string>> judge_settings_text(const JudgeSettings& settings);

}  // namespace brdfgate
