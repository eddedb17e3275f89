// One cluster of one part in plain numbers: what teaching and judging compare (method.md section
// 8).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "model/basis.hpp"
#include "model/estimator.hpp"
#include "model/samples.hpp"

namespace brdfgate {

/// Everything that T^2 and SPE need; no basis in it any more.
struct ClusterObservation {
  Eigen::MatrixXd weights;          ///< prior sigmas, k x channels
  Eigen::VectorXd monitored;        ///< p: along the monitored directions (monitored.hpp)
  int levels = 0;                   ///< the first so many of them are channels' diffuse levels
  Eigen::MatrixXd monitored_noise;  ///< p x p covariance of `monitored`: pixel noise and the place
  std::vector<int> bin_id;
  std::vector<HalfDiff> angles;    ///< of those bins
  Eigen::MatrixXd residual;        ///< bins x channels, mapped, what the directions leave
  Eigen::MatrixXd residual_noise;  ///< bins x channels, variance of that from pixel noise
  int channels() const { return static_cast<int>(residual.cols()); }
};

/// Leading weights, channel by channel: p of them per channel.
Eigen::VectorXd leading_weights(const Eigen::MatrixXd& weights, int per_channel);

/// Variance of mapped observations from Bin::variance, bins x channels: (w / (f w + e))^2 var f.
Eigen::MatrixXd mapped_noise(const BasisRows& rows, const BinnedSamples& samples);

/// Covariance per channel, k x k and in prior sigmas, that pixel noise gives the ridge weights: the
/// noise through the ridge gain, m M diag(var) M^T with M = (Q^T Q + eta I)^-1 Q^T. Unlike the
/// ridge's posterior it holds no model discrepancy: the discrepancy (eta stands for it) is a
/// property of the material, the same in every part of one kind, and cancels in a comparison of two
/// parts.
std::vector<Eigen::MatrixXd> noise_covariance(const Basis& basis, const BinnedSamples& samples,
                                              double eta = kRidgeEta);
/// The same of the weights c, not in prior sigmas, with the basis' rows at hand.
std::vector<Eigen::MatrixXd> noise_covariance(const BasisRows& rows, const BinnedSamples& samples,
                                              double eta);

}  // namespace brdfgate
