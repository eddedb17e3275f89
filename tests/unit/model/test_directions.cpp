#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "catch.hpp"
#include "model/directions.hpp"

using namespace brdfgate;

namespace {

constexpr double kPi = std::numbers::pi;

/// Random pairs above the horizon, seeded.
std::vector<DirectionPair> random_pairs(int count) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> z(0.02, 1.0);
  std::uniform_real_distribution<double> phi(0.0, 2 * kPi);
  const auto direction = [&] {
    const double c = z(random);
    const double a = phi(random);
    return Eigen::Vector3d(std::sqrt(1 - c * c) * std::cos(a), std::sqrt(1 - c * c) * std::sin(a),
                           c);
  };
  std::vector<DirectionPair> pairs;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d wi = direction();
    pairs.push_back({wi, direction()});
  }
  return pairs;
}

/// Distance on the circle of circumference pi.
double phi_distance(double a, double b) {
  const double d = std::abs(std::remainder(a - b, kPi));
  return std::min(d, kPi - d);
}

void check_equal(const HalfDiff& a, const HalfDiff& b) {
  CHECK(a.theta_h == Approx(b.theta_h).margin(1e-12));
  CHECK(a.theta_d == Approx(b.theta_d).margin(1e-12));
  // phi_d loses digits where it is nearly undefined.
  CHECK(phi_distance(a.phi_d, b.phi_d) * std::sin(a.theta_d) * std::sin(a.theta_h) ==
        Approx(0).margin(1e-12));
}

}  // namespace

TEST_CASE("the difference angle is that between either direction and the half vector") {
  for (const DirectionPair& pair : random_pairs(200)) {
    const HalfDiff a = to_half_diff(pair);
    const Eigen::Vector3d h = (pair.wi + pair.wo).normalized();
    CHECK(std::cos(a.theta_d) == Approx(pair.wi.dot(h)).margin(1e-12));
    CHECK(std::cos(a.theta_d) == Approx(pair.wo.dot(h)).margin(1e-12));
    CHECK(std::cos(a.theta_h) == Approx(h.z()).margin(1e-12));
    CHECK((a.phi_d >= 0 && a.phi_d < kPi));
  }
}

TEST_CASE("phi_d is the azimuth of wi after turning the half vector to the pole") {
  // Rusinkiewicz 1998, section 3, with rotation matrices instead of the code's closed form.
  for (const DirectionPair& pair : random_pairs(200)) {
    const Eigen::Vector3d h = (pair.wi + pair.wo).normalized();
    const double phi_h = std::atan2(h.y(), h.x());
    const Eigen::Vector3d d = Eigen::AngleAxisd(-std::acos(h.z()), Eigen::Vector3d::UnitY()) *
                              (Eigen::AngleAxisd(-phi_h, Eigen::Vector3d::UnitZ()) * pair.wi);
    CHECK(phi_distance(to_half_diff(pair).phi_d, std::atan2(d.y(), d.x())) ==
          Approx(0).margin(1e-9));
  }
}

TEST_CASE("angles know neither the order of the directions nor the part's azimuth") {
  for (const DirectionPair& pair : random_pairs(200)) {
    const HalfDiff a = to_half_diff(pair);
    check_equal(a, to_half_diff({pair.wo, pair.wi}));
    const Eigen::AngleAxisd turn(1.234, Eigen::Vector3d::UnitZ());
    check_equal(a, to_half_diff({turn * pair.wi, turn * pair.wo}));
  }
}

TEST_CASE("angles to directions and back is the identity") {
  for (const DirectionPair& pair : random_pairs(200)) {
    const HalfDiff a = to_half_diff(pair);
    const DirectionPair again = to_directions(a);
    CHECK(again.wi.norm() == Approx(1));
    CHECK(again.wo.norm() == Approx(1));
    check_equal(a, to_half_diff(again));
    const Cosines c = cosines(a);
    CHECK(c.i == Approx(again.wi.z()).margin(1e-14));
    CHECK(c.o == Approx(again.wo.z()).margin(1e-14));
    // The fold may swap the two: as a pair they are those of the start.
    CHECK(std::min(c.i, c.o) == Approx(std::min(pair.wi.z(), pair.wo.z())).margin(1e-12));
    CHECK(std::max(c.i, c.o) == Approx(std::max(pair.wi.z(), pair.wo.z())).margin(1e-12));
  }
}

TEST_CASE("small difference angles keep their digits") {
  const double half = 1e-7;
  const DirectionPair pair{{std::sin(half), 0, std::cos(half)},
                           {-std::sin(half), 0, std::cos(half)}};
  CHECK(to_half_diff(pair).theta_d == Approx(half).epsilon(1e-9));
  CHECK(to_half_diff(pair).theta_h == Approx(0).margin(1e-15));
}

TEST_CASE("retro-reflection and the mirror direction have finite angles") {
  const Eigen::Vector3d w = Eigen::Vector3d(0.3, 0.2, 0.9).normalized();
  const HalfDiff retro = to_half_diff({w, w});
  CHECK(retro.theta_d == 0);
  CHECK(std::isfinite(retro.phi_d));
  const HalfDiff mirror = to_half_diff({w, {-w.x(), -w.y(), w.z()}});
  CHECK(mirror.theta_h == Approx(0).margin(1e-15));
  CHECK((mirror.phi_d >= 0 && mirror.phi_d < kPi));
}
