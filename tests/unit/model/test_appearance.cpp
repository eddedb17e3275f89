#include <cmath>

#include "catch.hpp"
#include "model/analytic.hpp"
#include "model/appearance.hpp"
#include "model/readings.hpp"

using namespace brdfgate;

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
