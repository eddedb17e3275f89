#include "model/recipe.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>

#include "model/error.hpp"
#include "model/limits.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

/// Below this number of parts their spread says nothing: the floor and the known noise stand in.
constexpr std::size_t kSpreadParts = 3;
/// Part-to-part deviation of a mapped residual never taken smaller: 0.4 % of reflectance.
constexpr double kResidualFloor = 0.004;
/// With fewer parts it is taken as this, and that of a monitored change as kFewChange.
constexpr double kFewResidual = 0.02;
constexpr double kFewChange = 0.03;
/// A bin's own variance counts as that of N - 1 draws, the mean over all bins as this many more:
/// with N small a single bin's variance is nearly arbitrary.
constexpr double kPooledDraws = 8;

std::string shape(const ClusterObservation& part) {
  return std::to_string(part.weights.rows()) + " components, " +
         std::to_string(part.monitored.size()) + " monitored, " + std::to_string(part.channels()) +
         " channels";
}

void check_part(const ClusterObservation& part, const ClusterObservation& first,
                const std::string& where) {
  if (shape(part) != shape(first)) throw InputError(where, shape(part), shape(first));
  const auto bins = static_cast<Index>(part.bin_id.size());
  if (bins == 0 || part.residual.rows() != bins || part.residual_noise.rows() != bins ||
      part.residual_noise.cols() != part.residual.cols()) {
    throw InputError(
        where,
        std::to_string(bins) + " bins for " + std::to_string(part.residual.rows()) + " residuals",
        "one or more, of equal number");
  }
  if (!part.weights.allFinite() || !part.monitored_noise.allFinite() ||
      !part.residual.allFinite() || !part.residual_noise.allFinite()) {
    throw InputError(where, "holds a number that is not finite",
                     "weights and residuals of a part "
                     "that was measured");
  }
}

void check(const std::vector<ClusterObservation>& parts, const JudgeSettings& settings) {
  if (parts.empty()) throw InputError("teaching", "no parts", "at least one");
  if (!(settings.false_reject_rate > 0 && settings.false_reject_rate < 0.5)) {
    throw InputError("false_reject_rate", std::to_string(settings.false_reject_rate),
                     "a share over 0, under 0.5");
  }
  if (!(settings.change_floor > 0 && std::isfinite(settings.change_floor))) {
    throw InputError("change_floor", std::to_string(settings.change_floor),
                     "a finite deviation over 0");
  }
  for (std::size_t i = 0; i < parts.size(); ++i)
    check_part(parts[i], parts.front(), "teaching: part " + std::to_string(i + 1));
}

/// Rows are parts; NaN where a part did not see a bin.
struct ResidualTable {
  std::vector<int> bin_id;
  Eigen::ArrayXXd residual;  ///< parts x (bins * channels), channel by channel
  Eigen::ArrayXXd noise;
};

/// Bins that at least half of the parts saw, by id.
ResidualTable tabulate(const std::vector<ClusterObservation>& parts) {
  std::map<int, std::size_t> times_seen;
  for (const ClusterObservation& part : parts) {
    for (const int id : part.bin_id)
      ++times_seen[id];
  }
  ResidualTable table;
  std::map<int, Index> column;
  for (const auto& [id, times] : times_seen) {
    if (2 * times < parts.size()) continue;
    column[id] = std::ssize(table.bin_id);
    table.bin_id.push_back(id);
  }
  const Index bins = std::ssize(table.bin_id), channels = parts.front().channels();
  table.residual.setConstant(std::ssize(parts), bins * channels,
                             std::numeric_limits<double>::quiet_NaN());
  table.noise = table.residual;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    for (std::size_t j = 0; j < parts[i].bin_id.size(); ++j) {
      const auto at = column.find(parts[i].bin_id[j]);
      if (at == column.end()) continue;
      for (Index channel = 0; channel < channels; ++channel) {
        const auto row = static_cast<Index>(i), bin = static_cast<Index>(j);
        table.residual(row, channel * bins + at->second) = parts[i].residual(bin, channel);
        table.noise(row, channel * bins + at->second) = parts[i].residual_noise(bin, channel);
      }
    }
  }
  return table;
}

