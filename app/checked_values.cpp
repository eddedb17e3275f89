#include "app/checked_values.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "app/result_json.hpp"

namespace brdfgate {
namespace {

/// One value against a limit that it must not exceed.
struct Bound {
  double value = 0;
  double limit = 0;
};

std::string with_unit(double v, const char* format) {
  if (!std::isfinite(v)) return "not known";
  std::string text = fmt::format(fmt::runtime(format), v);
  // Noise around 0: no "-0.00".
  if (text[0] == '-' && std::stod(text) == 0) text.erase(0, 1);
  return text;
}

class Table {
 public:
  /// @param format  fmt's, of one number; shares come in percent already
  void add(int cluster, std::string name, const Bound& bound, const char* format,
           std::string note = {}) {
    CheckedValue v;
    v.cluster = cluster;
    v.name = std::move(name);
    v.value = with_unit(bound.value, format);
    v.limit = with_unit(bound.limit, format);
    v.note = std::move(note);
    v.ratio = std::max(0.0, bound.value) / bound.limit;
    if (!std::isfinite(bound.value)) v.ratio = bound.value;
    v.state = !std::isfinite(bound.value) ? CheckedValue::State::unknown
              : bound.value > bound.limit ? CheckedValue::State::beyond
                                          : CheckedValue::State::within;
    rows_.push_back(std::move(v));
  }
  void add(CheckedValue value) { rows_.push_back(std::move(value)); }
  void soften_last() {
    if (rows_.back().state == CheckedValue::State::beyond)
      rows_.back().state = CheckedValue::State::within;
  }
  std::vector<CheckedValue> take() { return std::move(rows_); }

