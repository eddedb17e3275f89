#include "model/example_regression.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <sstream>
#include <string>

#include "model/error.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

// Chosen by cross-validation over the training materials; the error is flat around them
// (docs/decisions).
constexpr int kFeatures = 40;
constexpr float kLinear = 0.1F;
constexpr std::array<double, 3> kNormExponents{1.0, 0.85, 0.6};
constexpr double kLeastDeviation = 1e-3;  // of a feature, relative to the first
/// Variance of an example's own weights around the process: measured, derived.
constexpr double kMeasuredNoise = 0.02;
constexpr double kDerivedNoise = 0.05;
/// As many nearest examples tell the process' variance.
constexpr Index kNeighbours = 48;
/// Left-out errors count by exp(-d^2 / 2 l^2) of their material's distance, and all of them with
/// this share of one.
constexpr float kErrorReach = 0.7F;
constexpr float kErrorBackground = 0.05F;
/// A left-out material still knows the exemplars that were derived from it, so its errors are a
/// little small; variances grow by this, found on materials left out of the basis
/// (tests/rig_accuracy).
constexpr double kErrorGrowth = 1.45;
/// What rounding and grid leave of a row, mapped units: no misfit is taken for smaller.
constexpr double kLeastMisfit = 0.05;
constexpr double kMisfitQuantile = 0.99;

/// Matern 3/2 with length 2, for squared distances.
Eigen::ArrayXXf matern(const Eigen::ArrayXXf& squared) {
  const Eigen::ArrayXXf s = (0.75F * squared.max(0.0F)).sqrt();
  return (1 + s) * (-s).exp();
}

/// Kernel of every two columns of features.
Eigen::MatrixXf kernel_matrix(const Eigen::Matrix3Xf& gain, const Eigen::MatrixXf& features) {
  const Index n = features.cols();
  Eigen::ArrayXXf k = Eigen::ArrayXXf::Ones(n, n);
  for (Index j = 0; j < 3; ++j) {
    const Eigen::MatrixXf z = gain.row(j).cwiseSqrt().asDiagonal() * features;
    Eigen::MatrixXf squared = -2 * z.transpose() * z;
    if (j == 1) k -= 0.5F * kLinear * squared.array();
    const Eigen::VectorXf norms = z.colwise().squaredNorm();
    squared.colwise() += norms;
    squared.rowwise() += norms.transpose();
    k += matern(squared.array()) / 3;
  }
  return k.matrix();
}

/// Names separated by commas.
std::vector<std::string> split(const std::string& names) {
  std::vector<std::string> out;
  std::istringstream in(names);
  for (std::string name; std::getline(in, name, ',');)
    out.push_back(name);
  return out;
}

/// The material's number per training observation: fits of one name are one material.
std::vector<int> materials_of(const BasisInfo& info) {
  std::map<std::string, int> numbers;
  std::vector<int> out;
  for (const std::string& name : split(info.training_set)) {
    const int number = numbers.emplace(name, static_cast<int>(numbers.size())).first->second;
    out.insert(out.end(), 3, number);
  }
  out.resize(static_cast<std::size_t>(info.observations), -1);
  return out;
}

/// Exemplars first, then the training observations, as example_rows() has them.
std::vector<int> materials_of_examples(const Basis& basis) {
  const std::vector<int> trained = materials_of(basis.info());
  std::vector<int> out;
  for (const Exemplar& e : basis.exemplars())
    out.push_back(e.source < 0 ? -1 : trained[static_cast<std::size_t>(e.source)]);
  out.insert(out.end(), trained.begin(), trained.end());
  return out;
}

Eigen::MatrixXd example_weights(const Basis& basis) {
  Eigen::MatrixXd t(basis.exemplar_weights().rows() + basis.training_weights().rows(),
                    basis.info().components);
  t << basis.exemplar_weights(), basis.training_weights();
  return t;
}

double quantile(std::vector<double> values, double q) {
  const auto at = static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<std::size_t>(at)];
}

}  // namespace

