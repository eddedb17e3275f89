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
#include "model/estimator.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

constexpr ExampleKernel kKernel;
/// Left-out errors count by exp(-d^2 / 2 l^2) of their material's distance, and all of them with
/// this share of one.
constexpr float kErrorReach = 0.7F;
constexpr float kErrorBackground = 0.05F;
/// What rounding and grid leave of a row, mapped units: no misfit is taken for smaller.
constexpr double kLeastMisfit = 0.05;
constexpr double kMisfitQuantile = 0.99;
/// Within the basis' span a grid and rounding leave less: no scale of the posterior is smaller.
constexpr double kLeastMisfitWithin = 0.01;

/// Matern 3/2 for squared distances.
void add_matern(const Eigen::Ref<const Eigen::MatrixXf>& squared, Eigen::Ref<Eigen::MatrixXf> sum) {
  constexpr auto kScale = static_cast<float>(3 / (kKernel.length * kKernel.length));
  for (Index j = 0; j < squared.cols(); ++j) {
    const Eigen::ArrayXf s = (kScale * squared.col(j).array().max(0.0F)).sqrt();
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

Eigen::MatrixXd ridge_gain(const Eigen::MatrixXd& q) {
  Eigen::MatrixXd normal = q.transpose() * q;
  normal.diagonal().array() += kRidgeEta;
  return normal.llt().solve(q.transpose());
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
  const Eigen::MatrixXd x = example_rows(basis, directions_);
  make_features(x);
  Eigen::MatrixXf noisy = similarity(examples_).kernel;
  const auto derived = static_cast<Index>(basis.exemplars().size());
  const Index measured = noisy.rows() - derived;
  const double growth = kKernel.noise_growth(rows_.q.rows());
  noisy.diagonal().head(derived).array() += static_cast<float>(growth * kKernel.derived_noise);
  noisy.diagonal().tail(measured).array() += static_cast<float>(growth * kKernel.measured_noise);
  // Single precision: the noise keeps the smallest eigenvalue a hundred times above its rounding.
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXf>> factor(noisy);
  const Eigen::MatrixXf a = factor.solve(example_weights(basis).cast<float>());
  const Eigen::MatrixXf inverse_l =
      factor.matrixL().solve(Eigen::MatrixXf::Identity(noisy.rows(), noisy.rows()));
  coefficients_ = (1 - kKernel.ridge_share) * a.transpose();
  const Eigen::MatrixXd gain = ridge_gain(rows_.q);
  ridge_gain_ = (kKernel.ridge_share * gain).cast<float>();
  learn_errors(left_out_errors(
      inverse_l, a, basis.training_weights() - (gain * x.rightCols(measured)).transpose()));
}

void ExampleRegression::make_features(const Eigen::MatrixXd& x) {
  const auto n = static_cast<double>(x.rows());
  const Index count = std::min(rows_.q.rows(), rows_.q.cols());
  // An orthonormal base of what the basis can say at the directions.
  span_ = Eigen::HouseholderQR<Eigen::MatrixXd>(rows_.q).householderQ() *
          Eigen::MatrixXd::Identity(rows_.q.rows(), count);
  const Eigen::MatrixXd inside = span_.transpose() * x / std::sqrt(n);
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
  projection_ = (to_features * span_.transpose() / std::sqrt(n)).cast<float>();
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

/// Weights of the training observations less what is predicted without their material and its
/// exemplars, observations x k: (K^-1)_ii^-1 (K^-1 T)_i of block i (Rasmussen & Williams eq. 5.12).
/// Ridge's part is not left out, but its basis has hundreds of observations for few components.
Eigen::MatrixXd ExampleRegression::left_out_errors(const Eigen::MatrixXf& inverse_l,
                                                   const Eigen::MatrixXf& a,
                                                   const Eigen::MatrixXd& ridge_error) const {
  const Index first = a.rows() - ridge_error.rows();
  std::map<int, std::vector<Index>> blocks;  // observations, then exemplars
  for (Index i = first; i < a.rows(); ++i)
    blocks[material_[static_cast<std::size_t>(i)]].push_back(i);
  for (Index i = 0; i < first; ++i) {
    const int material = material_[static_cast<std::size_t>(i)];
    if (material >= 0) blocks[material].push_back(i);
  }
  Eigen::MatrixXd left_out = kKernel.ridge_share * ridge_error;
  for (const auto& [material, block] : blocks) {
    const Eigen::MatrixXd columns = inverse_l(Eigen::all, block).cast<double>();
    const Eigen::MatrixXd own = columns.transpose() * columns;
    const Eigen::MatrixXd error = own.llt().solve(a(block, Eigen::all).cast<double>());
    for (std::size_t i = 0; i < block.size() && block[i] >= first; ++i)
      left_out.row(block[i] - first) += (1 - kKernel.ridge_share) * error.row(Index(i));
  }
  return left_out;
}

void ExampleRegression::learn_errors(const Eigen::MatrixXd& left_out) {
  const Index measured = left_out.rows();
  const Eigen::MatrixXd residual = rows_.q * left_out.transpose();
  misfit_ =
      (residual.rowwise().squaredNorm().array() / double(measured) + kLeastMisfit * kLeastMisfit)
          .sqrt();
  std::vector<double> squares;
  errors_ = left_out.transpose().cast<float>();
  for (Index i = 0; i < measured; ++i) {
    squares.push_back(residual.col(i).cwiseQuotient(misfit_).squaredNorm() /
                      double(misfit_.size()));
    errors_.col(i) /= static_cast<float>(std::sqrt(misfit_within(residual.col(i))));
  }
  misfit_limit_ = quantile(std::move(squares), kMisfitQuantile);
  mean_shape_ = errors_ * errors_.transpose() / static_cast<float>(measured);
}

/// RMS over the directions of the part of a residual that the basis could say, mapped units.
double ExampleRegression::misfit_within(const Eigen::VectorXd& residual) const {
  const double square =
      (span_.transpose() * residual).squaredNorm() / static_cast<double>(residual.size());
  return std::max(kLeastMisfitWithin, std::sqrt(square));
}

Eigen::MatrixXd ExampleRegression::answer(const Eigen::MatrixXf& x, const Similarity& s) const {
  return (coefficients_ * s.kernel + ridge_gain_ * x).cast<double>();
}

Eigen::MatrixXd ExampleRegression::mean(const Eigen::MatrixXd& x) const {
  const Eigen::MatrixXf values = x.cast<float>();
  return answer(values, similarity(weighted(projection_ * values)));
}

/// Left-out errors, those of materials near the observed one counting most.
Eigen::MatrixXd ExampleRegression::covariance_near(const Eigen::VectorXf& squared_first,
                                                   double misfit) const {
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
  return whole.cast<double>() * (misfit / double(background + share.sum()));
}

std::vector<ExampleRegression::Prediction> ExampleRegression::predict(
    const Eigen::MatrixXd& x) const {
  const Eigen::MatrixXf values = x.cast<float>();
  const Similarity s = similarity(weighted(projection_ * values));
  const Eigen::MatrixXd c = answer(values, s);
  const Eigen::MatrixXd residual = x - rows_.q * c;
  std::vector<Prediction> out;
  for (Index i = 0; i < x.cols(); ++i) {
    out.push_back(
        {c.col(i), covariance_near(s.squared_first.col(i), misfit_within(residual.col(i)))});
  }
  return out;
}

}  // namespace brdfgate
