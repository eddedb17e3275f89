// Fits of the analytic models (model/lobes.hpp) to reflectance: few samples or a whole table.
//
// Residuals are in the mapped units of C.IV, ln((f_model w + e) / (f w + e)) with w the cosine
// weight: the model's and the observation's distance to any common reference cancels. C.I fits
// with the L1 norm in three stages, so that the fit follows the highlight's base and does not
// depend on the first guess; logarithm and cosine weight are ours (method.md section 9).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "model/lobes.hpp"
#include "model/samples.hpp"

namespace brdfgate {

/// A fitted model and how far it is from its samples, in mapped units.
struct LobeFit {
  Lobe lobe;
  double mapped_l1 = 0;   ///< mean absolute residual over bins and channels
  double mapped_rms = 0;  ///< RMS of the residual
};

struct LobeFitOptions {
  /// Error of one observation beside its pixel noise, mapped units: a bin whose noise is large
  /// against it counts less. Default: the ridge's, sqrt(40 / 300).
  double discrepancy = 0.365;
  /// After C.I's three stages, all parameters together (C.I leaves the diffuse level as it came out
  /// of the first stage, where the lobe was a guess). false: the paper's stages alone.
  bool polish = true;
};

/// C.I's fit: (i) rho_d and k_s, (ii) the shape, (iii) the shape and k_s; smoothed L1, from every
/// start of the model's description (on some 300 of the bins, then from the best on all).
/// Deterministic. Mono samples give three equal channels. Throws InputError as ridge() does: no
/// bins, f negative or not finite, directions below the horizon; or a discrepancy that is not over
/// 0.
LobeFit fit_lobe(LobeModel model, const BinnedSamples& samples, const LobeFitOptions& options = {});

/// The model with the smallest mean absolute residual; the first such one in lobe_models().
LobeFit fit_best_lobe(const BinnedSamples& samples, const LobeFitOptions& options = {});

/// Gaussian view of the same fit, for comparing models by their evidence.
struct LobePosterior {
  LobeFit fit;              ///< at the posterior's maximum
  double log_evidence = 0;  ///< of the logarithms ln(f w + e), nats; Laplace's approximation
  double chi_square = 0;    ///< sum of squared residuals in deviations
  int parameters = 0;
};

/// Maximum of the posterior under Gaussian errors of variance `discrepancy`^2 + the bin's mapped
/// pixel noise and the priors of the model's description (log-normal; normal where linear), found
/// from the L1 fit, with Laplace's approximation of the evidence. A bound that the maximum sits on
/// is not corrected for.
/// Throws InputError as fit_lobe().
LobePosterior lobe_posterior(LobeModel model, const BinnedSamples& samples,
                             const LobeFitOptions& options = {});

/// ln(f w + e) of the samples and its standard deviation from pixel noise and discrepancy, bins x
/// channels: what the two above compare with. Throws InputError as fit_lobe().
struct LogObservations {
  Eigen::MatrixXd value;
  Eigen::MatrixXd sigma;
  Eigen::VectorXd weight;  ///< w per bin
};
LogObservations log_observations(const BinnedSamples& samples, double discrepancy);

}  // namespace brdfgate
