#include "config/rules_yaml.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string>

#include "model/rule_values.hpp"

namespace brdfgate {
namespace {

constexpr const char* kSchema = "brdfgate.rules/1";
constexpr double kMostGuard = 10;
const std::vector<std::string> kDefectKinds{"darker", "lighter", "duller", "glossier", "colour"};
/// `cluster: all`, which is also what a rule without the key is about.
constexpr const char* kAll = "all";

using Clusters = std::vector<TaughtCluster>;

std::string names_of(const Clusters& clusters) {
  std::string names = kAll;
  for (std::size_t i = 0; i < clusters.size(); ++i)
    names += ", '" + clusters[i].name + "' (" + std::to_string(i) + ")";
  return names;
}

int read_cluster(const YamlNode& node, const Clusters* clusters) {
  if (!node.has("cluster")) return kEveryCluster;
  const std::string text = node.text("cluster");
  if (text == kAll || clusters == nullptr) return kEveryCluster;
  const auto named = std::find_if(clusters->begin(), clusters->end(),
                                  [&](const TaughtCluster& c) { return c.name == text; });
  if (named != clusters->end()) return static_cast<int>(named - clusters->begin());
  std::size_t index = 0;
  const char* end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, index);
  if (parsed.ec != std::errc() || parsed.ptr != end || index >= clusters->size())
    node.fail_at("cluster", "no cluster " + shown(text), "one of " + names_of(*clusters));
  return static_cast<int>(index);
}

/// A share over 1 is rather a percentage.
double read_limit(const YamlNode& node, const char* key, const RuleReadingInfo& info) {
  const double value = node.number(key);
  if (value >= info.least && value <= info.most) return value;
  std::string expected = number_text(info.least) + ".." + number_text(info.most);
  if (info.unit != "1") expected += " " + info.unit;
  if (info.most == 1) expected += ", a share: 20 % is 0.2";
  node.fail_at(key, shown(node.text(key)), expected);
}

void read_limits(const YamlNode& node, const RuleReadingInfo& info, Rule& rule) {
  const bool bounded = node.has("low") || node.has("high");
  if (node.has("tolerance")) {
    if (!info.relative) {
      node.fail_at("tolerance", info.name + " has no taught value", "high (or low)");
    }
    if (bounded) node.fail_at("tolerance", "beside low or high", "one or the other");
    rule.tolerance = node.number("tolerance", {0, info.most - info.least});
    return;
  }
  if (!bounded) {
    node.fail("no limit", info.relative ? "low, high or both, or tolerance" : "low, high or both");
  }
  if (node.has("low")) rule.low = read_limit(node, "low", info);
  if (node.has("high")) rule.high = read_limit(node, "high", info);
  if (rule.low > rule.high) {
    node.fail_at("low", number_text(rule.low) + " is over high: " + number_text(rule.high),
                 "low <= high");
  }
}

void read_scope(const YamlNode& node, const RuleReadingInfo& info, const Clusters* clusters,
                Rule& rule) {
  if (info.of_part && node.has("cluster")) {
    node.fail_at("cluster", info.name + " is of the part, not of a cluster", "no such key here");
  }
  rule.cluster = read_cluster(node, clusters);
  if (!node.has("kind")) return;
  if (!is_about_defects(rule.reading))
    node.fail_at("kind", info.name + " has no kinds", "no such key here");
  rule.kind = kDefectKinds[node.choice("kind", kDefectKinds)];
}

/// Calls visit(index, cluster) for every cluster that the rule is about.
template <typename Visit>
void for_each_cluster(const Rule& rule, const Clusters& clusters, Visit&& visit) {
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    if (rule.is_about(rule.reading, static_cast<int>(i))) visit(i, clusters[i]);
  }
}

void check_possible(const YamlNode& node, const Rule& rule, const Clusters& clusters) {
  const RuleReadingInfo& info = rule_reading_info(rule.reading);
  if (info.of_part) return;
  for_each_cluster(rule, clusters, [&](std::size_t, const TaughtCluster& taught) {
    const std::string never = never_defined(rule.reading, taught);
    if (!never.empty()) node.fail_at("reading", "cluster '" + taught.name + "': " + never);
    if (rule.measured && !can_be_measured(rule.reading, taught)) {
      node.fail_at("measured",
                   "this rig does not look where " + info.name + " of cluster '" + taught.name +
                       "' is told from: no part would ever be judged",
                   "measured: false (the extrapolated value, with its uncertainty), or another "
                   "reading");
    }
  });
}

