#include "app/rules_json.hpp"

#include <fmt/core.h>

#include <cmath>

#include "app/result_json.hpp"

namespace brdfgate {
namespace {

using nlohmann::json;

json finite(double v) {
  return std::isfinite(v) ? json(v) : json(nullptr);
}

json text_or_null(const std::string& text) {
  return text.empty() ? json(nullptr) : json(text);
}

}  // namespace

json rule_outcomes_to_json(const std::vector<RuleOutcome>& outcomes) {
  json out = json::array();
  for (const RuleOutcome& o : outcomes) {
    const RuleReadingInfo& info = rule_reading_info(o.rule.reading);
    out.push_back({{"reading", info.name},
                   {"unit", info.unit},
                   {"cluster", text_or_null(o.cluster_name)},
                   {"kind", text_or_null(o.rule.kind)},
                   {"value", finite(o.value)},
                   {"sigma", finite(o.sigma)},
                   {"taught", finite(o.taught)},
                   {"low", finite(o.low)},
                   {"high", finite(o.high)},
                   {"guard", o.guard},
                   {"measured", o.measured},
                   {"outcome", to_text(o.verdict)},
                   {"reason", text_or_null(o.text)}});
  }
  return out;
}

std::string rule_text(const Rule& rule, const Recipe& recipe) {
  const RuleReadingInfo& info = rule_reading_info(rule.reading);
  std::string text = info.name;
  if (!rule.kind.empty()) text += " (" + rule.kind + ")";
  if (!info.of_part) {
    text += rule.cluster == kEveryCluster
                ? " of every cluster"
                : " of cluster '" + recipe.clusters.at(std::size_t(rule.cluster)).name + "'";
  }
  const std::string unit = info.unit == "1" ? "" : " " + info.unit;
  if (rule.tolerance) text += fmt::format(": taught +- {}{}", *rule.tolerance, unit);
  if (std::isfinite(rule.low)) text += fmt::format(": at least {}{}", rule.low, unit);
  if (std::isfinite(rule.high)) text += fmt::format(": at most {}{}", rule.high, unit);
  text += fmt::format(", guard {} sigmas", rule.guard.value_or(recipe.rules.guard));
  return rule.measured ? text + ", measured" : text;
}

json rules_to_json(const Recipe& recipe) {
  json out = json::array();
  for (const Rule& rule : recipe.rules.rules) {
    const RuleReadingInfo& info = rule_reading_info(rule.reading);
    json cluster = nullptr;
    if (!info.of_part) {
      cluster = rule.cluster == kEveryCluster ? std::string("all")
                                              : recipe.clusters.at(std::size_t(rule.cluster)).name;
    }
    out.push_back({{"reading", info.name},
                   {"unit", info.unit},
                   {"cluster", std::move(cluster)},
                   {"kind", text_or_null(rule.kind)},
                   {"tolerance", rule.tolerance ? json(*rule.tolerance) : json(nullptr)},
                   {"low", finite(rule.low)},
                   {"high", finite(rule.high)},
                   {"guard", rule.guard.value_or(recipe.rules.guard)},
                   {"measured", rule.measured}});
  }
  return out;
}

}  // namespace brdfgate