 private:
  std::vector<CheckedValue> rows_;
};

double larger(const std::array<double, 2>& xy) {
  return std::max(std::abs(xy[0]), std::abs(xy[1]));
}

void add_defects(Table& table, const Inspection& part, const RecipeInForce& recipe,
                 const Inspector& inspector) {
  const DefectReference& taught = recipe.recipe.defects;
  if (taught.parts == 0 || !(taught.limit > 0) || part.evidence.lights.empty()) return;
  const double peak = defect_peak(part.evidence, inspector.defect_blocks(), taught);
  const std::size_t n = part.result.defects.size();
  const bool small = n == 0 && peak > taught.limit;
  const bool ruled = n > 0 && std::ranges::all_of(part.result.defects, [&](const Defect& d) {
                       return recipe.recipe.rules.has_defects_of(d.kind);
                     });
  table.add(kWholePart, "largest local departure", {peak, taught.limit}, "{:.1f} sigma",
            small
                ? "beyond the limit, but smaller or fainter than the least defect that is reported"
            : ruled ? "beyond the limit, but the recipe's rules say which defects count"
                    : fmt::format("{} defect{} reported", n, n == 1 ? "" : "s"));
  // A recipe says how small a blob may be to count, and its rules which do.
  if (small || ruled) table.soften_last();
}

/// What light and lamps did; known without a part.
void add_light(Table& table, const PartFacts& facts, const JudgeSettings& settings) {
  table.add(kWholePart, "ambient light", {100 * facts.ambient, 100 * settings.max_ambient},
            "{:.2f} % of white");
  for (std::size_t l = 0; l < facts.lamp_drift.size(); ++l)
    table.add(kWholePart, fmt::format("drift of light {}", l + 1),
              {100 * std::abs(facts.lamp_drift[l]), 100 * facts.max_lamp_drift}, "{:.2f} %");
}

void add_part(Table& table, const Inspection& part, const JudgeSettings& settings,
              const RecipeInForce* recipe) {
  const PartFacts& facts = part.facts;
  const PartResult& r = part.result;
  table.add(kWholePart, "clipped cells", {100 * facts.clipped, 100 * settings.max_clipped},
            "{:.2f} %");
  const RuleSet none, &rules = recipe != nullptr ? recipe->recipe.rules : none;
  if (!rules.has(RuleReading::tilt_deg, kEveryCluster))
    table.add(kWholePart, "tilt", {larger(r.tilt_deg), settings.max_tilt_deg}, "{:.2f} deg",
              fmt::format("x {:+.2f}, y {:+.2f}", r.tilt_deg[0], r.tilt_deg[1]));
  if (recipe == nullptr) return;
  if (!recipe->recipe.layout.empty()) {
    table.add(kWholePart, "shift",
              {std::hypot(r.shift_mm[0], r.shift_mm[1]), settings.max_shift_mm}, "{:.2f} mm",
              fmt::format("x {:+.2f}, y {:+.2f}", r.shift_mm[0], r.shift_mm[1]));
    table.add(kWholePart, "rotation", {std::abs(r.rotation_deg), settings.max_rotation_deg},
              "{:.2f} deg");
  }
  if (!rules.has(RuleReading::unknown_share, kEveryCluster))
    table.add(kWholePart, "of no taught material",
              {100 * facts.unknown_share, 100 * settings.unknown_share_limit}, "{:.2f} %",
              "share of the part");
}

void add_statistics(Table& table, const ClusterResult& c) {
  const Deviation& d = c.deviation;
  if (d.t2_limit > 0)
    table.add(c.index, "T2", {d.t2, d.t2_limit}, "{:.2f}", "named changes together");
  if (d.spe_limit > 0)
    table.add(c.index, "SPE", {d.spe, d.spe_limit}, "{:.3f}", "what they do not explain");
}

/// A rule's limits as text, and how near the value is to the nearer one: 1 at it.
CheckedValue rule_row(const RuleOutcome& o) {
  const RuleReadingInfo& info = rule_reading_info(o.rule.reading);
  const std::string unit = info.unit == "1" ? "" : " " + info.unit;
  CheckedValue row;
  row.cluster = o.cluster;
  row.name = "rule: " + info.name + (o.rule.kind.empty() ? "" : " (" + o.rule.kind + ")");
  row.value = with_unit(o.value, "{:.4g}") + (std::isfinite(o.value) ? unit : "");
  const bool low = std::isfinite(o.low), high = std::isfinite(o.high);
  row.limit = (low ? with_unit(o.low, "{:.4g}") + (high ? " to " : " or more") : "") +
              (high ? with_unit(o.high, "{:.4g}") : "") + unit;
  const double middle = low && high ? (o.low + o.high) / 2 : 0;
  row.ratio = high ? std::abs(o.value - middle) / (o.high - middle) : o.low / o.value;
  if (!std::isfinite(row.ratio)) row.ratio = o.verdict == Verdict::pass ? 1 : 2;  // a limit of 0
  if (std::isfinite(o.sigma)) row.note = fmt::format("sigma {:.2g}, guard {}", o.sigma, o.guard);
  if (!o.measured) row.note += std::string(row.note.empty() ? "" : ", ") + "extrapolated";
  row.state = o.verdict == Verdict::pass     ? CheckedValue::State::within
              : o.verdict == Verdict::reject ? CheckedValue::State::beyond
                                             : CheckedValue::State::unknown;
  return row;
}

/// Of a cluster, or of the part (kWholePart, which is kEveryCluster).
void add_rules(Table& table, const PartResult& part, int cluster) {
  for (const RuleOutcome& outcome : part.rules) {
    if (outcome.cluster == cluster) table.add(rule_row(outcome));
  }
}

void add_cluster(Table& table, const ClusterResult& c, const TaughtCluster& taught,
                 const Recipe& recipe) {
  const JudgeSettings& settings = recipe.settings;
  add_statistics(table, c);
  if (c.valid.colour && !recipe.rules.has(RuleReading::delta_e00, c.index))
    table.add(c.index, "colour", {c.delta_e00, settings.colour_limit_de00}, "{:.2f} dE00",
              "to the taught colour");
  if (c.valid.gloss && !recipe.rules.has(RuleReading::gloss_60_gu, c.index))
    table.add(c.index, "change of gloss 60",
              {std::abs(c.gloss_gu[1] - taught.gloss_gu[1]), settings.gloss_limit_gu}, "{:.2f} GU",
              fmt::format("found {:.1f} GU, taught {:.1f}", c.gloss_gu[1], taught.gloss_gu[1]));
  if (recipe.rules.has(RuleReading::area_share, c.index)) return;
  table.add(
      c.index, "loss of area",
      {100 * std::max(0.0, taught.area_share - c.area_share), 100 * settings.area_share_limit},
      "{:.2f} %",
      fmt::format("{:.1f} % of {:.1f} % taught", 100 * c.area_share, 100 * taught.area_share));
}

void add_missing_of(std::vector<std::string>& out, const ClusterResult& c, bool colour_known) {
  const std::string who = c.name + ": ";
  if (!c.present) {
    out.push_back(who + "not found on the part; nothing of it was measured");
    return;
  }
  if (!c.valid.weights) {
    out.push_back(who +
                  fmt::format("seen in {} angular bins only; no weights, no readings", c.bins));
    return;
  }
  if (!c.valid.gloss)
    out.push_back(who + "the mirror direction was not in view, so that gloss is extrapolated");
  else if (!c.valid.highlight)
    out.push_back(who + "no highlight stands out: gloss and roughness are little known");
  if (c.validity.outside_basis())
    out.push_back(who + "the material is unlike those that the basis was made from");
  if (c.channels == 3 && !colour_known)
    out.push_back(who + "the camera's colours were not calibrated: no L*a*b*, no dE00");
}

bool anything_found(const Inspection& part) {
  return std::any_of(part.result.clusters.begin(), part.result.clusters.end(),
                     [](const ClusterResult& c) { return c.present; });
}

}  // namespace

std::vector<CheckedValue> checked_values(const Inspection& part, const RecipeInForce* recipe,
                                         const Inspector& inspector) {
  if (part.reflectance.empty()) return {};
  const JudgeSettings& settings =
      recipe != nullptr ? recipe->recipe.settings : inspector.judge_settings();
  Table table;
  add_light(table, part.facts, settings);
  if (!anything_found(part)) return table.take();
  if (recipe != nullptr) add_defects(table, part, *recipe, inspector);
  add_part(table, part, settings, recipe);
  add_rules(table, part.result, kWholePart);
  for (std::size_t i = 0; i < part.result.clusters.size(); ++i) {
    if (recipe == nullptr || i >= recipe->recipe.clusters.size()) continue;
    add_cluster(table, part.result.clusters[i], recipe->recipe.clusters[i], recipe->recipe);
    add_rules(table, part.result, static_cast<int>(i));
    if (i < part.facts.in_place.size())
      table.add(static_cast<int>(i), "not in its place",
                {100 * (1 - part.facts.in_place[i]), 100 * (1 - kLeastInPlace)}, "{:.1f} %",
                "share of its taught place");
  }
  return table.take();
}

std::vector<std::string> missing_evidence(const Inspection& part, const RecipeInForce* recipe,
                                          const Inspector& inspector) {
  std::vector<std::string> out;
  if (part.reflectance.empty()) {
    return {"nothing was measured: there is no reflectance, no map of regions and no reading"};
  }
  if (recipe == nullptr) {
    out.emplace_back("no recipe is in force: nothing to compare the part with");
  } else if (recipe->recipe.defects.parts == 0) {
    out.emplace_back("the recipe was taught no local defects: wide priors stand in");
  }
  if (!anything_found(part)) {
    out.emplace_back("no region of a material was found: nothing of the part was measured");
    return out;
  }
  for (const ClusterResult& c : part.result.clusters)
    add_missing_of(out, c, inspector.colour_known());
  return out;
}

std::string verdict_words(Verdict verdict) {
  if (verdict == Verdict::none) return "measured";
  std::string words = to_text(verdict);
  std::replace(words.begin(), words.end(), '_', ' ');
  return words;
}

}  // namespace brdfgate
