// From weights to a verdict: the values that the tool prints, the journal keeps and the PLC reads.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "model/geometry.hpp"
#include "model/reading_rows.hpp"
#include "model/readings.hpp"
#include "model/reason.hpp"
#include "model/recipe.hpp"
#include "model/regions.hpp"
#include "model/rules.hpp"
#include "model/validity.hpp"

namespace brdfgate {

/// T^2 and SPE of one cluster (method.md section 8).
struct Deviation {
  double t2 = 0;
  double t2_limit = 0;  ///< 0: none taught
  double spe = 0;
  double spe_limit = 0;
};
/// T^2 = d^T (S_taught (1 + 1/N) + S_measured)^-1 d over the monitored changes' distance d from the
/// taught mean of N parts. S_measured is what pixel noise alone does to this measurement's weights
/// (noise_covariance), not the ridge's posterior: most of that stands for model discrepancy, which
/// is the same in all parts of one material, so that it cancels in d and would only blunt the test.
/// SPE = mean over the taught bins seen, and channels, of (r - r_taught)^2 / (s^2 (1 + 1/N) + v): r
/// the mapped residual, s its part-to-part deviation, v its variance from this measurement's noise.
/// NaN where nothing comparable was seen. All 0 for a draft (no limits taught).
/// Throws InputError when shapes differ.
Deviation deviation(const TaughtCluster& taught, const ClusterObservation& seen);

/// How far one monitored change is off.
struct MonitoredShift {
  std::string name;   ///< of the direction
  double change = 0;  ///< relative, of its factor: 0.05 is 5 % more than taught
  double sigmas = 0;  ///< over its standard deviation under S
  double part = 0;    ///< d_i (S^-1 d)_i: its part of T^2; the parts sum to it, and some may be < 0
};
/// All of them, in the directions' order.
std::vector<MonitoredShift> monitored_shifts(const TaughtCluster& taught,
                                             const ClusterObservation& seen);
/// The one with the largest part.
MonitoredShift largest_shift(const TaughtCluster& taught, const ClusterObservation& seen);

/// The part's colour at 45:0: the taught one with its diffuse level changed as the part's is. A
/// comparison of two parts is far better known this way than from two reconstructions, whose errors
/// at 45:0 (which this rig does not see) do not cancel. Nothing where the levels of three channels
/// are not monitored.
std::optional<Lab> compared_colour(const TaughtCluster& taught, const ClusterObservation& seen);
/// Whether the levels of three channels are monitored, so that it has one.
bool compares_colour(const TaughtCluster& taught);

/// The bin and channel with the largest share of SPE.
struct ResidualShift {
  int channel = 0;    ///< from 0
  HalfDiff angles;    ///< of the bin
  double sigmas = 0;  ///< signed
};
ResidualShift largest_residual(const TaughtCluster& taught, const ClusterObservation& seen);

struct Defect {
  std::string kind;               ///< darker, lighter, duller, glossier or colour
  std::array<double, 2> at_mm{};  ///< centre, world x and y
  double size_mm = 0;             ///< diameter of the disc of equal area
  double score = 0;               ///< largest |z| over its limit, 1 or more (local_defects.hpp)
  double change = 0;              ///< mean ln(f / expected) in the light and channel that shows it
};

/// One cluster of one part, as published.
struct ClusterResult {
  int index = 0;
  std::string name;
  bool present = false;
  int pixels = 0;  ///< cells
  int bins = 0;
  double area_share = 0;  ///< of the part
  double coverage = 0;    ///< bins seen over bins of the station, 0..1
  struct Valid {
    bool weights = false, highlight = false, gloss = false, colour = false, measured = false;
  } valid;
  std::string method = "ridge";
  int channels = 3;
  Weights raw;  ///< as estimated
  Validity validity;
  Eigen::MatrixXd weights;        ///< prior sigmas, k x channels
  Eigen::MatrixXd weight_sigmas;  ///< posterior deviations, prior sigmas
  Deviation deviation;
  std::array<double, 3> gloss_gu{};
  Lab lab = Lab::Zero();
  double delta_e00 = 0;  ///< to the taught colour; 0 without a recipe
  /// The same and more readings with their deviations; gloss_gu and lab are their values.
  ClusterReadings readings;
  /// What pixel noise alone lets them scatter: their sigmas; NaN where no rule asks for it.
  ClusterReadings repeat;
};

struct PartResult {
  Verdict verdict = Verdict::none;
  std::string calibration_hash;  ///< of the calibration it was measured with
  std::vector<Finding> findings;
  ReasonBits reason_bits = 0;
  double t2_ratio = 0;  ///< largest T^2 over its limit
  double spe_ratio = 0;
  int worst_cluster = 0;
  std::array<double, 2> tilt_deg{};  ///< of the part, about x and y
  std::array<double, 2> tilt_sigma_deg{};
  std::array<double, 2> shift_mm{};  ///< from the taught place, x and y
  double rotation_deg = 0;           ///< from the taught pose, about z
  double height_mm = 0;              ///< of the part over the taught plane
  double height_sigma_mm = 0;
  double ambient = 0;  ///< share of white
  double clipped = 0;  ///< share of the part's cells
  /// Relative standard uncertainty that all of f has in common: the white reference's.
  double white_sigma = 0;
  /// Per light, against the calibration; NaN: not known. Empty: no monitor patch.
  std::vector<double> lamp_drift;
  std::vector<Defect> defects;
  std::vector<ClusterResult> clusters;
  std::vector<RuleOutcome> rules;  ///< of the recipe's rules, per cluster that each is about
  Regions regions;
};

}  // namespace brdfgate