ExampleRegression::ExampleRegression(const Basis& basis, std::vector<HalfDiff> directions)
    : directions_(std::move(directions)),
      rows_(basis.rows(directions_)),
      material_(materials_of_examples(basis)) {
  if (basis.exemplars().empty()) {
    throw InputError("method gp", "the basis has no exemplars",
                     "one from brdfgate basis build with --exemplars over 0, or --method ridge");
  }
  if (directions_.empty()) throw InputError("method gp", "no directions", "at least one");
  make_features(example_rows(basis, directions_));
  Eigen::MatrixXd k = kernel_matrix(gain_, features_).cast<double>();
  const auto derived = static_cast<Index>(basis.exemplars().size());
  const Index measured = k.rows() - derived;
  k.diagonal().head(derived).array() += kDerivedNoise;
  k.diagonal().tail(measured).array() += kMeasuredNoise;
  const Eigen::LLT<Eigen::MatrixXd> factor(k);
  const Eigen::MatrixXd a = factor.solve(example_weights(basis));
  coefficients_ = a.transpose().cast<float>();
  // The measured examples come last, so their block of the inverse needs their block of L alone.
  const Eigen::MatrixXd block = factor.matrixLLT().bottomRightCorner(measured, measured);
  const Eigen::MatrixXd inverse_l =
      block.triangularView<Eigen::Lower>().solve(Eigen::MatrixXd::Identity(measured, measured));
  learn_errors(inverse_l.transpose() * inverse_l, a.bottomRows(measured));
}

void ExampleRegression::make_features(const Eigen::MatrixXd& x) {
  const double scale = 1 / std::sqrt(static_cast<double>(x.rows()));
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(
      x * x.transpose() * (scale * scale / static_cast<double>(x.cols())));
  const Index count = std::min<Index>(kFeatures, x.rows());
  const Eigen::MatrixXd axes = solver.eigenvectors().rightCols(count).rowwise().reverse();
  const Eigen::ArrayXd deviation =
      solver.eigenvalues().tail(count).reverse().cwiseMax(0.0).cwiseSqrt();
  const Eigen::ArrayXd relative = (deviation / std::max(deviation[0], 1e-12)).max(kLeastDeviation);
  gain_.resize(3, count);
  for (Index j = 0; j < 3; ++j) {
    const double exponent = 2 * (kNormExponents[static_cast<std::size_t>(j)] - 1);
    gain_.row(j) = relative.pow(exponent).cast<float>().matrix().transpose();
  }
  projection_ = (axes.transpose() * scale).cast<float>();
  features_ = projection_ * x.cast<float>();
}

Eigen::VectorXf ExampleRegression::features_of(const Eigen::VectorXd& x) const {
  return projection_ * x.cast<float>();
}

ExampleRegression::Similarity ExampleRegression::similarity(const Eigen::VectorXf& z) const {
  const Eigen::MatrixXf squares = (features_.colwise() - z).cwiseAbs2();
  const Eigen::MatrixXf distances = squares.transpose() * gain_.transpose();
  const Eigen::VectorXf linear = features_.transpose() * (gain_.row(1).transpose().cwiseProduct(z));
  Similarity s;
  s.kernel =
      (1 + kLinear * linear.array() + matern(distances.array()).rowwise().sum() / 3).matrix();
  s.squared_first = distances.col(0);
  return s;
}

float ExampleRegression::kernel(const Eigen::VectorXf& a, const Eigen::VectorXf& b) const {
  const Eigen::Array3f squared = (gain_ * (a - b).cwiseAbs2()).array();
  return 1 + kLinear * gain_.row(1).dot(a.cwiseProduct(b)) + matern(squared).sum() / 3;
}