/// Mean and part-to-part variance per column, over the parts that saw it.
struct Spread {
  Eigen::ArrayXd mean;
  Eigen::ArrayXd variance;  ///< pooled and floored
};

/// @param left_out  a row not to count, or -1
Spread spread_of(const ResidualTable& table, Index left_out = -1) {
  const Index columns = table.residual.cols();
  Spread spread{Eigen::ArrayXd::Constant(columns, std::numeric_limits<double>::quiet_NaN()),
                Eigen::ArrayXd::Zero(columns)};
  Eigen::ArrayXd draws = Eigen::ArrayXd::Zero(columns);
  for (Index c = 0; c < columns; ++c) {
    double sum = 0, count = 0;
    for (Index i = 0; i < table.residual.rows(); ++i) {
      if (i == left_out || std::isnan(table.residual(i, c))) continue;
      sum += table.residual(i, c);
      ++count;
    }
    if (count == 0) continue;
    spread.mean[c] = sum / count;
    draws[c] = count - 1;
    for (Index i = 0; i < table.residual.rows(); ++i) {
      if (i == left_out || std::isnan(table.residual(i, c))) continue;
      const double d = table.residual(i, c) - spread.mean[c];
      spread.variance[c] += d * d;  // a sum so far
    }
  }
  const double pooled = spread.variance.sum() / std::max(1.0, draws.sum());
  spread.variance = ((spread.variance + kPooledDraws * pooled) / (draws + kPooledDraws))
                        .max(kResidualFloor * kResidualFloor);
  return spread;
}

/// SPE of each part against the others.
double leave_one_out_mean(const ResidualTable& table) {
  const Index parts = table.residual.rows();
  const double growth = 1 + 1.0 / static_cast<double>(parts - 1);
  double sum = 0;
  for (Index i = 0; i < parts; ++i) {
    const Spread others = spread_of(table, i);
    const Eigen::ArrayXd d = table.residual.row(i).transpose() - others.mean;
    const Eigen::ArrayXd square =
        d.square() / (others.variance * growth + table.noise.row(i).transpose());
    const auto seen = square.isFinite();
    sum += seen.select(square, 0).sum() / std::max<double>(1, static_cast<double>(seen.count()));
  }
  return sum / static_cast<double>(parts);
}

/// Residuals in units of their deviations; 0 where a part did not see a bin.
Eigen::MatrixXd standardised(const ResidualTable& table, const Spread& spread) {
  const Eigen::ArrayXXd d = table.residual.rowwise() - spread.mean.transpose();
  const Eigen::ArrayXXd z = d / (table.noise.rowwise() + spread.variance.transpose()).sqrt();
  return z.isFinite().select(z, 0).matrix();
}

void teach_residuals(TaughtCluster& taught, const std::vector<ClusterObservation>& parts,
                     double rate) {
  const ResidualTable table = tabulate(parts);
  Spread spread = spread_of(table);
  if (parts.size() < kSpreadParts) {
    // The known noise of the taught mean stands beside the floor.
    const Eigen::ArrayXXd known = table.noise.isFinite().select(table.noise, 0);
    spread.variance = kFewResidual * kFewResidual + known.colwise().mean().transpose();
    taught.spe_limit = kSpeLimitOfFew;
  } else {
    taught.spe_limit = spe_limit(leave_one_out_mean(table), box_dof(standardised(table, spread)),
                                 taught.parts, rate);
  }
  const Index bins = std::ssize(table.bin_id), channels = parts.front().channels();
  taught.bin_id = table.bin_id;
  taught.bin_residual = spread.mean.reshaped(bins, channels).matrix();
  taught.bin_residual_sigma = spread.variance.sqrt().reshaped(bins, channels).matrix();
}

