#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <set>

#include "catch.hpp"
#include "model/goniometer_path.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using Eigen::Vector3d;

namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;

/// The robot of Appendix G.
Goniometer appendix_g() {
  Goniometer g;
  g.centre = {0.9, -0.1, 0.4};
  g.camera_radius = 0.35;
  g.arc_azimuth = 90 * kDegree;
  g.lamp_step = 7.5 * kDegree;
  g.max_theta = 82.5 * kDegree;
  g.clearance = 10 * kDegree;
  g.longest_move = 15 * kDegree;
  return g;
}

HalfDiff degrees(double h, double d, double p) {
  return {h * kDegree, d * kDegree, p * kDegree};
}

std::vector<HalfDiff> random_directions(int n) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(0, 1);
  std::vector<HalfDiff> some;
  while (static_cast<int>(some.size()) < n) {
    const HalfDiff at{0.8 * u(random), 0.15 + 1.1 * u(random), 3.14 * u(random)};
    if (cosines(at).above_horizon(0.25)) some.push_back(at);
  }
  return some;
}

Vector3d unit(double theta, double phi) {
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

double angle_between(const Vector3d& a, const Vector3d& b) {
  return std::acos(std::clamp(a.normalized().dot(b.normalized()), -1.0, 1.0));
}

}  // namespace

TEST_CASE("A stop's position, pitch and yaw are Appendix G eq. 1 to 5") {
  const Goniometer g = appendix_g();
  const double theta = 37.5 * kDegree;
  const double phi = 120 * kDegree;
  const PathStop stop = camera_stop(g, theta, phi);
  CHECK(stop.p_R.x() == Approx(0.9 + 0.35 * std::sin(theta) * std::cos(phi)));
  CHECK(stop.p_R.y() == Approx(-0.1 + 0.35 * std::sin(theta) * std::sin(phi)));
  CHECK(stop.p_R.z() == Approx(0.4 + 0.35 * std::cos(theta)));
  CHECK(stop.pitch == Approx(kPi / 2 + theta));
  CHECK(stop.yaw == phi);
}

TEST_CASE("The tool's x axis looks at the sample from every stop") {
  const Goniometer g = appendix_g();
  for (const double theta : {0.0, 0.4, 1.2}) {
    for (const double phi : {-2.0, 0.0, 0.7, 3.0}) {
      const PathStop stop = camera_stop(g, theta, phi);
      const Vector3d sight = stop.q_R * Vector3d::UnitX();
      CHECK((stop.p_R + g.camera_radius * sight).isApprox(g.centre, 1e-12));
    }
  }
}

TEST_CASE("A stop measures what its lamp and its camera say, with the asked theta_h") {
  const Goniometer g = appendix_g();
  const std::vector<HalfDiff> asked = random_directions(25);
  const GoniometerPath path = plan_path(g, asked);
  std::set<int> measured;
  for (const PathStop& stop : path.stops) {
    if (stop.direction < 0) continue;
    CHECK(measured.insert(stop.direction).second);
    const Vector3d lamp = unit(stop.lamp * g.lamp_step, g.arc_azimuth);
    const Vector3d camera = (stop.p_R - g.centre).normalized();
    const HalfDiff seen = to_half_diff({lamp, camera});
    const HalfDiff& wanted = asked[static_cast<std::size_t>(stop.direction)];
    CHECK(seen.theta_h == Approx(wanted.theta_h).margin(1e-9));
    CHECK(seen.theta_h == Approx(stop.angles.theta_h).margin(1e-9));
    CHECK(seen.theta_d == Approx(stop.angles.theta_d).margin(1e-9));
    // Isotropy: phi_d and its mirror image are one and the same.
    CHECK(std::cos(seen.phi_d) * std::cos(seen.phi_d) ==
          Approx(std::cos(stop.angles.phi_d) * std::cos(stop.angles.phi_d)).margin(1e-9));
    // The lamp is at most half a step away, and with it the difference direction.
    CHECK(std::abs(seen.theta_d - wanted.theta_d) <= g.lamp_step / 2 + 1e-9);
    CHECK(stop.theta <= g.max_theta + 1e-9);
    CHECK(angle_between(lamp, camera) >= g.clearance - 1e-9);
  }
  CHECK(measured.size() + path.missed.size() == asked.size());
  CHECK(measured.size() > 15);
}