Rule read_rule(const YamlNode& node, const Clusters* clusters) {
  Rule rule;
  rule.reading = static_cast<RuleReading>(node.choice("reading", rule_reading_names()));
  const RuleReadingInfo& info = rule_reading_info(rule.reading);
  read_scope(node, info, clusters, rule);
  read_limits(node, info, rule);
  if (node.has("unit")) node.choice("unit", {info.unit});
  if (node.has("guard")) rule.guard = node.number("guard", {0, kMostGuard});
  rule.measured = node.boolean_or("measured", false);
  node.finish();
  if (clusters != nullptr) check_possible(node, rule, *clusters);
  return rule;
}

struct Range {
  double low, high;
};

/// Of the reading's value; the whole line where the taught value is not in the recipe.
Range range_of(const Rule& rule, const TaughtCluster* taught) {
  if (!rule.tolerance) return {rule.low, rule.high};
  const double middle = taught != nullptr ? taught_value(rule.reading, *taught) : std::nan("");
  if (!std::isfinite(middle)) return {Rule().low, Rule().high};
  return {middle - *rule.tolerance, middle + *rule.tolerance};
}

bool disjoint(const Range& a, const Range& b) {
  return a.high < b.low || b.high < a.low;
}

std::string range_text(const Range& range) {
  if (std::isinf(range.low)) return "at most " + number_text(range.high);
  if (std::isinf(range.high)) return "at least " + number_text(range.low);
  return number_text(range.low) + ".." + number_text(range.high);
}

/// Refuses the rule at `node` where an earlier one leaves no value for it.
void check_together(const YamlNode& node, const Rule& rule, const YamlNode& other_node,
                    const Rule& other, const Clusters* clusters) {
  if (rule.reading != other.reading || rule.kind != other.kind) return;
  const auto refuse = [&](const Range& a, const Range& b, const std::string& of) {
    if (!disjoint(a, b)) return;
    node.fail(rule_reading_info(rule.reading).name + of + " " + range_text(a) +
                  " contradicts the rule at " + other_node.where() + ", " + range_text(b),
              "limits that one value can meet");
  };
  if (rule_reading_info(rule.reading).of_part)
    return refuse(range_of(rule, nullptr), range_of(other, nullptr), "");
  if (clusters == nullptr) return;
  for_each_cluster(rule, *clusters, [&](std::size_t i, const TaughtCluster& taught) {
    if (!other.is_about(rule.reading, static_cast<int>(i))) return;
    refuse(range_of(rule, &taught), range_of(other, &taught), " of cluster '" + taught.name + "'");
  });
}

void put(YAML::Emitter& out, const char* key, const std::string& value) {
  out << YAML::Key << key << YAML::Value << value;
}

void write_rule(YAML::Emitter& out, const Rule& rule, const Clusters& clusters) {
  out << YAML::Flow << YAML::BeginMap;
  put(out, "reading", rule_reading_info(rule.reading).name);
  if (rule.cluster != kEveryCluster) {
    const auto index = static_cast<std::size_t>(rule.cluster);
    out << YAML::Key << "cluster" << YAML::Value << YAML::DoubleQuoted << clusters.at(index).name;
  }
  if (!rule.kind.empty()) put(out, "kind", rule.kind);
  if (rule.tolerance) put(out, "tolerance", number_text(*rule.tolerance));
  if (std::isfinite(rule.low)) put(out, "low", number_text(rule.low));
  if (std::isfinite(rule.high)) put(out, "high", number_text(rule.high));
  if (rule.guard) put(out, "guard", number_text(*rule.guard));
  if (rule.measured) put(out, "measured", "true");
  out << YAML::EndMap;
}

}  // namespace

RuleSet read_rule_set(const YamlNode& node, const std::vector<TaughtCluster>* clusters) {
  RuleSet set;
  set.guard = node.number_or("guard", kDefaultGuard, {0, kMostGuard});
  const std::vector<YamlNode> items = node.at("rules").items();
  for (std::size_t i = 0; i < items.size(); ++i) {
    set.rules.push_back(read_rule(items[i], clusters));
    for (std::size_t j = 0; j < i; ++j)
      check_together(items[i], set.rules[i], items[j], set.rules[j], clusters);
  }
  node.finish();
  return set;
}

RuleSet read_rules_file(const std::filesystem::path& file,
                        const std::vector<TaughtCluster>* clusters) {
  const YamlNode root = YamlNode::load_file(file);
  root.choice("schema", {kSchema});
  return read_rule_set(root, clusters);
}

void write_rule_set(YAML::Emitter& out, const RuleSet& set,
                    const std::vector<TaughtCluster>& clusters) {
  out << YAML::BeginMap;
  put(out, "guard", number_text(set.guard));
  out << YAML::Key << "rules" << YAML::Value << YAML::BeginSeq;
  for (const Rule& rule : set.rules)
    write_rule(out, rule, clusters);
  out << YAML::EndSeq << YAML::EndMap;
}

}  // namespace brdfgate
