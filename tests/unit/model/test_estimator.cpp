#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "catch.hpp"
#include "model/estimator.hpp"
#include "model/mapping.hpp"
#include "support/input_error.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;

namespace {

const Basis& basis() {
  static const auto made = test::small_basis();
  return *made;
}

/// A GGX material that is not in the training set, seen at n seeded directions.
BinnedSamples samples_of(int n, int channels = 3) {
  GgxParameters p;
  p.diffuse = Rgb(0.3, 0.1, 0.05);
  p.f0 = Rgb::Constant(0.06);
  p.alpha = 0.15;
  const BrdfPtr material = make_brdf(p);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(0, 1);
  BinnedSamples samples;
  samples.channels = channels;
  while (static_cast<int>(samples.bins.size()) < n) {
    Bin bin;
    bin.id = static_cast<int>(samples.bins.size());
    bin.angles = {0.8 * u(random), 1.2 * u(random), 3.14 * u(random)};
    if (!cosines(bin.angles).above_horizon(0.1)) continue;
    bin.f = material->eval(bin.angles);
    samples.bins.push_back(bin);
  }
  return samples;
}

Eigen::MatrixXd mapped(const BinnedSamples& samples, const BasisRows& rows) {
  Eigen::MatrixXd x(rows.q.rows(), samples.channels);
  for (Eigen::Index j = 0; j < x.rows(); ++j) {
    for (Eigen::Index c = 0; c < x.cols(); ++c) {
      x(j, c) = to_mapped(samples.bins[static_cast<std::size_t>(j)].f[c], rows.median[j],
                          rows.weight[j]) -
                rows.mean[j];
    }
  }
  return x;
}

/// Ridge as least squares of the augmented system [Q; sqrt(eta) I] c = [x; 0], by QR.
Eigen::MatrixXd augmented_least_squares(const BinnedSamples& samples, double eta) {
  const BasisRows rows = basis().rows(samples.directions());
  const Eigen::Index n = rows.q.rows();
  const Eigen::Index k = rows.q.cols();
  Eigen::MatrixXd a(n + k, k);
  a << rows.q, std::sqrt(eta) * Eigen::MatrixXd::Identity(k, k);
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(n + k, samples.channels);
  b.topRows(n) = mapped(samples, rows);
  return a.colPivHouseholderQr().solve(b);
}

}  // namespace

TEST_CASE("ridge is the least-squares solution of the augmented system") {
  for (const int n : {1, 5, 12, 200}) {
    for (const double eta : {0.5, kRidgeEta, 400.0}) {
      const BinnedSamples samples = samples_of(n);
      const Weights w = ridge(basis(), samples, eta);
      const Eigen::MatrixXd expected = augmented_least_squares(samples, eta);
      INFO("n " << n << ", eta " << eta);
      CHECK((w.c - expected).norm() < 1e-9 * (1 + expected.norm()));
      CHECK(w.rows == n);
    }
  }
}

TEST_CASE("one observation has the closed form q x / (q.q + eta)") {
  const BinnedSamples samples = samples_of(1);
  const BasisRows rows = basis().rows(samples.directions());
  const Eigen::VectorXd q = rows.q.row(0);
  const Eigen::MatrixXd x = mapped(samples, rows);
  const Weights w = ridge(basis(), samples);
  const Eigen::MatrixXd expected = q * x.row(0) / (q.squaredNorm() + kRidgeEta);
  CHECK((w.c - expected).norm() < 1e-12);
}

TEST_CASE("a small eta interpolates the observations and a large one returns the mean") {
  const BinnedSamples few = samples_of(6);
  CHECK(ridge(basis(), few, 1e-9).residual_rms < 1e-4);
  const Weights none = ridge(basis(), few, 1e12);
  CHECK(none.c.norm() < 1e-6);
  const BasisRows rows = basis().rows(few.directions());
  CHECK(none.residual_rms == Approx(mapped(few, rows).norm() / std::sqrt(18.0)).epsilon(1e-6));
}

