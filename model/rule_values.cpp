#include "model/rule_values.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "model/appearance.hpp"

namespace brdfgate {
namespace {

/// Repeats of one part scatter up to 5.3 times as far as the ridge's gain says (docs/rules.md has
/// the figures): the estimator is another, and the part's pose is estimated each time.
constexpr double kRepeatMargin = 6;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kAspecular = static_cast<int>(RuleReading::aspecular_15_l_star);
constexpr int kAspecularEnd = static_cast<int>(RuleReading::aspecular_110_b_star) + 1;

bool is_gloss(RuleReading reading) {
  return reading <= RuleReading::gloss_85_gu;
}

bool is_lab(RuleReading reading) {
  return reading >= RuleReading::l_star && reading <= RuleReading::b_star;
}

bool is_aspecular(RuleReading reading) {
  return static_cast<int>(reading) >= kAspecular && static_cast<int>(reading) < kAspecularEnd;
}

std::size_t gloss_index(RuleReading reading) {
  return static_cast<std::size_t>(reading);
}

Eigen::Index lab_axis(RuleReading reading) {
  const int from = is_lab(reading) ? static_cast<int>(RuleReading::l_star) : kAspecular;
  return (static_cast<int>(reading) - from) % 3;
}

std::size_t aspecular_index(RuleReading reading) {
  return static_cast<std::size_t>(static_cast<int>(reading) - kAspecular) / 3;
}

/// Of the difference to the mean of the taught parts, over that of one part.
double growth(const TaughtCluster& taught) {
  return 1 + 1.0 / std::max(1, taught.parts);
}

/// The part's colour against the taught one, where three levels are compared, and what noise alone
/// does to it: its covariance's factor carried to L*a*b*, to first order, a column per factor.
struct ColourChange {
  Lab lab;
  Eigen::Matrix3d noise;
};

std::optional<ColourChange> colour_change(const TaughtCluster& taught,
                                          const ClusterObservation* seen) {
  if (seen == nullptr) return std::nullopt;
  const std::optional<Lab> lab = compared_colour(taught, *seen);
  if (!lab || seen->monitored_noise.rows() < 3) return std::nullopt;
  const Eigen::Matrix3d covariance = growth(taught) * seen->monitored_noise.topLeftCorner<3, 3>();
  const Eigen::LDLT<Eigen::Matrix3d> ldlt(covariance);
  const Eigen::Vector3d scale = ldlt.vectorD().cwiseMax(0).cwiseSqrt();
  const Eigen::Matrix3d lower = ldlt.matrixL();
  const Eigen::Matrix3d factor = ldlt.transpositionsP().transpose() * (lower * scale.asDiagonal());
  constexpr double kStep = 1e-3;
  Eigen::Matrix3d gradient;
  for (int i = 0; i < 3; ++i) {
    ClusterObservation moved = *seen;
    moved.monitored[i] += kStep;
    gradient.col(i) = (*compared_colour(taught, moved) - *lab).matrix() / kStep;
  }
  return ColourChange{*lab, gradient * factor};
}

/// RMS of the colour differences that noise makes. The deviation of dE00 itself is no larger.
double delta_e00_sigma(const ColourChange& change) {
  double sum = 0;
  for (int j = 0; j < 3; ++j)
    sum += std::pow(delta_e00(change.lab, change.lab + change.noise.col(j).array()), 2);
  return std::sqrt(sum);
}

/// Where a reading stands among a cluster's; nullptr: it is none of them.
const Reading* find(const ClusterReadings& readings, RuleReading reading) {
  if (is_gloss(reading)) return &readings.gloss[gloss_index(reading)];
  if (reading == RuleReading::haze_gu) return &readings.haze;
  if (reading == RuleReading::flop_index) return &readings.flop;
  const auto axis = static_cast<std::size_t>(lab_axis(reading));
  if (is_lab(reading)) return &readings.at_45_0().lab[axis];
  return is_aspecular(reading) ? &readings.aspecular[aspecular_index(reading)].lab[axis] : nullptr;
}

RuleValue delta_e00_value(const ClusterResult& cluster, const TaughtCluster& taught,
                          const ClusterObservation* seen) {
  RuleValue out;
  if (const auto change = colour_change(taught, seen)) {
    out.value = delta_e00(taught.lab, change->lab);
    out.sigma = delta_e00_sigma(*change);
    return out;
  }
  const std::array<Reading, 3>& lab = cluster.readings.at_45_0().lab;
  out.value = delta_e00(taught.lab, cluster.lab);
  out.sigma = std::hypot(lab[0].sigma, lab[1].sigma, lab[2].sigma);
  out.measured = lab[0].measured;
  return out;
}

RuleValue reading_value(RuleReading reading, const ClusterResult& cluster,
                        const TaughtCluster& taught, const ClusterObservation* seen) {
  RuleValue out;
  const Reading& found = *find(cluster.readings, reading);
  out.value = found.value;
  out.sigma = found.sigma;
  out.measured = found.measured;
  if (reading == RuleReading::haze_gu) out.missing = "haze is defined for over 70 GU at 60 degrees";
  if (is_lab(reading)) {
    const Eigen::Index axis = lab_axis(reading);
    if (const auto change = colour_change(taught, seen)) {
      out.change = change->lab[axis] - taught.lab[axis];
      out.change_sigma = change->noise.row(axis).norm();
    }
  } else if (const double noise = find(cluster.repeat, reading)->sigma; std::isfinite(noise)) {
    out.change_sigma = kRepeatMargin * std::sqrt(growth(taught)) * noise;
  }
  return out;
}

RuleValue reconstructed_value(RuleReading reading, const ClusterResult& cluster,
                              const TaughtCluster& taught, const ClusterObservation* seen) {
  RuleValue out;
  if (!cluster.valid.weights) {
    out.missing = "no valid weights";
    return out;
  }
  if (reading == RuleReading::residual_rms) {
    out.value = cluster.raw.residual_rms;
    return out;
  }
  if (rule_reading_info(reading).is_colour() && !cluster.valid.colour) {
    out.missing = "this station knows no colour";
    out.missing_reason = Reason::calibration_or_recipe;
    return out;
  }
  return reading == RuleReading::delta_e00 ? delta_e00_value(cluster, taught, seen)
                                           : reading_value(reading, cluster, taught, seen);
}

/// A bin of the taught cluster as samples have it.
BinnedSamples bins_of(const BinFrame& frame) {
  BinnedSamples samples;
  for (std::size_t i = 0; i < frame.directions.size(); ++i)
    samples.bins.push_back({frame.id[i], frame.light[i], frame.directions[i]});
  return samples;
}

bool sees_aspecular(const BinnedSamples& samples, double angle_deg) {
  return is_measured(samples, to_half_diff(aspecular_directions(angle_deg)));
}

}  // namespace

RuleValue cluster_value(RuleReading reading, const ClusterResult& cluster,
                        const TaughtCluster& taught, const ClusterObservation* seen) {
  RuleValue out;
  if (reading == RuleReading::area_share) {
    out.value = cluster.area_share;
  } else {
    out = reconstructed_value(reading, cluster, taught, seen);
  }
  out.taught = taught_value(reading, taught);
  return out;
}

RuleValue part_value(RuleReading reading, const PartFacts& facts, const std::string& kind) {
  RuleValue out;
  if (reading == RuleReading::unknown_share) {
    out.value = facts.unknown_share;
    return out;
  }
  if (reading == RuleReading::tilt_deg) {
    const double x = std::abs(facts.tilt_deg[0]), y = std::abs(facts.tilt_deg[1]);
    out.value = std::isfinite(x + y) ? std::max(x, y) : kNaN;
    out.sigma = facts.tilt_sigma_deg[y > x ? 1 : 0];
    return out;
  }
  double count = 0, largest = 0, area = 0;  // a size that is not known is not small: it stays
  for (const Defect& defect : facts.defects) {
    if (!kind.empty() && defect.kind != kind) continue;
    ++count;
    if (std::isfinite(largest) && !(defect.size_mm <= largest)) largest = defect.size_mm;
    area += EIGEN_PI / 4 * defect.size_mm * defect.size_mm;
  }
  out.value = reading == RuleReading::defects          ? count
              : reading == RuleReading::defect_size_mm ? largest
                                                       : area;
  return out;
}

double taught_value(RuleReading reading, const TaughtCluster& taught) {
  if (taught.parts == 0) return kNaN;
  if (is_gloss(reading)) return taught.gloss_gu[gloss_index(reading)];
  if (reading == RuleReading::haze_gu) return haze_gu(taught.gloss_gu);
  if (is_lab(reading)) return taught.lab[lab_axis(reading)];
  if (reading == RuleReading::area_share) return taught.area_share;
  const Reading* derived = find(taught.readings, reading);
  return derived != nullptr ? derived->value : kNaN;
}

bool can_be_measured(RuleReading reading, const TaughtCluster& taught) {
  const BinnedSamples seen = bins_of(taught.directions.frame);
  if (seen.bins.empty()) return true;
  switch (reading) {
    case RuleReading::gloss_20_gu:
      return is_gloss_measured(seen, 20);
    case RuleReading::gloss_60_gu:
      return is_gloss_measured(seen, 60);
    case RuleReading::gloss_85_gu:
      return is_gloss_measured(seen, 85);
    case RuleReading::haze_gu:
      return is_gloss_measured(seen, 20) && is_gloss_measured(seen, 60);
    case RuleReading::flop_index:
      return sees_aspecular(seen, 15) && sees_aspecular(seen, 45) && sees_aspecular(seen, 110);
    default:
      break;
  }
  if (is_aspecular(reading))
    return sees_aspecular(seen, kAspecularDeg.at(aspecular_index(reading)));
  if (reading == RuleReading::delta_e00 && compares_colour(taught)) return true;
  const bool of_45_0 = is_lab(reading) || reading == RuleReading::delta_e00;
  return !of_45_0 || sees_aspecular(seen, 45);
}

std::string never_defined(RuleReading reading, const TaughtCluster& taught) {
  if (reading == RuleReading::haze_gu && taught.parts > 0 && std::isnan(haze_gu(taught.gloss_gu))) {
    char gloss[32];
    std::snprintf(gloss, sizeof gloss, "%.3g", taught.gloss_gu[1]);
    return "haze is defined for over 70 GU at 60 degrees (ASTM D4039), taught " +
           std::string(gloss) + " GU";
  }
  return "";
}

}  // namespace brdfgate
