// From binned reflectance to principal-component weights.
#pragma once

#include <Eigen/Core>

#include "model/basis.hpp"
#include "model/samples.hpp"

namespace brdfgate {

/// Ridge parameter of C.IV and C.VI. As a Gaussian model it says that one observation errs by
/// sqrt(eta / m) in mapped units (method.md section 4).
inline constexpr double kRidgeEta = 40.0;

/// Weights of one material in the basis, per colour channel, with their posterior.
struct Weights {
  Eigen::MatrixXd c;                        ///< k x channels, C.IV eq. 12
  std::vector<Eigen::MatrixXd> covariance;  ///< k x k per channel, of c
  double residual_rms = 0;                  ///< mapped units, over bins and channels
  /// Per channel: what the weights leave unexplained, over what they should at most. ridge: RMS
  /// over sqrt(eta / m); gp: mean square in misfits over its limit (example_regression.hpp).
  Eigen::VectorXd misfit;
  int rows = 0;  ///< n, the bins used
  /// Correlation of the channels' errors, channels x channels; empty: independent.
  Eigen::MatrixXd channel_correlation;

  /// Weights in prior sigmas: c * sqrt(m), the form every interface publishes.
  Eigen::MatrixXd in_prior_sigmas(int observations) const;
  /// Posterior standard deviations in prior sigmas, k x channels.
  Eigen::MatrixXd sigmas_in_prior_sigmas(int observations) const;
};

/// The papers' estimator, exactly: c = (Q~^T Q~ + eta I)^-1 Q~^T (x~ - mu~), all k components.
/// Its covariance is that of the Gaussian model with prior N(0, I/m) and error variance eta/m:
/// eta/m (Q~^T Q~ + eta I)^-1.
/// @pre bins not empty, each f finite and not negative, directions above the horizon.
/// Throws InputError otherwise.
Weights ridge(const Basis& basis, const BinnedSamples& samples, double eta = kRidgeEta);

/// Correlation of the channels' errors: most of an error is the model's discrepancy, which the
/// channels of one material share, the more the nearer their mapped values are. 0.6 + 0.4 exp(-d /
/// 0.3), d their RMS distance: about as left-out materials have it (docs/readings.md).
/// @param x  mapped values, directions x channels
Eigen::MatrixXd channel_correlation(const Eigen::MatrixXd& x);

/// Throws InputError unless bins are there, finite, not negative and above the horizon.
void check_samples(const BinnedSamples& samples);

/// Mapped observations less the mean: x~ - mu~, n x channels.
Eigen::MatrixXd centred(const BinnedSamples& samples, const BasisRows& rows);

/// Mapped observations minus the model at the bins: n x channels (the residual behind SPE).
Eigen::MatrixXd mapped_residual(const Basis& basis, const BinnedSamples& samples, const Weights& w);

}  // namespace brdfgate
