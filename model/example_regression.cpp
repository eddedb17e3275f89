#include "model/example_regression.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
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

constexpr ExampleKernel kKernel;
/// As many nearest examples tell the process' variance.
constexpr Index kNeighbours = 48;
/// Left-out errors count by exp(-d^2 / 2 l^2) of their material's distance, and all of them with
/// this share of one.
constexpr float kErrorReach = 0.7F;
constexpr float kErrorBackground = 0.05F;
/// A left-out material still knows the exemplars that were derived from it, so its errors are a
/// little small; variances grow by this, found on materials left out of the basis
/// (tests/rig_accuracy).
constexpr double kErrorGrowth = 1.8;
/// What rounding and grid leave of a row, mapped units: no misfit is taken for smaller.
constexpr double kLeastMisfit = 0.05;
constexpr double kMisfitQuantile = 0.99;

/// Matern 3/2 with length 2, for squared distances.
void add_matern(const Eigen::Ref<const Eigen::MatrixXf>& squared, Eigen::Ref<Eigen::MatrixXf> sum) {
  for (Index j = 0; j < squared.cols(); ++j) {
    const Eigen::ArrayXf s = (0.75F * squared.col(j).array().max(0.0F)).sqrt();
    sum.col(j).array() += (1.0F / 3) * (1 + s) * (-s).exp();
  }
}