TEST_CASE("the order of the bins does not matter") {
  BinnedSamples samples = samples_of(60);
  const Weights a = ridge(basis(), samples);
  std::mt19937 random(2);
  std::shuffle(samples.bins.begin(), samples.bins.end(), random);
  const Weights b = ridge(basis(), samples);
  CHECK((a.c - b.c).norm() < 1e-10);
  CHECK(a.residual_rms == Approx(b.residual_rms));
}

TEST_CASE("channels are estimated by themselves, mono with the same chain") {
  const Weights three = ridge(basis(), samples_of(40, 3));
  const Weights one = ridge(basis(), samples_of(40, 1));
  CHECK(one.c.cols() == 1);
  CHECK((one.c.col(0) - three.c.col(0)).norm() < 1e-12);
  CHECK(one.covariance.size() == 1);
  CHECK(three.covariance.size() == 3);
}

TEST_CASE("the covariance is that of the Gaussian model behind the ridge") {
  // Prior N(0, I/m), error variance eta/m: posterior (m I + m/eta Q^T Q)^-1, by plain inversion.
  const BinnedSamples samples = samples_of(30);
  const Weights w = ridge(basis(), samples);
  const Eigen::MatrixXd q = basis().rows(samples.directions()).q;
  const double m = basis().info().observations;
  const Eigen::MatrixXd precision =
      m * Eigen::MatrixXd::Identity(q.cols(), q.cols()) + m / kRidgeEta * q.transpose() * q;
  CHECK((w.covariance[1] - precision.inverse()).norm() < 1e-10);
  // Nothing seen leaves the prior, one sigma; seeing never widens it.
  const Eigen::MatrixXd sigmas = w.sigmas_in_prior_sigmas(basis().info().observations);
  CHECK((sigmas.array() <= 1 + 1e-12).all());
  CHECK((sigmas.array() > 0).all());
  const Eigen::MatrixXd blind =
      ridge(basis(), samples, 1e12).sigmas_in_prior_sigmas(basis().info().observations);
  CHECK(blind.minCoeff() == Approx(1).epsilon(1e-6));
  CHECK((w.in_prior_sigmas(27) - w.c * std::sqrt(27.0)).norm() == 0);
}

TEST_CASE("the mapped residual is what the model leaves of the observations") {
  const BinnedSamples samples = samples_of(50);
  const Weights w = ridge(basis(), samples);
  const Eigen::MatrixXd r = mapped_residual(basis(), samples, w);
  CHECK(r.rows() == 50);
  CHECK(r.cols() == 3);
  CHECK(std::sqrt(r.squaredNorm() / 150) == Approx(w.residual_rms));
  // The normal equations of ridge: Q^T r = eta c.
  const Eigen::MatrixXd q = basis().rows(samples.directions()).q;
  CHECK((q.transpose() * r - kRidgeEta * w.c).norm() < 1e-8);
}

TEST_CASE("samples that no camera makes are refused with their bin") {
  const auto error_after = [](auto&& change) {
    BinnedSamples samples = samples_of(5);
    change(samples);
    return input_error([&] { return ridge(basis(), samples); });
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(error_after([](BinnedSamples& s) { s.bins.clear(); }), "no bins"));
  CHECK(contains(error_after([&](BinnedSamples& s) { s.bins[3].f[1] = nan; }), "bin 3"));
  CHECK(contains(error_after([](BinnedSamples& s) { s.bins[2].f[0] = -0.1; }), "bin 2"));
  CHECK(contains(error_after([](BinnedSamples& s) { s.bins[4].angles = {1.4, 1.2, 0}; }),
                 "below the horizon"));
  CHECK(contains(error_after([](BinnedSamples& s) { s.channels = 2; }), "2 channels"));
  CHECK(contains(input_error([] { return ridge(basis(), samples_of(3), 0); }), "eta"));
  CHECK(contains(input_error([&] { return ridge(basis(), samples_of(3), nan); }), "eta"));
  // A mono sample's other channels are nobody's business.
  BinnedSamples mono = samples_of(5, 1);
  mono.bins[0].f[2] = nan;
  CHECK_NOTHROW(ridge(basis(), mono));
  Weights foreign;
  foreign.c = Eigen::MatrixXd::Zero(3, 3);
  CHECK(contains(input_error([&] { return mapped_residual(basis(), samples_of(3), foreign); }),
                 "3 components"));
}
