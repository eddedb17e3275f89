// From a few measured directions to all the others: the product's estimators beside analytic fits
// and interpolation, on the same directions.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "model/basis.hpp"
#include "model/samples.hpp"

namespace brdfgate {

/// How far one method's predictions are from the measurements, in mapped units:
/// ln((f_predicted w + e) / (f w + e)).
struct PredictionError {
  std::string method;
  double mapped_rms = 0;             ///< mean of the channels'
  std::array<double, 3> channels{};  ///< RMS per channel (mono: [0] only)
  double median = 0;                 ///< of the absolute errors, all channels
  std::string failed = {};           ///< why there is no figure; empty where there is one
};

/// The known value nearest to each direction: the smallest Euclidean distance in (sqrt(theta_h /
/// 90 deg), theta_d / 90 deg, |phi_d - phi_d'| / 90 deg sqrt(sin(theta_d) sin(theta_d'))), phi_d
/// differing by at most 90 degrees (it is periodic over 180). MERL's spacing for theta_h;
/// sin(theta_d) because phi_d means nothing at theta_d = 0. A tie goes to the first. @pre known is
/// not empty
std::vector<Eigen::Array3d> nearest_neighbour(const BinnedSamples& known,
                                              const std::vector<HalfDiff>& directions);

/// Predicts every sample that is not among `known` (indices into `all`) from those that are: by
/// each of estimator_names(), by fits of each analytic model ("ggx (L1)": fit_lobe(), "ggx (L2)":
/// lobe_posterior(), least squares with the prior), and by the nearest neighbour, in this order.
/// Throws InputError for samples ridge() refuses, an index beyond them, none left to predict.
std::vector<PredictionError> predict_the_others(const std::shared_ptr<const Basis>& basis,
                                                const BinnedSamples& all,
                                                const std::vector<std::size_t>& known);

}  // namespace brdfgate
