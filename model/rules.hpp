// Rules: limits on readings that a quality engineer sets, judged with the readings' uncertainty.
//
// A value is compared as ISO 14253-1 does: with a guard band of k standard deviations inside either
// limit conformity is proven (pass), with one outside of it the opposite is (reject), and between
// them neither (not judged). k = 1.65 is the standard's 95 % for a one-sided limit. A wrong pass
// costs more than a stop.
#pragma once

#include <array>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "model/reason.hpp"

namespace brdfgate {

/// What a rule can bound. The names, units and ranges are rule_reading_info()'s.
enum class RuleReading : int {
  gloss_20_gu = 0,
  gloss_60_gu,
  gloss_85_gu,
  haze_gu,
  l_star,
  a_star,
  b_star,
  delta_e00,
  aspecular_15_l_star,  ///< from here three for each of kAspecularDeg: L*, a*, b*
  aspecular_110_b_star = aspecular_15_l_star + 14,
  flop_index,
  area_share,
  residual_rms,
  unknown_share,  ///< from here of the part
  defects,
  defect_size_mm,
  defect_area_mm2,
  tilt_deg,
};
inline constexpr int kRuleReadings = static_cast<int>(RuleReading::tilt_deg) + 1;

struct RuleReadingInfo {
  std::string name;       ///< in YAML and JSON: the enumerator's
  std::string unit;       ///< as people write it; "1" for shares and counts
  double least, most;     ///< what its limits can be
  bool of_part = false;   ///< not of a cluster
  bool relative = false;  ///< may be bounded by a tolerance around the taught value
  Reason reason;          ///< of a value beyond its limits
  bool is_colour() const { return reason == Reason::colour; }
};
const RuleReadingInfo& rule_reading_info(RuleReading reading);
/// In the order of RuleReading.
const std::vector<std::string>& rule_reading_names();
/// defects, defect_size_mm or defect_area_mm2.
bool is_about_defects(RuleReading reading);

inline constexpr int kEveryCluster = -1;
inline constexpr double kDefaultGuard = 1.65;

/// low <= value <= high, or |value - taught| <= tolerance.
struct Rule {
  RuleReading reading = RuleReading::delta_e00;
  int cluster = kEveryCluster;  ///< index; of a reading of the part: kEveryCluster
  std::string kind;             ///< of defects; empty: any
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  std::optional<double> tolerance;  ///< instead of low and high, >= 0
  std::optional<double> guard;      ///< standard deviations, >= 0; nothing: the set's
  bool measured = false;            ///< an extrapolated value is not judged

  bool is_about(RuleReading r, int c) const {
    return reading == r && (cluster == kEveryCluster || cluster == c);
  }
};

/// Every rule counts; two of one reading and cluster both do.
struct RuleSet {
  double guard = kDefaultGuard;
  std::vector<Rule> rules;

  bool has(RuleReading reading, int cluster) const;
  bool has_defects_of(const std::string& kind) const;
};

/// A reading as rules see it. `value` NaN: it could not be had.
struct RuleValue {
  double value = std::numeric_limits<double>::quiet_NaN();
  /// Standard deviation of `value`; nothing: none is known of this reading, and it is compared as
  /// it is.
  std::optional<double> sigma;
  double taught = std::numeric_limits<double>::quiet_NaN();
  /// Value less taught, which may be known better than either, and its deviation from noise alone:
  /// what model and material have in common cancels. Nothing: value - taught, and `sigma`.
  std::optional<double> change;
  std::optional<double> change_sigma;
  bool measured = true;  ///< by the rig's geometry, not extrapolated by the basis
  std::string missing;   ///< why there is no value, if it is known
  Reason missing_reason = Reason::outside_basis;
};

/// A rule applied to one cluster or to the part.
struct RuleOutcome {
  Rule rule;
  int cluster = kEveryCluster;
  std::string cluster_name;  ///< empty: of the part
  double value = std::numeric_limits<double>::quiet_NaN();
  double sigma = std::numeric_limits<double>::quiet_NaN();  ///< what was counted; NaN: unknown
  double taught = std::numeric_limits<double>::quiet_NaN();
  double low = -std::numeric_limits<double>::infinity();  ///< of `value`
  double high = std::numeric_limits<double>::infinity();
  double guard = 0;  ///< standard deviations
  bool measured = true;
  Verdict verdict = Verdict::not_judged;
  Reason reason = Reason::outside_basis;  ///< unless it passes
  std::string text;  ///< unless it passes: what, where, value, limit, by how much
};

/// @param place  what the text begins with: "cluster 'body': " or "the part: "
RuleOutcome judge_rule(const Rule& rule, double set_guard, const RuleValue& seen,
                       const std::string& place);

}  // namespace brdfgate
