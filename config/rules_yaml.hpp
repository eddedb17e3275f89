// Rules in YAML: in a file of their own for `brdfgate teach --rules`, and in a recipe.
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <vector>

#include "config/yaml_reader.hpp"
#include "model/recipe.hpp"

namespace brdfgate {

/// {guard, rules: [{reading, cluster, kind, low, high, tolerance, unit, guard, measured}, ...]}.
/// Throws InputError with file:line:column and path: an unknown reading, cluster, kind or unit;
/// limits that are missing, out of the reading's range or upside down; rules of one reading and
/// cluster that no value meets together; `measured` of what the taught bins never measure.
/// @param clusters  of the recipe; nullptr while they are not known: cluster names, taught values
///                  and what can be measured are then not checked, every cluster is kEveryCluster
RuleSet read_rule_set(const YamlNode& node, const std::vector<TaughtCluster>* clusters);

/// A file of `schema: brdfgate.rules/1` and the keys above.
RuleSet read_rules_file(const std::filesystem::path& file,
                        const std::vector<TaughtCluster>* clusters);

/// The mapping that read_rule_set() reads back exactly.
void write_rule_set(YAML::Emitter& out, const RuleSet& set,
                    const std::vector<TaughtCluster>& clusters);

}  // namespace brdfgate
