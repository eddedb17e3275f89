// Gaussian-process regression from what one set of directions shows of a material to its weights:
// the estimator `gp` (Rasmussen and Williams 2006, chapter 2; docs/decisions on why and what lost).
//
// The examples are the basis' training observations and its exemplars. Observed values are turned
// into features: their principal components over the examples, within what the basis can say at the
// directions. Two materials are alike by the kernel
//     k(a, b) = 1 + <a, b>_1 + 1/3 sum_j M(|a - b|_j)
//     M(d) = (1 + s) exp(-s), s = sqrt(3) d / 2 (Matern 3/2 of length 2)
// where |.|_j, j = 0, 1, 2, weights the features ever more evenly: from the lobe that dominates the
// variance to details that tell materials apart. Features that errors of single observations reach
// are damped as Wiener's filter does, so that few directions are not believed in every detail. The
// mean runs through the examples smoothly, so that it follows the curved set of real materials,
// which ridge takes for a Gaussian cloud.
//
// A fifth of the answer is ridge's: among materials unlike every example the regression knows no
// better than to follow the nearest ones.
//
// The posterior's shape is that of the errors which the same regression makes on training materials
// that are left out, in all colours and fits and with the exemplars that were made of them, those
// like the observed one counting most. Its scale is the material's own: variances are proportional
// to the misfit of its observations within what the basis can say. So it holds the discrepancy of
// material and model, out of fold, and no constant was fitted to the intervals.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <vector>

#include "model/basis.hpp"

namespace brdfgate {

/// Chosen by cross-validation over the training materials; the error is flat around them
/// (docs/decisions). In one place, so that the tests' simple form has the same.
struct ExampleKernel {
  float linear = 0.3F;
  double length = 2;  ///< of the Matern part
  /// A feature of relative deviation r counts r^(2 (e - 1)) in squared norms.
  std::array<double, 3> norm_exponents{1.0, 0.85, 0.6};
  double least_deviation = 1e-3;  ///< of a feature, relative to the first
  double value_error = 0.2;       ///< of one observation, mapped units: what damps features
  /// Variance of an example's own weights around the process: measured, derived.
  double measured_noise = 0.02;
  double derived_noise = 0.05;
  double ridge_share = 0.2;  ///< of the answer: ridge's
  /// Fewer directions tell less apart: both variances grow by this over their number, if over 1.
  double enough_directions = 60;
  double noise_growth(Eigen::Index directions) const {
    return std::max(1.0, enough_directions / static_cast<double>(directions));
  }
};

class ExampleRegression {
 public:
  /// Trains for one set of directions; a fifth of a second. @pre directions above the horizon, not
  /// empty. Throws InputError for a basis without exemplars.
  ExampleRegression(const Basis& basis, std::vector<HalfDiff> directions);

  struct Prediction {
    Eigen::VectorXd c;           ///< k weights, rows of U
    Eigen::MatrixXd covariance;  ///< k x k
  };
  /// One per column.
  /// @param x  mapped values less the basis' mean at the directions, finite; columns are channels
  std::vector<Prediction> predict(const Eigen::MatrixXd& x) const;
  /// The means alone, k x channels.
  Eigen::MatrixXd mean(const Eigen::MatrixXd& x) const;

  const std::vector<HalfDiff>& directions() const { return directions_; }
  const BasisRows& rows() const { return rows_; }
  /// Per direction: RMS over left-out training materials of x less its prediction, mapped units.
  const Eigen::VectorXd& misfit() const { return misfit_; }
  /// Of the mean square of (x - prediction) / misfit over the directions: its 99 % quantile over
  /// left-out training materials. A material beyond it has structure that the basis lacks.
  double misfit_limit() const { return misfit_limit_; }

 private:
  /// Features in each norm's weighting, so that its squared distances are plain ones.
  struct Weighted {
    std::array<Eigen::MatrixXf, 3> z;        ///< features x materials
    std::array<Eigen::VectorXf, 3> squares;  ///< of each material
  };
  struct Similarity {
    Eigen::MatrixXf kernel;         ///< examples x materials
    Eigen::MatrixXf squared_first;  ///< squared distances |.|_0
  };
  Weighted weighted(const Eigen::MatrixXf& features) const;
  Similarity similarity(const Weighted& z) const;
  void make_features(const Eigen::MatrixXd& x);
  Eigen::MatrixXd left_out_errors(const Eigen::MatrixXf& inverse_l, const Eigen::MatrixXf& a,
                                  const Eigen::MatrixXd& ridge_error) const;
  void learn_errors(const Eigen::MatrixXd& left_out);
  double misfit_within(const Eigen::VectorXd& residual) const;
  Eigen::MatrixXd covariance_near(const Eigen::VectorXf& squared_first, double misfit) const;
  Eigen::MatrixXd answer(const Eigen::MatrixXf& x, const Similarity& s) const;

  std::vector<HalfDiff> directions_;
  BasisRows rows_;
  std::vector<int> material_;     ///< per example: its material, the source's for exemplars, or -1
  Eigen::MatrixXd span_;          ///< directions x features: orthonormal, what the basis can say
  Eigen::MatrixXf projection_;    ///< features x directions
  Eigen::Matrix3Xf gain_;         ///< 3 x features: weights of the three norms
  Weighted examples_;             ///< exemplars first, then the training observations
  Eigen::MatrixXf coefficients_;  ///< k x examples: (K + N)^-1 T, by its share
  Eigen::MatrixXf ridge_gain_;    ///< k x directions: (Q^T Q + eta I)^-1 Q^T, by its share
  Eigen::MatrixXf errors_;        ///< k x observations, over the root of their misfit
  Eigen::MatrixXf mean_shape_;    ///< k x k, mean of their outer products
  Eigen::VectorXd misfit_;
  double misfit_limit_ = 0;
};

}  // namespace brdfgate
