#include <cmath>
#include <random>

#include "catch.hpp"
#include "model/analytic.hpp"
#include "model/appearance.hpp"
#include "model/error.hpp"
#include "model/readings.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

TEST_CASE("Aspecular angles are counted from the mirror direction over the normal") {
  for (const double deg : kAspecularDeg) {
    const DirectionPair at = aspecular_directions(deg);
    const Eigen::Vector3d mirror(-at.wi.x(), -at.wi.y(), at.wi.z());
    CHECK(std::acos(mirror.dot(at.wo)) * 180 / EIGEN_PI == Approx(deg));
    CHECK(at.wo.z() > 0);
  }
  CHECK(aspecular_directions(45).wo.z() == Approx(1));  // 45:0
}

TEST_CASE("A diffuser looks the same at every aspecular angle and does not flop") {
  const BrdfPtr grey = make_brdf(LambertParameters{{0.18, 0.18, 0.18}});
  const AspecularReadings r = aspecular_readings(*grey);
  for (const Lab& lab : r.lab) {
    CHECK(lab[0] == Approx(49.496).margin(0.01));
    CHECK(delta_e00(lab, lab_45_0(*grey)) < 1e-6);
  }
  CHECK(r.flop_index == Approx(0).margin(1e-9));
}

TEST_CASE("A metallic surface flops as Alman's formula says") {
  const BrdfPtr metal = make_brdf(GgxParameters{Rgb::Constant(0.05), Rgb::Constant(0.5), 0.3});
  const AspecularReadings r = aspecular_readings(*metal);
  CHECK(r.lab[0][0] > r.lab[2][0]);
  CHECK(r.lab[2][0] > r.lab[4][0]);
  CHECK(r.flop_index ==
        Approx(2.69 * std::pow(r.lab[0][0] - r.lab[4][0], 1.11) / std::pow(r.lab[2][0], 0.86)));
  CHECK(std::isnan(aspecular_readings(*make_brdf(LambertParameters{Rgb::Zero()})).flop_index));
}

TEST_CASE("Haze is the fall from 60 to 20 degrees, above 70 gloss units only") {
  CHECK(haze_gu({80, 92, 95}) == Approx(12));
  CHECK(std::isnan(haze_gu({20, 69.9, 90})));
}

TEST_CASE("A direction is measured where a bin lies within five degrees of it") {
  constexpr double kDegree = EIGEN_PI / 180;
  BinnedSamples samples;
  samples.bins.push_back({.angles = {10 * kDegree, 30 * kDegree, 1.0}});
  CHECK(is_measured(samples, {14 * kDegree, 33 * kDegree, 1.0}));
  CHECK(is_measured(samples, {10 * kDegree, 30 * kDegree, 1.0 - EIGEN_PI}));
  CHECK_FALSE(is_measured(samples, {16 * kDegree, 30 * kDegree, 1.0}));
  CHECK_FALSE(is_measured(samples, {10 * kDegree, 36 * kDegree, 1.0}));
  CHECK_FALSE(is_measured(samples, {10 * kDegree, 30 * kDegree, 1.0 + EIGEN_PI / 2}));
}

TEST_CASE("The lightness' deviation is what weights drawn from their posterior scatter") {
  const auto basis = small_basis();
  const Eigen::Index k = basis->info().components;
  const HalfDiff at = to_half_diff(aspecular_directions(45));
  Weights mean;
  mean.c = basis->training_weights().topRows(3).transpose();
  mean.covariance.assign(3, Eigen::MatrixXd::Identity(k, k) * 1e-5);
  std::mt19937 random(11);
  std::normal_distribution<double> normal(0, std::sqrt(1e-5));
  double sum = 0, squares = 0;
  constexpr int kDraws = 400;
  for (int i = 0; i < kDraws; ++i) {
    Eigen::Array3d f;
    for (int ch = 0; ch < 3; ++ch) {
      const Eigen::VectorXd c =
          mean.c.col(ch) + Eigen::VectorXd::NullaryExpr(k, [&] { return normal(random); });
      f[ch] = basis->reconstruct(c, {at})[0];
    }
    const double l = linear_srgb_to_lab(EIGEN_PI * f)[0];
    sum += l;
    squares += l * l;
  }
  const double scatter = std::sqrt(squares / kDraws - std::pow(sum / kDraws, 2));
  CHECK(lightness_sigma(*basis, mean, at) == Approx(scatter).epsilon(0.15));
  mean.covariance.pop_back();
  CHECK_THROWS_AS(lightness_sigma(*basis, mean, at), InputError);
}
