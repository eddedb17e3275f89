#include "model/observation.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "model/mapping.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

/// Noise of the leading `components` weights per channel, in prior sigmas, through the ridge gain.
std::vector<Eigen::MatrixXd> through_gain(const BasisRows& rows, const Eigen::MatrixXd& noise,
                                          double eta, int observations, Index components) {
  Eigen::MatrixXd normal = rows.q.transpose() * rows.q;
  normal.diagonal().array() += eta;
  // M' = Q (Q'Q + eta I)^-1, its leading columns only.
  const Eigen::MatrixXd gain = rows.q * Eigen::LLT<Eigen::MatrixXd>(normal).solve(
                                            Eigen::MatrixXd::Identity(normal.rows(), components));
  std::vector<Eigen::MatrixXd> covariance;
  for (Index channel = 0; channel < noise.cols(); ++channel) {
    covariance.emplace_back(observations *
                            (gain.transpose() * noise.col(channel).asDiagonal() * gain));
  }
  return covariance;
}

}  // namespace

Eigen::VectorXd leading_weights(const Eigen::MatrixXd& weights, int per_channel) {
  return weights.topRows(std::min<Index>(per_channel, weights.rows())).reshaped();
}

Eigen::MatrixXd mapped_noise(const BasisRows& rows, const BinnedSamples& samples) {
  Eigen::MatrixXd noise(rows.q.rows(), samples.channels);
  for (Index j = 0; j < noise.rows(); ++j) {
    const Bin& bin = samples.bins[static_cast<std::size_t>(j)];
    for (Index channel = 0; channel < noise.cols(); ++channel) {
      const double slope = rows.weight[j] / (bin.f[channel] * rows.weight[j] + kMappingEpsilon);
      noise(j, channel) = slope * slope * bin.variance[channel];
    }
  }
  return noise;
}

std::vector<Eigen::MatrixXd> noise_covariance(const Basis& basis, const BinnedSamples& samples,
                                              double eta) {
  const BasisRows rows = basis.rows(samples.directions());
  return through_gain(rows, mapped_noise(rows, samples), eta, basis.info().observations,
                      rows.q.cols());
}

std::vector<Eigen::MatrixXd> noise_covariance(const BasisRows& rows, const BinnedSamples& samples,
                                              double eta) {
  return through_gain(rows, mapped_noise(rows, samples), eta, 1, rows.q.cols());
}

}  // namespace brdfgate