TEST_CASE("Moves stay on the camera's sphere, above the sample and within the longest move") {
  const Goniometer g = appendix_g();
  const GoniometerPath path = plan_path(g, random_directions(12));
  Vector3d here = Vector3d::UnitZ();
  double length = 0;
  for (const PathStop& stop : path.stops) {
    const Vector3d camera = stop.p_R - g.centre;
    CHECK(camera.norm() == Approx(g.camera_radius));
    CHECK(camera.z() > 0);
    CHECK(angle_between(here, camera) <= g.longest_move + 1e-6);
    length += angle_between(here, camera);
    here = camera;
  }
  CHECK(length == Approx(path.length).epsilon(1e-6));
}

TEST_CASE("The way is no longer than that of the directions in the order given") {
  Goniometer g = appendix_g();
  g.longest_move = kPi;  // no stops on the way
  const std::vector<HalfDiff> asked = random_directions(20);
  const GoniometerPath path = plan_path(g, asked);
  std::vector<PathStop> stops = path.stops;
  std::sort(stops.begin(), stops.end(),
            [](const PathStop& a, const PathStop& b) { return a.direction < b.direction; });
  Vector3d here = Vector3d::UnitZ();
  double given = 0;
  for (const PathStop& stop : stops) {
    given += angle_between(here, stop.p_R - g.centre);
    here = stop.p_R - g.centre;
  }
  CHECK(path.length < 0.6 * given);
}

TEST_CASE("By reciprocity the direction nearer to a lamp is the lamp's") {
  // One direction 22.5 deg from the normal, just on a lamp; the other 26 deg off every one.
  const HalfDiff asked = to_half_diff({unit(26 * kDegree, 2.0), unit(22.5 * kDegree, 0.3)});
  const GoniometerPath path = plan_path(appendix_g(), {asked});
  const PathStop& stop = path.stops.back();
  CHECK(stop.lamp == 3);
  CHECK(stop.theta == Approx(26 * kDegree));
  CHECK(stop.angles.theta_d == Approx(asked.theta_d));
}

TEST_CASE("What the robot cannot measure is listed with the reason") {
  const GoniometerPath path =
      plan_path(appendix_g(), {degrees(0, 60, 0), degrees(20, 1, 0), degrees(4, 85.5, 90)});
  CHECK(path.stops.back().direction == 0);
  REQUIRE(path.missed.size() == 2);
  CHECK(path.missed[0].direction == 1);
  CHECK(contains(path.missed[0].reason, "in the lamp's light"));
  CHECK(path.missed[1].direction == 2);
  CHECK(contains(path.missed[1].reason, "deg from the normal"));
}

TEST_CASE("A path over nothing, below the horizon or out of reach is refused") {
  const auto error_of = [](const std::vector<HalfDiff>& at) {
    return input_error([&] { return plan_path(appendix_g(), at); });
  };
  CHECK(contains(error_of({}), "none given"));
  CHECK(contains(error_of({degrees(80, 60, 0)}), "direction 1: lies below the horizon"));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(error_of({degrees(nan, 60, 0)}), "direction 1"));
  CHECK(contains(error_of({degrees(20, 1, 0)}), "none of the directions can be measured"));
}

TEST_CASE("An impossible goniometer is refused by the number that is wrong") {
  const auto error_with = [](auto change) {
    Goniometer g = appendix_g();
    change(g);
    return input_error([&] { return plan_path(g, {degrees(0, 45, 0)}); });
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(error_with([](auto& g) { g.camera_radius = 0; }), "camera radius"));
  CHECK(contains(error_with([&](auto& g) { g.camera_radius = nan; }), "camera radius"));
  CHECK(contains(error_with([](auto& g) { g.lamp_step = 0; }), "lamp step"));
  CHECK(contains(error_with([](auto& g) { g.max_theta = kPi / 2; }), "max theta"));
  CHECK(contains(error_with([](auto& g) { g.clearance = -1; }), "clearance"));
  CHECK(contains(error_with([](auto& g) { g.longest_move = 0; }), "longest move"));
  CHECK(contains(error_with([&](auto& g) { g.centre.x() = nan; }), "goniometer"));
}
