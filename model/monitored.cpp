#include "model/monitored.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>

#include "model/analytic.hpp"
#include "model/error.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Error of one mapped observation beside its noise: what binning and the move onto the frame
/// leave, another one wherever a part lies, since other cells of a bin are then seen.
constexpr double kBinError = 0.01;
/// The share of it in which the channels of a bin differ. Cells and angles are the same for all of
/// them: parts moved within range differ by 0.12 to 0.21 % between channels beyond pixel noise, RMS
/// over the bins, by 0.2 to 0.5 % in common (decision 27).
constexpr double kChannelError = 0.003;
/// The same of gloss level and roughness as a whole, relative: a narrow highlight of a small region
/// is seen by few bins, whose errors are not independent. 4 mm and 4 deg moved a good print's gloss
/// by 5 %.
constexpr double kHighlightError = 0.01;
/// Relative step of the derivatives.
constexpr double kStep = 0.02;
/// Prior deviation of every change, ln units: a direction that a part's bins do not tell stays at
/// 0.
constexpr double kPriorChange = 1.0;

constexpr const char* kLevel = "diffuse level";
constexpr const char* kGlossLevel = "gloss level";
constexpr const char* kRoughness = "roughness";

/// Not owning: for a call's duration.
BrdfPtr borrowed(const Brdf& brdf) {
  return {&brdf, [](const Brdf*) {}};
}

/// Mapped values of a BRDF on a frame, bins x channels.
MatrixXd mapped_values(const Brdf& brdf, const BinFrame& frame, const BasisRows& rows,
                       Index channels) {
  MatrixXd x(rows.q.rows(), channels);
  for (Index j = 0; j < x.rows(); ++j) {
    const Rgb f = brdf.eval(frame.directions[static_cast<std::size_t>(j)]);
    for (Index c = 0; c < channels; ++c)
      x(j, c) = to_mapped(f[c], rows.median[j], rows.weight[j]);
  }
  return x;
}

/// Central difference of the mapped values by the logarithm of a change's factor.
MatrixXd response_to(const Brdf& material, const BinFrame& frame, const BasisRows& rows,
                     Index channels, const std::function<BrdfChange(double)>& change) {
  const auto at = [&](double factor) {
    return mapped_values(*changed(borrowed(material), change(factor)), frame, rows, channels);
  };
  return (at(1 + kStep) - at(1 - kStep)) / (std::log1p(kStep) - std::log1p(-kStep));
}

/// Information of the least squares: T' W T.
MatrixXd information(const MatrixXd& response, const VectorXd& weight) {
  return response.transpose() * weight.asDiagonal() * response;
}

void remove_direction(MonitoredDirections& d, Index gone) {
  const Index behind = d.response.cols() - gone - 1;
  d.response.middleCols(gone, behind) = d.response.rightCols(behind).eval();
  d.response.conservativeResize(Eigen::NoChange, d.response.cols() - 1);
  d.names.erase(d.names.begin() + gone);
}

/// Gives up the direction known worst while that is worse than kUselessDirection.
void keep_useful(MonitoredDirections& d) {
  while (d.size() > 1) {
    MatrixXd normal = information(d.response, d.weight.reshaped());
    normal.diagonal().array() += 1 / (kPriorChange * kPriorChange);
    const MatrixXd covariance = normal.inverse();
    Index worst = 0;
    if (covariance.diagonal().maxCoeff(&worst) <= kUselessDirection * kUselessDirection) return;
    remove_direction(d, worst);
  }
}

void check_frame(const MonitoredDirections& d, const BinnedSamples& framed) {
  bool same = framed.bins.size() == d.frame.id.size() && framed.channels == d.reference.cols();
  for (std::size_t j = 0; same && j < framed.bins.size(); ++j)
    same = framed.bins[j].id == d.frame.id[j];
  if (same) return;
  throw InputError("monitored directions",
                   std::to_string(framed.bins.size()) + " samples on other bins",
                   "the " + std::to_string(d.frame.id.size()) + " bins of the taught frame");
}

/// Numbers of the bins with pixels.
std::vector<Index> seen_bins(const BinnedSamples& framed) {
  std::vector<Index> seen;
  for (std::size_t j = 0; j < framed.bins.size(); ++j)
    if (framed.bins[j].pixels > 0) seen.push_back(static_cast<Index>(j));
  if (seen.empty()) throw InputError("monitored directions", "no bin was seen", "at least one");
  return seen;
}

/// Rows of the response that belong to the seen bins, channel by channel.
MatrixXd seen_response(const MonitoredDirections& d, const std::vector<Index>& seen) {
  const Index bins = d.reference.rows(), n = std::ssize(seen);
  MatrixXd t(n * d.reference.cols(), d.size());
  for (Index c = 0; c < d.reference.cols(); ++c)
    t.middleRows(c * n, n) = d.response.middleRows(c * bins, bins)(seen, Eigen::all);
  return t;
}

