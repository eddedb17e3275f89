// Gaussian-process regression from what one set of directions shows of a material to its weights:
// the estimator `gp` (Rasmussen and Williams 2006, chapter 2; docs/decisions on why and what lost).
//
// The examples are the basis' training observations and its exemplars. Observed values are turned
// into 40 features, their leading principal components over the examples. Two materials are alike
// by the kernel
//     k(a, b) = 1 + 0.1 <a, b>_1 + 1/3 sum_j M(|a - b|_j),  M(d) = (1 + s) exp(-s), s = sqrt(3) d /
//     2
// (Matern 3/2), where |.|_j, j = 0, 1, 2, weights the features ever more evenly: from the lobe that
// dominates the variance to details that tell materials apart. The mean runs through the examples
// smoothly, so that it follows the curved set of real materials, which ridge takes for a Gaussian
// cloud.
//
// The posterior's scale is the process' own; its shape is that of the errors which the same
// regression makes on training materials that are left out (in all colours and fits), those like
// the observed one counting most. So it holds the discrepancy of material and model, out of fold.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "model/basis.hpp"

namespace brdfgate {

class ExampleRegression {
 public:
  /// Trains for one set of directions; a second or so. @pre directions above the horizon, not empty
  /// Throws InputError for a basis without exemplars.
  ExampleRegression(const Basis& basis, std::vector<HalfDiff> directions);

  struct Prediction {
    Eigen::VectorXd c;           ///< k weights, rows of U
    Eigen::MatrixXd covariance;  ///< k x k
  };
  /// @param x  mapped values less the basis' mean at the directions, finite
  Prediction predict(const Eigen::VectorXd& x) const;
  /// The mean alone.
  Eigen::VectorXd mean(const Eigen::VectorXd& x) const;

  const std::vector<HalfDiff>& directions() const { return directions_; }
  const BasisRows& rows() const { return rows_; }
  /// Per direction: RMS over left-out training materials of x less its prediction, mapped units.
  const Eigen::VectorXd& misfit() const { return misfit_; }
  /// Of the mean square of (x - prediction) / misfit over the directions: its 99.9 % quantile over
  /// left-out training materials. A material beyond it has structure that the basis lacks.
  double misfit_limit() const { return misfit_limit_; }

 private:
  struct Similarity {
    Eigen::VectorXf kernel;         ///< with every example
    Eigen::VectorXf squared_first;  ///< squared distances |.|_0
  };
  Eigen::VectorXf features_of(const Eigen::VectorXd& x) const;
  Similarity similarity(const Eigen::VectorXf& z) const;
  float kernel(const Eigen::VectorXf& a, const Eigen::VectorXf& b) const;
  void make_features(const Eigen::MatrixXd& x);
  void learn_errors(const Eigen::MatrixXd& inverse, const Eigen::MatrixXd& a);
  /// Variance of the process given its nearest examples.
  double local_variance(const Eigen::VectorXf& z, const Eigen::VectorXf& with_all,
                        int left_out) const;

  std::vector<HalfDiff> directions_;
  BasisRows rows_;
  std::vector<int> material_;     ///< per example: its material, the source's for exemplars, or -1
  Eigen::MatrixXf projection_;    ///< features x directions
  Eigen::MatrixXf features_;      ///< features x examples
  Eigen::Matrix3Xf gain_;         ///< 3 x features: squared weights of the three norms
  Eigen::MatrixXf coefficients_;  ///< k x examples: (K + N)^-1 T
  Eigen::MatrixXd errors_;        ///< k x observations, in process deviations
  Eigen::MatrixXd mean_shape_;    ///< k x k, mean of their outer products
  Eigen::VectorXd misfit_;
  double misfit_limit_ = 0;
};

}  // namespace brdfgate