double ExampleRegression::local_variance(const Eigen::VectorXf& z, const Eigen::VectorXf& with_all,
                                         int left_out) const {
  std::vector<Index> order;
  for (Index i = 0; i < with_all.size(); ++i) {
    if (left_out < 0 || material_[static_cast<std::size_t>(i)] != left_out) order.push_back(i);
  }
  const Index n = std::min<Index>(kNeighbours, static_cast<Index>(order.size()));
  std::nth_element(order.begin(), order.begin() + (n - 1), order.end(),
                   [&](Index a, Index b) { return with_all[a] > with_all[b]; });
  const Eigen::MatrixXf near =
      features_(Eigen::all, std::vector<Index>(order.begin(), order.begin() + n));
  Eigen::MatrixXf noisy = kernel_matrix(gain_, near);
  noisy.diagonal().array() += static_cast<float>(kDerivedNoise);
  Eigen::VectorXf with(n);
  for (Index i = 0; i < n; ++i)
    with[i] = with_all[order[static_cast<std::size_t>(i)]];
  const Eigen::LLT<Eigen::MatrixXf> factor(noisy);
  return std::max(0.0F, kernel(z, z) - with.dot(factor.solve(with)));
}

void ExampleRegression::learn_errors(const Eigen::MatrixXd& inverse, const Eigen::MatrixXd& a) {
  const Index measured = inverse.rows();
  const Index first = features_.cols() - measured;
  std::map<int, std::vector<Index>> blocks;
  for (Index i = 0; i < measured; ++i)
    blocks[material_[static_cast<std::size_t>(first + i)]].push_back(i);
  Eigen::MatrixXd left_out(measured, a.cols());
  for (const auto& [material, block] : blocks) {
    const Eigen::MatrixXd own = inverse(block, block);
    const Eigen::MatrixXd weights = a(block, Eigen::all);
    const Eigen::MatrixXd error = own.llt().solve(weights);
    left_out(block, Eigen::all) = error;
  }
  const Eigen::MatrixXd residual = rows_.q * left_out.transpose();
  misfit_ =
      (residual.rowwise().squaredNorm().array() / double(measured) + kLeastMisfit * kLeastMisfit)
          .sqrt();
  std::vector<double> squares;
  for (Index i = 0; i < measured; ++i)
    squares.push_back(residual.col(i).cwiseQuotient(misfit_).squaredNorm() /
                      double(misfit_.size()));
  misfit_limit_ = quantile(std::move(squares), kMisfitQuantile);
  errors_ = left_out.transpose();
  for (Index i = 0; i < measured; ++i) {
    const Eigen::VectorXf z = features_.col(first + i);
    const double v =
        local_variance(z, similarity(z).kernel, material_[static_cast<std::size_t>(first + i)]);
    errors_.col(i) /= std::sqrt(v + kMeasuredNoise);
  }
  mean_shape_ = errors_ * errors_.transpose() / double(measured);
}

Eigen::VectorXd ExampleRegression::mean(const Eigen::VectorXd& x) const {
  return (coefficients_ * similarity(features_of(x)).kernel).cast<double>();
}

ExampleRegression::Prediction ExampleRegression::predict(const Eigen::VectorXd& x) const {
  const Eigen::VectorXf z = features_of(x);
  const Similarity s = similarity(z);
  const double scale = local_variance(z, s.kernel, -1) + kMeasuredNoise;
  const Index measured = errors_.cols();
  const Eigen::VectorXf near =
      (s.squared_first.tail(measured) * (-0.5F / (kErrorReach * kErrorReach))).array().exp();
  constexpr float kNegligible = 1e-3F;
  double total = kErrorBackground * double(measured);
  Eigen::MatrixXd shape = total * mean_shape_;
  for (Index i = 0; i < measured; ++i) {
    if (near[i] < kNegligible) continue;
    shape.selfadjointView<Eigen::Lower>().rankUpdate(errors_.col(i), double(near[i]));
    total += near[i];
  }
  Prediction p;
  p.c = (coefficients_ * s.kernel).cast<double>();
  p.covariance = shape.selfadjointView<Eigen::Lower>();
  p.covariance *= kErrorGrowth * scale / total;
  return p;
}

}  // namespace brdfgate