/// Covariance of the changes: pixels' noise, and the bins' error, most of it common to a bin's
/// channels.
MatrixXd noise_along(const MatrixXd& gain, const MatrixXd& noise) {
  constexpr double kOwn = kChannelError * kChannelError, kCommon = kBinError * kBinError - kOwn;
  const VectorXd own = (noise.array() + kOwn).matrix().reshaped();
  MatrixXd all_channels = MatrixXd::Zero(gain.rows(), noise.rows());
  for (Index c = 0; c < noise.cols(); ++c)
    all_channels += gain.middleCols(c * noise.rows(), noise.rows());
  return gain * own.asDiagonal() * gain.transpose() +
         kCommon * all_channels * all_channels.transpose();
}

}  // namespace

std::string level_name(Index channel, Index channels) {
  if (channels == 1) return kLevel;
  return std::string(kLevel) + ' ' + "RGB"[channel % 3];
}

int level_count(const MonitoredDirections& directions) {
  return static_cast<int>(
      std::count_if(directions.names.begin(), directions.names.end(),
                    [](const std::string& name) { return name.starts_with(kLevel); }));
}

MonitoredDirections monitored_directions(const Basis& basis, const Brdf& material,
                                         const BinFrame& frame, const MatrixXd& reference,
                                         const MatrixXd& noise) {
  const Index bins = std::ssize(frame.id), channels = reference.cols();
  if (bins == 0 || reference.rows() != bins || noise.rows() != bins || noise.cols() != channels) {
    throw InputError("monitored directions",
                     std::to_string(reference.rows()) + " reference values for " +
                         std::to_string(bins) + " bins",
                     "as many, at least one");
  }
  const BasisRows rows = basis.rows(frame.directions);
  MonitoredDirections d{{}, frame, reference, MatrixXd::Zero(bins * channels, channels + 2), {}};
  d.weight = (noise.array() + kBinError * kBinError).inverse().matrix();
  const MatrixXd level = response_to(material, frame, rows, channels,
                                     [](double x) { return BrdfChange{.albedo = x}; });
  for (Index c = 0; c < channels; ++c) {
    d.response.col(c).segment(c * bins, bins) = level.col(c);
    d.names.push_back(level_name(c, channels));
  }
  d.response.col(channels) = response_to(material, frame, rows, channels, [](double x) {
                               return BrdfChange{.gloss = x};
                             }).reshaped();
  d.response.col(channels + 1) = response_to(material, frame, rows, channels, [](double x) {
                                   return BrdfChange{.roughness = x};
                                 }).reshaped();
  d.names.insert(d.names.end(), {kGlossLevel, kRoughness});
  keep_useful(d);
  return d;
}

ClusterObservation observe_along(const MonitoredDirections& directions, const Basis& basis,
                                 const BinnedSamples& framed, const Weights& linear) {
  check_frame(directions, framed);
  const std::vector<Index> seen = seen_bins(framed);
  const BasisRows rows = basis.rows(directions.frame.directions);
  const MatrixXd distance = centred(framed, rows) - directions.reference;
  const MatrixXd noise = mapped_noise(rows, framed);

  ClusterObservation out;
  out.weights = linear.in_prior_sigmas(basis.info().observations);
  for (const Index j : seen) {
    out.bin_id.push_back(directions.frame.id[static_cast<std::size_t>(j)]);
    out.angles.push_back(directions.frame.directions[static_cast<std::size_t>(j)]);
  }
  const MatrixXd t = seen_response(directions, seen);
  const VectorXd w = directions.weight(seen, Eigen::all).reshaped();
  MatrixXd normal = information(t, w);
  normal.diagonal().array() += 1 / (kPriorChange * kPriorChange);
  const MatrixXd gain = normal.ldlt().solve(t.transpose() * w.asDiagonal());
  const VectorXd d = distance(seen, Eigen::all).reshaped();
  out.monitored = gain * d;
  out.residual_noise = (noise(seen, Eigen::all).array() + kBinError * kBinError).matrix();
  out.monitored_noise = noise_along(gain, noise(seen, Eigen::all));
  out.levels = level_count(directions);
  for (std::size_t i = 0; i < directions.names.size(); ++i) {
    if (directions.names[i] != kGlossLevel && directions.names[i] != kRoughness) continue;
    const auto at = static_cast<Index>(i);
    out.monitored_noise(at, at) += kHighlightError * kHighlightError;
  }
  out.residual = (d - t * out.monitored).reshaped(std::ssize(seen), distance.cols());
  return out;
}

}  // namespace brdfgate
