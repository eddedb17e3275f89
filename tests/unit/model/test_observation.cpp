#include <cmath>
#include <random>

#include "catch.hpp"
#include "model/analytic.hpp"
#include "model/basis_training.hpp"
#include "model/mapping.hpp"
#include "model/observation.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;

namespace {

std::shared_ptr<const Basis> small_basis() {
  static const std::shared_ptr<const Basis> basis = [] {
    const test::TempDir dir;
    std::vector<NamedBrdf> materials;
    int number = 0;
    for (const double alpha : {0.08, 0.15, 0.3}) {
      for (const double albedo : {0.1, 0.4}) {
        materials.push_back({"m" + std::to_string(number++),
                             make_brdf(GgxParameters{Rgb(albedo, albedo / 2, albedo / 3),
                                                     Rgb::Constant(0.04), alpha})});
      }
    }
    TrainingOptions options;
    options.grid = {16, 12, 12};
    options.components = 6;
    train_basis(materials, options, dir / "small.basis");
    return Basis::open(dir / "small.basis");
  }();
  return basis;
}

/// A satin material seen in a line of bins across its highlight, `noise` relative.
BinnedSamples satin(double noise) {
  const BrdfPtr brdf = make_brdf(GgxParameters{Rgb(0.3, 0.2, 0.1), Rgb::Constant(0.045), 0.2});
  BinnedSamples samples;
  for (int i = 0; i < 30; ++i) {
    Bin bin;
    bin.id = i;
    bin.light = 1;
    bin.angles = {0.02 + 0.02 * i, 0.9 - 0.01 * i, 1.0};
    bin.f = brdf->eval(bin.angles);
    bin.variance = (noise * bin.f).square();
    samples.bins.push_back(bin);
  }
  return samples;
}

}  // namespace

TEST_CASE("Pixel noise's covariance of the weights is what repeated noisy measurements show",
          "[observation]") {
  const auto basis = small_basis();
  const BinnedSamples clean = satin(0.03);
  const int observations = basis->info().observations;
  const Eigen::MatrixXd centre = ridge(*basis, clean).in_prior_sigmas(observations);
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  constexpr int kRepeats = 400;
  std::vector<Eigen::MatrixXd> counted(3, Eigen::MatrixXd::Zero(6, 6));
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    BinnedSamples noisy = clean;
    for (Bin& bin : noisy.bins) {
      for (int c = 0; c < 3; ++c)
        bin.f[c] = std::max(0.0, bin.f[c] + std::sqrt(bin.variance[c]) * normal(random));
    }
    const Eigen::MatrixXd d = ridge(*basis, noisy).in_prior_sigmas(observations) - centre;
    for (int c = 0; c < 3; ++c)
      counted[static_cast<std::size_t>(c)] += d.col(c) * d.col(c).transpose() / kRepeats;
  }
  const auto predicted = noise_covariance(*basis, clean);
  REQUIRE(predicted.size() == 3);
  for (std::size_t c = 0; c < 3; ++c) {
    CAPTURE(c);
    CHECK((predicted[c] - counted[c]).norm() < 0.15 * counted[c].norm());
  }
}

TEST_CASE("Pixel noise's covariance is under the posterior's and goes as the variance",
          "[observation]") {
  const auto basis = small_basis();
  const BinnedSamples samples = satin(0.01);
  const auto once = noise_covariance(*basis, samples);
  const auto twice = noise_covariance(*basis, satin(0.02));
  const Eigen::MatrixXd posterior =
      ridge(*basis, samples).covariance[0] * basis->info().observations;
  for (std::size_t c = 0; c < 3; ++c) {
    CHECK((twice[c] - 4 * once[c]).norm() < 1e-9 * twice[c].norm());
    CHECK(once[c].trace() < 0.1 * posterior.trace());
  }
}

TEST_CASE("Mapped noise is the mapping's slope times the noise", "[observation]") {
  const auto basis = small_basis();
  const BinnedSamples samples = satin(0.01);
  const BasisRows rows = basis->rows(samples.directions());
  const Eigen::MatrixXd noise = mapped_noise(rows, samples);
  for (Eigen::Index j = 0; j < noise.rows(); j += 7) {
    const Bin& bin = samples.bins[static_cast<std::size_t>(j)];
    const double step = 1e-6;
    const double slope = (to_mapped(bin.f[1] + step, rows.median[j], rows.weight[j]) -
                          to_mapped(bin.f[1] - step, rows.median[j], rows.weight[j])) /
                         (2 * step);
    CHECK(noise(j, 1) == Approx(slope * slope * bin.variance[1]).epsilon(1e-6));
  }
}
