// How good a set of directions is for measuring an unknown material with a basis: the condition
// number of C.IV section 4 and the expected error of C.VI eq. 15, both without a vector of the
// length of the BRDF.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "model/basis.hpp"
#include "model/estimator.hpp"

namespace brdfgate {

/// What the two figures need of a basis. With X - mu = U S V^T and Q = V S, |Q z| = |S z| because V
/// is orthonormal, and Q^+ y_i is row i of U for a training observation y_i.
struct DesignBasis {
  std::shared_ptr<const Basis> basis;  ///< rows of Q at any direction
  Eigen::MatrixXd u;                   ///< k x m, training observations' weights, one per column
  /// k, singular values over the square root of the basis' cells: |s * z| is an RMS per cell, in
  /// mapped units.
  Eigen::VectorXd s;
  Eigen::VectorXd unseen;  ///< m, |s * u_i|^2: the error of knowing nothing, squared
  double eta = kRidgeEta;  ///< ridge parameter of C.IV eq. 12

  Eigen::Index components() const { return u.rows(); }
};

/// The first `components` of a basis (0: all). Throws InputError for an eta that is not above 0 or
/// more components than there are.
DesignBasis make_design_basis(std::shared_ptr<const Basis> basis, int components = 0,
                              double eta = kRidgeEta);

/// Rows of Q~ at these directions, n x k: Basis::rows() cut to the design's components.
Eigen::MatrixXd design_rows(const DesignBasis& basis, const std::vector<HalfDiff>& directions);

/// What measurements add up to: Q~^T Q~ and Q~^T 1. Those of two images add.
struct Information {
  Eigen::MatrixXd gram;  ///< k x k
  Eigen::VectorXd sum;   ///< k
  int rows = 0;          ///< n, directions

  static Information none(Eigen::Index components);
  static Information of(const Eigen::MatrixXd& q);
  Information& operator+=(const Information& other);
};

/// C.VI eq. 15 in mapped units, root mean square per cell of the basis.
struct ExpectedError {
  /// Mean over the training observations of what is left of them after estimating them from these
  /// directions (first term).
  double reconstruction = 0;
  /// Error caused by an error of 1 mapped unit common to all directions (second term, beta = 1).
  double noise_gain = 0;

  double total(double beta) const { return reconstruction + beta * noise_gain; }
};

/// Any number of rows: k x k work. I - M Q~ = eta (Q~^T Q~ + eta I)^-1.
ExpectedError expected_error(const DesignBasis& basis, const Information& information);

/// One direction with everything that expected_error() of few directions needs of it.
struct DesignPoint {
  Eigen::RowVectorXd q;        ///< k, row of Q
  Eigen::RowVectorXd seen;     ///< m, q U: the training observations there
  Eigen::RowVectorXd covered;  ///< m, q S^2 U
};
DesignPoint make_design_point(const DesignBasis& basis, const HalfDiff& direction);

/// The same error for n < k directions in n x n work, by M = Q~^T (Q~ Q~^T + eta I)^-1.
ExpectedError expected_error(const DesignBasis& basis,
                             const std::vector<const DesignPoint*>& points);

/// kappa(Q~) = largest over smallest of its min(n, k) singular values (C.IV eq. 8); infinity where
/// Q~ is deficient in rank to working precision (from about 1e7 on) or has no rows.
double condition_number(const Information& information);
double condition_number(const std::vector<const DesignPoint*>& points);

}  // namespace brdfgate