/// <a, b> of every two columns turned into |a - b|^2.
void to_squared_distances(const Eigen::VectorXf& squares_a, const Eigen::VectorXf& squares_b,
                          Eigen::MatrixXf& products) {
  products *= -2;
  products.colwise() += squares_a;
  products.rowwise() += squares_b.transpose();
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

/// The examples most alike to one, of those that `among` lets in.
template <typename Among>
std::vector<Index> nearest(const Eigen::Ref<const Eigen::VectorXf>& with_all, Among&& among) {
  std::vector<Index> order;
  for (Index i = 0; i < with_all.size(); ++i) {
    if (among(i)) order.push_back(i);
  }
  const Index n = std::min<Index>(kNeighbours, static_cast<Index>(order.size()));
  std::nth_element(order.begin(), order.begin() + (n - 1), order.end(),
                   [&](Index a, Index b) { return with_all[a] > with_all[b]; });
  order.resize(static_cast<std::size_t>(n));
  return order;
}

/// Variance of a process at a point, given noisy values at others (Rasmussen & Williams eq. 2.26).
double given(Eigen::MatrixXf kernel, const Eigen::VectorXf& with, float itself) {
  kernel.diagonal().array() += static_cast<float>(kKernel.derived_noise);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXf>> factor(kernel);
  const Eigen::VectorXf half = factor.matrixL().solve(with);
  return std::max(0.0F, itself - half.squaredNorm());
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
  const Eigen::MatrixXf kernel = similarity(examples_).kernel;
  const auto derived = static_cast<Index>(basis.exemplars().size());
  const Index measured = kernel.rows() - derived;
  const double growth = kKernel.noise_growth(rows_.q.rows());
  Eigen::MatrixXf noisy = kernel;
  noisy.diagonal().head(derived).array() += static_cast<float>(growth * kKernel.derived_noise);
  noisy.diagonal().tail(measured).array() += static_cast<float>(growth * kKernel.measured_noise);
  // Single precision: the noise keeps the smallest eigenvalue a hundred times above its rounding.
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXf>> factor(noisy);
  const Eigen::MatrixXf a = factor.solve(example_weights(basis).cast<float>());
  coefficients_ = a.transpose();
  // The measured examples come last, so their block of the inverse needs their block of L alone.
  const Eigen::MatrixXf block = noisy.bottomRightCorner(measured, measured);
  const Eigen::MatrixXf inverse_l =
      block.triangularView<Eigen::Lower>().solve(Eigen::MatrixXf::Identity(measured, measured));
  learn_errors(kernel, inverse_l, a.bottomRows(measured));
}

void ExampleRegression::make_features(const Eigen::MatrixXd& x) {
  const auto n = static_cast<double>(x.rows());
  const Index count = std::min(rows_.q.rows(), rows_.q.cols());
  // An orthonormal base of what the basis can say at the directions.
  const Eigen::MatrixXd span = Eigen::HouseholderQR<Eigen::MatrixXd>(rows_.q).householderQ() *
                               Eigen::MatrixXd::Identity(rows_.q.rows(), count);
  const Eigen::MatrixXd inside = span.transpose() * x / std::sqrt(n);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(inside * inside.transpose() /
                                                              double(x.cols()));
  const Eigen::MatrixXd axes = solver.eigenvectors().rowwise().reverse();
  const Eigen::ArrayXd variance = solver.eigenvalues().reverse().cwiseMax(0.0);
  const Eigen::ArrayXd relative =
      (variance / std::max(variance[0], 1e-24)).sqrt().max(kKernel.least_deviation);
  gain_.resize(3, count);
  for (Index j = 0; j < 3; ++j) {
    const double exponent = kKernel.norm_exponents[static_cast<std::size_t>(j)] - 1;
    gain_.row(j) = relative.pow(exponent).cast<float>().matrix().transpose();
  }
  const double error = kKernel.value_error * kKernel.value_error / n;
  const Eigen::ArrayXd damping = (variance / (variance + error)).sqrt();
  const Eigen::MatrixXd to_features = damping.matrix().asDiagonal() * axes.transpose();
  projection_ = (to_features * span.transpose() / std::sqrt(n)).cast<float>();
  examples_ = weighted((to_features * inside).cast<float>());
}

ExampleRegression::Weighted ExampleRegression::weighted(const Eigen::MatrixXf& features) const {
  Weighted w;
  for (std::size_t j = 0; j < 3; ++j) {
    w.z[j] = gain_.row(static_cast<Index>(j)).asDiagonal() * features;
    w.squares[j] = w.z[j].colwise().squaredNorm();
  }
  return w;
}

ExampleRegression::Similarity ExampleRegression::similarity(const Weighted& z) const {
  Similarity s;
  s.kernel.setOnes(examples_.z[0].cols(), z.z[0].cols());
  for (std::size_t j = 0; j < 3; ++j) {
    Eigen::MatrixXf squared = examples_.z[j].transpose() * z.z[j];
    if (j == 1) s.kernel += kKernel.linear * squared;
    to_squared_distances(examples_.squares[j], z.squares[j], squared);
    add_matern(squared, s.kernel);
    if (j == 0) s.squared_first = std::move(squared);
  }
  return s;
}

/// Variance of the process given its nearest examples.
double ExampleRegression::variance_near(const Weighted& z, Index i, const Similarity& s) const {
  const std::vector<Index> near = nearest(s.kernel.col(i), [](Index) { return true; });
  const auto n = static_cast<Index>(near.size());
  Eigen::MatrixXf kernel = Eigen::MatrixXf::Ones(n, n);
  for (std::size_t j = 0; j < 3; ++j) {
    const Eigen::MatrixXf some = examples_.z[j](Eigen::all, near);
    const Eigen::VectorXf squares = examples_.squares[j](near);
    Eigen::MatrixXf squared = some.transpose() * some;
    if (j == 1) kernel += kKernel.linear * squared;
    to_squared_distances(squares, squares, squared);
    add_matern(squared, kernel);
  }
  const float itself = 2 + kKernel.linear * z.squares[1][i];
  return given(kernel, s.kernel.col(i)(near), itself);
}

void ExampleRegression::learn_errors(const Eigen::MatrixXf& kernel,
                                     const Eigen::MatrixXf& inverse_l, const Eigen::MatrixXf& a) {
  const Index measured = inverse_l.rows();
  const Index first = kernel.rows() - measured;
  std::map<int, std::vector<Index>> blocks;
  for (Index i = 0; i < measured; ++i)
    blocks[material_[static_cast<std::size_t>(first + i)]].push_back(i);
  Eigen::MatrixXd left_out(measured, a.cols());
  for (const auto& [material, block] : blocks) {
    const Eigen::MatrixXd columns = inverse_l(Eigen::all, block).cast<double>();
    const Eigen::MatrixXd own = columns.transpose() * columns;
    const Eigen::MatrixXd weights = a(block, Eigen::all).cast<double>();
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
  errors_ = left_out.transpose().cast<float>();
  for (Index i = 0; i < measured; ++i) {
    const int own = material_[static_cast<std::size_t>(first + i)];
    const auto with = kernel.col(first + i);
    const std::vector<Index> near =
        nearest(with, [&](Index e) { return material_[static_cast<std::size_t>(e)] != own; });
    const double v = given(kernel(near, near), with(near), kernel(first + i, first + i));
    errors_.col(i) /= static_cast<float>(std::sqrt(v + kKernel.measured_noise));
  }
  mean_shape_ = errors_ * errors_.transpose() / static_cast<float>(measured);
}

Eigen::MatrixXd ExampleRegression::mean(const Eigen::MatrixXd& x) const {
  const Weighted z = weighted(projection_ * x.cast<float>());
  return (coefficients_ * similarity(z).kernel).cast<double>();
}

/// Left-out errors, those of materials near the observed one counting most.
Eigen::MatrixXd ExampleRegression::covariance_near(const Eigen::VectorXf& squared_first,
                                                   double scale) const {
  constexpr float kNegligible = 1e-3F;
  const Index measured = errors_.cols();
  const Eigen::VectorXf near =
      (squared_first.tail(measured) * (-0.5F / (kErrorReach * kErrorReach))).array().exp();
  std::vector<Index> some;
  for (Index i = 0; i < measured; ++i) {
    if (near[i] >= kNegligible) some.push_back(i);
  }
  const Eigen::VectorXf share = near(some);
  const float background = kErrorBackground * static_cast<float>(measured);
  Eigen::MatrixXf shape = background * mean_shape_;
  const Eigen::MatrixXf errors = errors_(Eigen::all, some) * share.cwiseSqrt().asDiagonal();
  shape.selfadjointView<Eigen::Lower>().rankUpdate(errors);
  const Eigen::MatrixXf whole = shape.selfadjointView<Eigen::Lower>();
  return whole.cast<double>() * (kErrorGrowth * scale / double(background + share.sum()));
}

std::vector<ExampleRegression::Prediction> ExampleRegression::predict(
    const Eigen::MatrixXd& x) const {
  const Weighted z = weighted(projection_ * x.cast<float>());
  const Similarity s = similarity(z);
  const Eigen::MatrixXf c = coefficients_ * s.kernel;
  std::vector<Prediction> out;
  for (Index i = 0; i < x.cols(); ++i) {
    const double scale = variance_near(z, i, s) + kKernel.measured_noise;
    out.push_back({c.col(i).cast<double>(), covariance_near(s.squared_first.col(i), scale)});
  }
  return out;
}

}  // namespace brdfgate
