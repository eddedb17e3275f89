#include "model/design.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "model/error.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// sqrt(largest / rank-th largest) of a positive semidefinite matrix' eigenvalues.
double condition_of(const MatrixXd& gram, Index rank) {
  if (rank < 1) return kInfinity;
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(gram, Eigen::EigenvaluesOnly);
  const VectorXd& rising = solver.eigenvalues();
  const double largest = rising[rising.size() - 1];
  const double smallest = rising[rising.size() - rank];
  const double rounding =
      static_cast<double>(gram.rows()) * std::numeric_limits<double>::epsilon() * largest;
  return smallest > rounding ? std::sqrt(largest / smallest) : kInfinity;
}

}  // namespace

DesignBasis make_design_basis(std::shared_ptr<const Basis> basis, int components, double eta) {
  const int all = basis->info().components;
  if (components < 0 || components > all) {
    throw InputError("components", std::to_string(components),
                     "1 to the basis' " + std::to_string(all) + ", or 0 for all");
  }
  if (!(eta > 0 && std::isfinite(eta))) {
    throw InputError("eta", std::to_string(eta), "a finite number above 0");
  }
  const Index k = components == 0 ? all : components;
  DesignBasis design;
  design.u = basis->training_weights().leftCols(k).transpose();
  design.s =
      basis->singular_values().head(k) / std::sqrt(static_cast<double>(basis->info().valid_cells));
  design.unseen = (design.s.asDiagonal() * design.u).colwise().squaredNorm().transpose();
  design.eta = eta;
  design.basis = std::move(basis);
  return design;
}

MatrixXd design_rows(const DesignBasis& basis, const std::vector<HalfDiff>& directions) {
  return basis.basis->rows(directions).q.leftCols(basis.components());
}

Information Information::none(Index components) {
  return {MatrixXd::Zero(components, components), VectorXd::Zero(components), 0};
}

Information Information::of(const MatrixXd& q) {
  Information information = none(q.cols());
  constexpr Index kBlock = 256;  // rows that fit the cache together
  for (Index first = 0; first < q.rows(); first += kBlock) {
    const auto block = q.middleRows(first, std::min(kBlock, q.rows() - first));
    information.gram.noalias() += block.transpose() * block;
  }
  information.sum = q.colwise().sum().transpose();
  information.rows = static_cast<int>(q.rows());
  return information;
}

Information& Information::operator+=(const Information& other) {
  gram += other.gram;
  sum += other.sum;
  rows += other.rows;
  return *this;
}

ExpectedError expected_error(const DesignBasis& basis, const Information& information) {
  const Index k = basis.components();
  MatrixXd regularised = information.gram;
  regularised.diagonal().array() += basis.eta;
  const Eigen::LLT<MatrixXd> cholesky(regularised);
  const MatrixXd inverse = basis.s.asDiagonal() * cholesky.solve(MatrixXd::Identity(k, k));
  const MatrixXd missed = inverse * basis.u;
  return {basis.eta * missed.colwise().norm().mean(), (inverse * information.sum).norm()};
}

DesignPoint make_design_point(const DesignBasis& basis, const HalfDiff& direction) {
  DesignPoint point;
  point.q = design_rows(basis, {direction});
  point.seen = point.q * basis.u;
  point.covered = point.q.cwiseProduct(basis.s.transpose().cwiseAbs2()) * basis.u;
  return point;
}

ExpectedError expected_error(const DesignBasis& basis,
                             const std::vector<const DesignPoint*>& points) {
  const auto n = static_cast<Index>(points.size());
  const Index m = basis.u.cols();
  MatrixXd q(n, basis.components());
  MatrixXd seen(n, m);
  MatrixXd covered(n, m);
  for (Index j = 0; j < n; ++j) {
    const DesignPoint& point = *points[static_cast<std::size_t>(j)];
    q.row(j) = point.q;
    seen.row(j) = point.seen;
    covered.row(j) = point.covered;
  }
  MatrixXd gram = q * q.transpose();
  gram.diagonal().array() += basis.eta;
  const Eigen::LLT<MatrixXd> cholesky(gram);
  const MatrixXd scaled = q * basis.s.asDiagonal();
  // |S u|^2 - 2 (S u) . (S Q~^T a) + |S Q~^T a|^2 with a = (Q~ Q~^T + eta I)^-1 Q~ u.
  const MatrixXd a = cholesky.solve(seen);
  const Eigen::ArrayXd cross = a.cwiseProduct(covered).colwise().sum().transpose();
  const Eigen::ArrayXd gain =
      a.cwiseProduct((scaled * scaled.transpose()) * a).colwise().sum().transpose();
  const VectorXd ones = cholesky.solve(VectorXd::Ones(n));
  return {(basis.unseen.array() - 2 * cross + gain).max(0.0).sqrt().mean(),
          (scaled.transpose() * ones).norm()};
}

double condition_number(const Information& information) {
  const Index rank = std::min<Index>(information.rows, information.gram.rows());
  return condition_of(information.gram, rank);
}

double condition_number(const std::vector<const DesignPoint*>& points) {
  if (points.empty()) return kInfinity;
  const auto n = static_cast<Index>(points.size());
  const Index k = points.front()->q.size();
  MatrixXd q(n, k);
  for (Index j = 0; j < n; ++j)
    q.row(j) = points[static_cast<std::size_t>(j)]->q;
  if (n > k) return condition_of(q.transpose() * q, k);
  return condition_of(q * q.transpose(), n);
}

}  // namespace brdfgate
