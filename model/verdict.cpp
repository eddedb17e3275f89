#include "model/verdict.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "model/error.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

void check(const TaughtCluster& taught, const ClusterObservation& seen) {
  if (seen.monitored.size() != taught.monitored_mean.size() ||
      seen.channels() != taught.bin_residual.cols()) {
    throw InputError("cluster '" + taught.name + "'",
                     std::to_string(seen.monitored.size()) + " monitored changes of " +
                         std::to_string(seen.channels()) + " channels",
                     std::to_string(taught.monitored_mean.size()) + " of " +
                         std::to_string(taught.bin_residual.cols()));
  }
}

double growth(const TaughtCluster& taught) {
  return 1 + 1.0 / std::max(1, taught.parts);
}

/// Distance from the taught mean, and its covariance for a part as good as the taught ones.
struct WeightDistance {
  Eigen::VectorXd d;
  Eigen::MatrixXd covariance;
  Eigen::VectorXd solved() const { return covariance.ldlt().solve(d); }
};

WeightDistance weight_distance(const TaughtCluster& taught, const ClusterObservation& seen) {
  return {seen.monitored - taught.monitored_mean,
          taught.monitored_covariance * growth(taught) + seen.monitored_noise};
}

/// Calls visit(bin of `seen`, channel, residual in units of its deviation) for every taught bin
/// seen.
template <typename Visit>
void for_each_residual(const TaughtCluster& taught, const ClusterObservation& seen, Visit&& visit) {
  for (std::size_t j = 0; j < seen.bin_id.size(); ++j) {
    const auto at = std::lower_bound(taught.bin_id.begin(), taught.bin_id.end(), seen.bin_id[j]);
    if (at == taught.bin_id.end() || *at != seen.bin_id[j]) continue;
    const Index t = at - taught.bin_id.begin(), bin = static_cast<Index>(j);
    for (Index channel = 0; channel < seen.residual.cols(); ++channel) {
      const double sigma = taught.bin_residual_sigma(t, channel);
      const double variance = sigma * sigma * growth(taught) + seen.residual_noise(bin, channel);
      const double d = seen.residual(bin, channel) - taught.bin_residual(t, channel);
      visit(j, static_cast<int>(channel), d / std::sqrt(variance));
    }
  }
}

bool is_draft(const TaughtCluster& taught) {
  return taught.parts == 0;
}

}  // namespace

Verdict verdict_of(ReasonBits bits) {
  if ((bits & kNotJudgedBits) != 0) return Verdict::not_judged;
  return (bits & kRejectBits) != 0 ? Verdict::reject : Verdict::pass;
}

Deviation deviation(const TaughtCluster& taught, const ClusterObservation& seen) {
  if (is_draft(taught)) return {};
  check(taught, seen);
  const WeightDistance weights = weight_distance(taught, seen);
  double sum = 0;
  std::size_t count = 0;
  for_each_residual(taught, seen, [&](std::size_t, int, double sigmas) {
    sum += sigmas * sigmas;
    ++count;
  });
  const double spe =
      count == 0 ? std::numeric_limits<double>::quiet_NaN() : sum / static_cast<double>(count);
  return {weights.d.dot(weights.solved()), taught.t2_limit, spe, taught.spe_limit};
}

std::vector<MonitoredShift> monitored_shifts(const TaughtCluster& taught,
                                             const ClusterObservation& seen) {
  check(taught, seen);
  const WeightDistance weights = weight_distance(taught, seen);
  const Eigen::VectorXd parts = weights.d.cwiseProduct(weights.solved());
  const std::vector<std::string>& names = taught.directions.names;
  std::vector<MonitoredShift> shifts;
  for (Index i = 0; i < parts.size(); ++i) {
    const auto at = static_cast<std::size_t>(i);
    shifts.push_back({at < names.size() ? names[at] : "direction " + std::to_string(i + 1),
                      std::expm1(weights.d[i]), weights.d[i] / std::sqrt(weights.covariance(i, i)),
                      parts[i]});
  }
  return shifts;
}

MonitoredShift largest_shift(const TaughtCluster& taught, const ClusterObservation& seen) {
  const std::vector<MonitoredShift> shifts = monitored_shifts(taught, seen);
  if (shifts.empty()) return {};
  return *std::max_element(shifts.begin(), shifts.end(),
                           [](const auto& a, const auto& b) { return a.part < b.part; });
}

bool compares_colour(const TaughtCluster& taught) {
  const std::vector<std::string>& names = taught.directions.names;
  return names.size() >= 3 && names[0] == level_name(0, 3) && names[1] == level_name(1, 3) &&
         names[2] == level_name(2, 3);
}

std::optional<Lab> compared_colour(const TaughtCluster& taught, const ClusterObservation& seen) {
  if (!compares_colour(taught)) return std::nullopt;
  const Eigen::Array3d rgb = xyz_to_linear_srgb(lab_to_xyz(taught.lab));
  const Eigen::Array3d change = (seen.monitored - taught.monitored_mean).head<3>().array().exp();
  return linear_srgb_to_lab(rgb * change);
}

ResidualShift largest_residual(const TaughtCluster& taught, const ClusterObservation& seen) {
  check(taught, seen);
  ResidualShift largest;
  for_each_residual(taught, seen, [&](std::size_t j, int channel, double sigmas) {
    if (std::abs(sigmas) > std::abs(largest.sigmas)) largest = {channel, seen.angles[j], sigmas};
  });
  return largest;
}

}  // namespace brdfgate
