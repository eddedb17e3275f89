// Rules and their outcomes as JSON and text.
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "model/recipe.hpp"

namespace brdfgate {

/// parts[].rules of brdfgate.result/1: [{reading, unit, cluster (name; null: the part), kind,
/// value, sigma, taught, low, high, guard, measured, outcome, reason}, ...]; null: none, or not
/// known. low and high are of the value, a tolerance's resolved; reason: null where it passes.
nlohmann::json rule_outcomes_to_json(const std::vector<RuleOutcome>& outcomes);

/// The recipe's rules, for `brdfgate teach --json`.
nlohmann::json rules_to_json(const Recipe& recipe);

/// "gloss_60_gu of cluster 'body': taught 9.2 +- 5 GU"; as `brdfgate teach` prints it.
std::string rule_text(const Rule& rule, const Recipe& recipe);

}  // namespace brdfgate
