// The regression of the estimator `gp` as its header states it, in double precision and one loop a
// formula: the oracle of model/example_regression.cpp.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>
#include <vector>

#include "model/estimator.hpp"
#include "model/example_regression.hpp"
#include "model/exemplars.hpp"

namespace brdfgate::test {

class SimpleRegression {
 public:
  SimpleRegression(const Basis& basis, const std::vector<HalfDiff>& directions,
                   const ExampleKernel& constants = {})
      : constants_(constants) {
    const Eigen::MatrixXd x = example_rows(basis, directions);
    const Eigen::MatrixXd q = basis.rows(directions).q;
    make_projection(q, x);
    const Eigen::MatrixXd normal =
        q.transpose() * q + kRidgeEta * Eigen::MatrixXd::Identity(q.cols(), q.cols());
    ridge_gain_ = normal.inverse() * q.transpose();
    for (Eigen::Index i = 0; i < x.cols(); ++i)
      examples_.push_back(projection_ * x.col(i));
    const auto derived = static_cast<Eigen::Index>(basis.exemplars().size());
    Eigen::MatrixXd t(x.cols(), basis.info().components);
    t << basis.exemplar_weights(), basis.training_weights();
    Eigen::MatrixXd k(x.cols(), x.cols());
    for (Eigen::Index i = 0; i < k.rows(); ++i) {
      for (Eigen::Index j = 0; j < k.cols(); ++j)
        k(i, j) = kernel(examples_[std::size_t(i)], examples_[std::size_t(j)]);
      k(i, i) += constants_.noise_growth(x.rows()) *
                 (i < derived ? constants_.derived_noise : constants_.measured_noise);
    }
    coefficients_ = k.llt().solve(t);
  }

  /// k weights for one channel's mapped values less the basis' mean.
  Eigen::VectorXd mean(const Eigen::VectorXd& x) const {
    const Eigen::VectorXd z = projection_ * x;
    Eigen::VectorXd with(coefficients_.rows());
    for (Eigen::Index i = 0; i < with.size(); ++i)
      with[i] = kernel(examples_[std::size_t(i)], z);
    return (1 - constants_.ridge_share) * coefficients_.transpose() * with +
           constants_.ridge_share * ridge_gain_ * x;
  }

 private:
  void make_projection(const Eigen::MatrixXd& q, const Eigen::MatrixXd& x) {
    const double n = double(x.rows());
    const Eigen::Index count = std::min(q.rows(), q.cols());
    const Eigen::MatrixXd span =
        q.householderQr().householderQ() * Eigen::MatrixXd::Identity(q.rows(), count);
    const Eigen::MatrixXd inside = span.transpose() * x / std::sqrt(n);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(inside * inside.transpose() /
                                                                double(x.cols()));
    projection_.resize(count, x.rows());
    weight_.resize(count, 3);
    for (Eigen::Index i = 0; i < count; ++i) {
      const Eigen::Index at = count - 1 - i;
      const double variance = std::max(0.0, solver.eigenvalues()[at]);
      const double most = solver.eigenvalues()[count - 1];
      const double relative = std::max(constants_.least_deviation, std::sqrt(variance / most));
      for (std::size_t j = 0; j < 3; ++j)
        weight_(i, Eigen::Index(j)) = std::pow(relative, 2 * (constants_.norm_exponents[j] - 1));
      const double damping =
          variance / (variance + constants_.value_error * constants_.value_error / n);
      projection_.row(i) =
          std::sqrt(damping / n) * (span * solver.eigenvectors().col(at)).transpose();
    }
  }

  double kernel(const Eigen::VectorXd& a, const Eigen::VectorXd& b) const {
    double sum = 1;
    for (std::size_t j = 0; j < 3; ++j) {
      double squared = 0;
      double product = 0;
      for (Eigen::Index i = 0; i < a.size(); ++i) {
        const double weight = weight_(i, Eigen::Index(j));
        squared += weight * (a[i] - b[i]) * (a[i] - b[i]);
        product += weight * a[i] * b[i];
      }
      const double s = std::sqrt(3 * squared) / constants_.length;
      sum += (1 + s) * std::exp(-s) / 3;
      if (j == 1) sum += double(constants_.linear) * product;
    }
    return sum;
  }

  ExampleKernel constants_;
  Eigen::MatrixXd projection_;
  Eigen::MatrixXd weight_;  ///< features x norms: of a feature's square
  std::vector<Eigen::VectorXd> examples_;
  Eigen::MatrixXd coefficients_;
  Eigen::MatrixXd ridge_gain_;
};

}  // namespace brdfgate::test
