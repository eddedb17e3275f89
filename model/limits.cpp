#include "model/limits.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <random>
#include <vector>

namespace brdfgate {
namespace {

using Random = std::mt19937_64;

double upper_quantile(std::vector<double>& values, double rate) {
  const auto rank = static_cast<std::ptrdiff_t>((1 - rate) * static_cast<double>(values.size()));
  const auto at = values.begin() + std::min<std::ptrdiff_t>(rank, std::ssize(values) - 1);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Normal rows of covariance factor' factor.
void draw(Random& random, const Eigen::MatrixXd& factor, Eigen::MatrixXd& parts) {
  std::normal_distribution<double> normal;
  for (Eigen::Index j = 0; j < parts.cols(); ++j) {
    for (Eigen::Index i = 0; i < parts.rows(); ++i)
      parts(i, j) = normal(random);
  }
  parts *= factor;
}

/// Orthonormal rows: the mean of the first `levels` of p changes, Helmert's contrasts between
/// those, then the others as they are.
Eigen::MatrixXd level_axes(Eigen::Index p, Eigen::Index levels) {
  Eigen::MatrixXd axes = Eigen::MatrixXd::Identity(p, p);
  if (levels < 2) return axes;
  axes.row(0).head(levels).setConstant(1 / std::sqrt(static_cast<double>(levels)));
  for (Eigen::Index k = 1; k < levels; ++k) {
    const auto n = static_cast<double>(k);
    axes.row(k).head(k).setConstant(1 / std::sqrt(n * (n + 1)));
    axes(k, k) = -n / std::sqrt(n * (n + 1));
  }
  return axes;
}

/// Ledoit and Wolf's covariance in units of each column's deviation.
Eigen::MatrixXd shrunk_in_own_units(const Eigen::MatrixXd& observations) {
  const Eigen::MatrixXd x = observations.rowwise() - observations.colwise().mean();
  const Eigen::VectorXd unit =
      (x.colwise().squaredNorm().transpose() / static_cast<double>(x.rows())).cwiseSqrt();
  const Eigen::VectorXd inverse = (unit.array() > 0).select(unit.cwiseInverse(), 0.0);
  return unit.asDiagonal() * ledoit_wolf(x * inverse.asDiagonal()) * unit.asDiagonal();
}

}  // namespace

RateShares split_rate(double per_part, int clusters) {
  constexpr double kStatistics = 0.75;
  return {kStatistics * per_part / (2.0 * std::max(1, clusters)), (1 - kStatistics) * per_part};
}

Eigen::MatrixXd ledoit_wolf(const Eigen::MatrixXd& observations) {
  const auto n = static_cast<double>(observations.rows());
  const auto p = static_cast<double>(observations.cols());
  const Eigen::MatrixXd x = observations.rowwise() - observations.colwise().mean();
  Eigen::MatrixXd s = x.transpose() * x / n;
  const double m = s.trace() / p;  // Lemma 3.2
  const double s2 = s.squaredNorm();
  const double d2 = (s2 - p * m * m) / p;  // Lemma 3.3
  // Lemma 3.4: mean of |x x' - S|^2 = |x|^4 - 2 x'Sx + |S|^2, and x'Sx averages to |S|^2.
  const double fourth = x.rowwise().squaredNorm().array().square().mean();
  const double b2 = std::clamp((fourth - s2) / (n * p), 0.0, std::max(d2, 0.0));
  const double shrinkage = d2 > 0 ? b2 / d2 : 1.0;  // eq. 14
  s *= 1 - shrinkage;
  s.diagonal().array() += shrinkage * m;
  return s;
}

Eigen::MatrixXd shrunk_covariance(const Eigen::MatrixXd& observations, int levels) {
  const Eigen::MatrixXd axes = level_axes(observations.cols(), levels);
  return axes.transpose() * shrunk_in_own_units(observations * axes.transpose()) * axes;
}

double t2_limit(const Eigen::MatrixXd& covariance, int parts, double floor, double rate,
                int levels) {
  constexpr int kEstimates = 4000, kNewParts = 100;
  const Eigen::Index p = covariance.rows();
  // T^2 turns with the axes: all of it along those that the shrinkage takes.
  const Eigen::MatrixXd axes = level_axes(p, levels);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> own(axes * covariance * axes.transpose());
  const Eigen::VectorXd variances = own.eigenvalues().cwiseMax(floor * floor);
  const Eigen::MatrixXd factor =
      variances.cwiseSqrt().asDiagonal() * own.eigenvectors().transpose();
  const double growth = 1 + 1.0 / parts;
  Random random(20040210);
  std::vector<double> t2;
  t2.reserve(std::size_t{kEstimates} * kNewParts);
  Eigen::MatrixXd taught(parts, p), fresh(kNewParts, p);
  for (int k = 0; k < kEstimates; ++k) {
    draw(random, factor, taught);
    draw(random, factor, fresh);
    Eigen::MatrixXd s = factor.transpose() * factor;
    if (parts > 2) {
      s = shrunk_in_own_units(taught);
      s.diagonal().array() += floor * floor;
    }
    const Eigen::LLT<Eigen::MatrixXd> llt(s * growth);
    const Eigen::MatrixXd d = (fresh.rowwise() - taught.colwise().mean()).transpose();
    const Eigen::MatrixXd white = llt.matrixL().solve(d);
    for (Eigen::Index i = 0; i < white.cols(); ++i)
      t2.push_back(white.col(i).squaredNorm());
  }
  return upper_quantile(t2, rate);
}

double box_dof(const Eigen::MatrixXd& standardised) {
  const double n = static_cast<double>(standardised.rows()) - 1;
  const auto columns = static_cast<double>(standardised.cols());
  const Eigen::MatrixXd gram = standardised * standardised.transpose() / n;
  const double trace = gram.trace();
  const double square = n * n / ((n - 1) * (n + 2)) * (gram.squaredNorm() - trace * trace / n);
  if (!(square > trace * trace / columns)) return columns;
  return std::clamp(trace * trace / square, 1.0, columns);
}

double spe_limit(double leave_one_out_mean, double dof, int parts, double rate) {
  constexpr int kDraws = 100000;
  const double below = dof * (parts - 1);
  std::gamma_distribution<double> numerator(dof / 2, 2 / dof);
  std::gamma_distribution<double> denominator(below / 2, 2 / below);
  Random random(19540301);
  std::vector<double> ratio(kDraws);
  for (double& r : ratio) {
    const double above = numerator(random);
    r = above / denominator(random);
  }
  const double mean = below / (std::max(below, 4.0) - 2);
  return std::max(kLeastSpeLimit, leave_one_out_mean * upper_quantile(ratio, rate) / mean);
}

}  // namespace brdfgate
