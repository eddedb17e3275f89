// What a reconstruction can be trusted for: which weights the directions could see, and whether the
// material is one the basis can describe (thesis, C.V sections 2 and 3; method.md section 4).
#pragma once

#include <Eigen/Core>

#include "model/basis.hpp"
#include "model/estimator.hpp"

namespace brdfgate {

struct Validity {
  /// k x channels, 0..1: one less posterior over prior variance. Near 0 the directions said nothing
  /// of the weight and it is the prior's.
  Eigen::MatrixXd seen;
  /// Per channel: m c^T c over the 99.9 % quantile of chi-square with k degrees of freedom. Beyond
  /// 1 the weights are implausible under the training set's Gaussian (C.V's gate).
  Eigen::VectorXd mahalanobis_ratio;
  /// Weights::misfit, per channel: beyond 1 the basis lacks structure that the material has.
  Eigen::VectorXd misfit_ratio;
  bool outside_basis() const {
    return !(mahalanobis_ratio.size() > 0 && mahalanobis_ratio.maxCoeff() <= 1 &&
             misfit_ratio.maxCoeff() <= 1);
  }
};

/// Throws InputError where the weights are not of this basis.
Validity validity(const Basis& basis, const Weights& weights);

/// Quantile 99.9 % of chi-square (Wilson and Hilferty 1931; 3 % high at one degree, under 0.7 %
/// from ten on).
double chi_square_limit(int degrees);

}  // namespace brdfgate