void teach_weights(TaughtCluster& taught, const std::vector<ClusterObservation>& parts,
                   const JudgeSettings& settings, double rate) {
  const Index p = parts.front().monitored.size();
  const int levels = parts.front().levels;
  taught.mean = Eigen::MatrixXd::Zero(parts.front().weights.rows(), parts.front().weights.cols());
  Eigen::MatrixXd monitored(std::ssize(parts), p);
  Eigen::MatrixXd noise = Eigen::MatrixXd::Zero(p, p);
  for (std::size_t i = 0; i < parts.size(); ++i) {
    taught.mean += parts[i].weights;
    monitored.row(static_cast<Index>(i)) = parts[i].monitored.transpose();
    noise += parts[i].monitored_noise;
  }
  taught.mean /= static_cast<double>(parts.size());
  taught.monitored_mean = monitored.colwise().mean().transpose();
  if (parts.size() < kSpreadParts) {
    taught.monitored_covariance = noise / static_cast<double>(parts.size());
    taught.monitored_covariance.diagonal().array() += kFewChange * kFewChange;
  } else {
    taught.monitored_covariance = shrunk_covariance(monitored, levels);
  }
  const double floor = settings.change_floor;
  taught.t2_limit = t2_limit(taught.monitored_covariance, taught.parts, floor, rate, levels);
  taught.monitored_covariance.diagonal().array() += floor * floor;
}

}  // namespace

BinFrame common_frame(const std::vector<TeachSample>& parts) {
  struct Seen {
    std::size_t times = 0;
    Bin first;
    HalfDiff sum;
  };
  std::map<int, Seen> bins;
  for (const TeachSample& part : parts) {
    for (const Bin& bin : part.samples.bins) {
      Seen& seen = bins[bin.id];
      if (seen.times++ == 0) seen.first = bin;
      seen.sum.theta_h += bin.angles.theta_h;
      seen.sum.theta_d += bin.angles.theta_d;
      // phi_d runs over [0, pi) and wraps.
      seen.sum.phi_d += seen.first.angles.phi_d +
                        std::remainder(bin.angles.phi_d - seen.first.angles.phi_d, EIGEN_PI);
    }
  }
  BinFrame frame;
  for (const auto& [id, seen] : bins) {
    if (2 * seen.times < parts.size()) continue;
    const auto n = static_cast<double>(seen.times);
    const double phi = std::fmod(seen.sum.phi_d / n + 2 * EIGEN_PI, EIGEN_PI);
    frame.id.push_back(id);
    frame.light.push_back(seen.first.light);
    frame.directions.push_back({seen.sum.theta_h / n, seen.sum.theta_d / n, phi});
  }
  if (frame.id.empty()) {
    throw InputError("teaching", "no angular bin was seen by half of the parts",
                     "good parts of one kind");
  }
  return frame;
}

ObservedParts observe_parts(const Basis& basis, const Brdf& material,
                            const std::vector<TeachSample>& parts) {
  if (parts.empty()) throw InputError("teaching", "no parts", "at least one");
  const BinFrame frame = common_frame(parts);
  const BasisRows rows = basis.rows(frame.directions);
  const Index bins = std::ssize(frame.id), channels = parts.front().samples.channels;
  Eigen::MatrixXd reference = Eigen::MatrixXd::Zero(bins, channels), noise = reference;
  Eigen::VectorXd times = Eigen::VectorXd::Zero(bins);
  std::vector<BinnedSamples> framed;
  for (const TeachSample& part : parts) {
    framed.push_back(onto_frame(basis, part.samples, part.weights, frame));
    const Eigen::MatrixXd x = centred(framed.back(), rows), v = mapped_noise(rows, framed.back());
    for (Index j = 0; j < bins; ++j) {
      if (framed.back().bins[static_cast<std::size_t>(j)].pixels == 0) continue;
      reference.row(j) += x.row(j);
      noise.row(j) += v.row(j);
      ++times[j];
    }
  }
  reference.array().colwise() /= times.array();
  noise.array().colwise() /= times.array();
  ObservedParts out{monitored_directions(basis, material, frame, reference, noise), {}};
  for (std::size_t i = 0; i < parts.size(); ++i)
    out.parts.push_back(observe_along(out.directions, basis, framed[i], parts[i].weights));
  return out;
}

TaughtCluster teach_observed(const std::vector<ClusterObservation>& parts,
                             const JudgeSettings& settings, int clusters) {
  check(parts, settings);
  const double rate = split_rate(settings.false_reject_rate, clusters).per_statistic;
  TaughtCluster taught;
  taught.parts = static_cast<int>(parts.size());
  teach_weights(taught, parts, settings, rate);
  teach_residuals(taught, parts, rate);
  return taught;
}

}  // namespace brdfgate
