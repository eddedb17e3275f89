// The recipe applied to one measured part: limits, findings in words, verdict (method.md section
// 8).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "model/observation.hpp"
#include "model/recipe.hpp"
#include "model/verdict.hpp"

namespace brdfgate {

/// How long the calibration still holds, on the day of the part.
struct CalibrationAge {
  std::optional<int> days_until_due;  ///< negative: overdue; nothing: no due date, or no clock
  int grace_days = 0;                 ///< overdue by more: not judged

  bool due() const { return days_until_due && *days_until_due < 0; }
  bool expired() const { return due() && -*days_until_due > grace_days; }
};

/// What is known of the part as a whole. A value that could not be had is NaN: "not judged" then.
struct PartFacts {
  double coverage = 0;       ///< part cells over inspected cells; below min_coverage it is absent
  double ambient = 0;        ///< share of white
  double clipped = 0;        ///< share of the part's cells
  double unknown_share = 0;  ///< share of the part's cells that no taught cluster explains
  std::vector<Defect> defects;
  std::vector<double> lamp_drift;    ///< per light, relative; empty: not watched
  double max_lamp_drift = 0;         ///< beyond it, either way, nothing is judged
  std::array<double, 2> tilt_deg{};  ///< about x and y
  std::array<double, 2> tilt_sigma_deg{};
  std::array<double, 2> shift_mm{};  ///< from the taught place
  double rotation_deg = 0;           ///< from the taught pose, in the plane
  /// Per cluster: share of its taught place, as far as seen, that shows it; empty: not known.
  std::vector<double> in_place = {};
  std::string pose_problem = {};  ///< why the taught pose could not be found; empty: it was
  CalibrationAge calibration = {};
};

/// In words, per lamp that drifted beyond the limit or of which nothing is known.
std::vector<std::string> drifted_lamps(const PartFacts& facts);

struct Judgement {
  Verdict verdict = Verdict::not_judged;
  ReasonBits reason_bits = 0;
  std::vector<Finding> findings;  ///< one or more per set bit
  double t2_ratio = 0;            ///< largest T^2 over its limit; only finite ones count
  double spe_ratio = 0;
  int worst_cluster = 0;  ///< the one with the largest of both ratios
  std::vector<RuleOutcome> rules;
};

/// A cluster that shows in less of its taught place is missing there.
inline constexpr double kLeastInPlace = 0.5;

/// Beyond this share of unknown cells it is not a bad part but another one (or its back).
inline constexpr double kForeignPartShare = 0.9;

/// Fills deviation and delta_e00 of the measured clusters (and their taught names) and says what
/// was found. Pass only with a recipe, every taught cluster present and its weights valid, and
/// every statistic finite: what is not known to be good is never passed.
/// - An absent part gives part_absent alone; one that is nearly all unknown pose_or_face, without
/// the
///   missing clusters that follow from it.
/// - Without a recipe (nullptr), or with a cluster that has no limits yet (a draft while teaching):
///   calibration_or_recipe; the part-level limits of `settings` still count.
/// - The recipe's rules count beside T^2 and SPE, and instead of the settings' limit on the same
///   reading and cluster: colour, gloss at 60 degrees, area share, unknown share, tilt, and local
///   defects of the kinds that a rule is about (of no kind: of all).
/// @param settings  used without a recipe; with one, its own settings are
/// @param clusters  by index as in the recipe; missing ones may be left out at the end
/// @param observed  same indices; empty where the weights are not valid
Judgement judge(const Recipe* recipe, const JudgeSettings& settings,
                std::vector<ClusterResult>& clusters,
                const std::vector<std::optional<ClusterObservation>>& observed,
                const PartFacts& facts);

}  // namespace brdfgate
