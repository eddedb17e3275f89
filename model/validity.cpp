#include "model/validity.hpp"

#include <cmath>
#include <string>

#include "model/error.hpp"

namespace brdfgate {

double chi_square_limit(int degrees) {
  constexpr double kNormalQuantile = 3.0902323061678132;  // 99.9 %
  const double spread = 2.0 / (9.0 * degrees);
  return degrees * std::pow(1 - spread + kNormalQuantile * std::sqrt(spread), 3);
}

Validity validity(const Basis& basis, const Weights& weights) {
  const int k = basis.info().components;
  if (weights.c.rows() != k || weights.covariance.size() != std::size_t(weights.c.cols())) {
    throw InputError("weights", std::to_string(weights.c.rows()) + " components",
                     std::to_string(k));
  }
  const double m = basis.info().observations;
  Validity v;
  v.seen.resize(k, weights.c.cols());
  for (Eigen::Index channel = 0; channel < weights.c.cols(); ++channel) {
    const Eigen::MatrixXd& covariance = weights.covariance[static_cast<std::size_t>(channel)];
    v.seen.col(channel) = (1 - m * covariance.diagonal().array()).max(0.0).min(1.0).matrix();
  }
  v.mahalanobis_ratio = m * weights.c.colwise().squaredNorm().transpose() / chi_square_limit(k);
  v.misfit_ratio = weights.misfit;
  return v;
}

}  // namespace brdfgate
