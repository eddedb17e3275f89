// A part's tilt and height: geometry, and their estimate from the highlight.
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "model/pose_estimate.hpp"
#include "support/input_error.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

constexpr double kDegree = std::numbers::pi / 180;

Eigen::Vector3d direction(double theta_deg) {
  return {std::sin(theta_deg * kDegree), 0, std::cos(theta_deg * kDegree)};
}

std::vector<Sightline> lines() {
  std::vector<Sightline> out;
  for (const double light : {-55.0, 20.0}) {
    Eigen::Vector4d at;
    at << 0.25 * direction(light), 1;
    for (int i = 0; i < 13; ++i)
      for (int j = 0; j < 13; ++j)
        out.push_back({0.18 * direction(55), {0.006 * (i - 6), 0.006 * (j - 6), 0}, at});
  }
  return out;
}

/// Light received from a part that lies so, as reflectance of the taught pose.
PoseSamples seen(const Brdf& brdf, const PartPose& pose) {
  PoseSamples samples{lines(), {}};
  samples.f.resize(Eigen::Index(samples.lines.size()), 3);
  for (std::size_t j = 0; j < samples.lines.size(); ++j) {
    const Sightline& line = samples.lines[j];
    samples.f.row(Eigen::Index(j)) =
        (brdf.eval(line.angles(pose)) * line.irradiance(pose) / line.irradiance({})).matrix();
  }
  return samples;
}

BrdfPtr glossy() {
  GgxParameters p;
  p.diffuse = Rgb(0.02, 0.1, 0.4);
  p.f0 = Rgb::Constant(0.05);
  p.alpha = 0.1;
  return make_brdf(p);
}

}  // namespace

TEST_CASE("an untilted sightline has the angles of its two directions") {
  for (const Sightline& line : lines()) {
    const HalfDiff expected = to_half_diff({(line.light_W.head<3>() - line.point_W).normalized(),
                                            (line.eye_W - line.point_W).normalized()});
    const HalfDiff found = line.angles({});
    CHECK(found.theta_h == Approx(expected.theta_h).margin(1e-12));
    CHECK(found.theta_d == Approx(expected.theta_d));
  }
}

TEST_CASE("moving the station into the part's frame is the same as moving the part") {
  const PartPose pose{0.8 * kDegree, -0.5 * kDegree, 0.001};
  StationGeometry station;
  station.camera.X_WC.translation() = 0.18 * direction(55);
  station.lights_W = {0.25 * direction(-55)};
  const StationGeometry moved = in_part_frame(station, pose);
  const Sightline line = lines()[30];
  Sightline there = line;
  there.eye_W = moved.camera.position();
  there.light_W.head<3>() = moved.lights_W[0];
  // Where the ray meets the part, in the part's frame.
  const Eigen::Vector3d toward = pose.rotation().transpose() * (line.point_W - line.eye_W);
  there.point_W = there.eye_W - toward * (there.eye_W.z() / toward.z());
  const HalfDiff a = line.angles(pose);
  const HalfDiff b = there.angles({});
  CHECK(a.theta_h == Approx(b.theta_h).epsilon(1e-9));
  CHECK(a.theta_d == Approx(b.theta_d).epsilon(1e-9));
  CHECK(line.irradiance(pose) == Approx(there.irradiance({})).epsilon(1e-9));
}

TEST_CASE("the tilt of a glossy part is found, with a sigma under the fixture's") {
  // The small basis has cells of 24 along theta_h, which alone is worth a tenth of a degree.
  constexpr double kClose = 0.15 * kDegree;
  const auto basis = small_basis();
  struct Case {
    double x_deg, y_deg;
  };
  for (const Case& c : {Case{0, 0}, Case{0.5, 0}, Case{0, -0.7}, Case{-0.9, 0.6}}) {
    CAPTURE(c.x_deg, c.y_deg);
    const PartPose truth{c.x_deg * kDegree, c.y_deg * kDegree, 0};
    const PoseEstimate found = estimate_pose(*basis, seen(*glossy(), truth), {0.6 * kDegree, 0});
    CHECK(std::abs(found.pose.tilt_x - truth.tilt_x) < kClose);
    CHECK(std::abs(found.pose.tilt_y - truth.tilt_y) < kClose);
    CHECK(found.pose.height_m == 0);
    CHECK(std::sqrt(found.covariance(0, 0)) < 0.3 * kDegree);
  }
}

TEST_CASE("a matte part says little of its tilt: the sigma stays near the fixture's") {
  const auto basis = small_basis();
  const BrdfPtr matte = make_brdf(LambertParameters{Rgb(0.3, 0.21, 0.09)});
  const PoseEstimate found =
      estimate_pose(*basis, seen(*matte, {0.5 * kDegree, 0, 0}), {0.6 * kDegree, 0});
  const PoseEstimate sharp =
      estimate_pose(*basis, seen(*glossy(), {0.5 * kDegree, 0, 0}), {0.6 * kDegree, 0});
  CHECK(found.covariance(0, 0) > 4 * sharp.covariance(0, 0));
  CHECK(std::sqrt(found.covariance(0, 0)) < 0.61 * kDegree);
}

TEST_CASE("what no material of the basis shows widens the stated tilt") {
  const auto basis = small_basis();
  const PosePrior prior{0.6 * kDegree, 0};
  const PoseSamples good = seen(*glossy(), {0.5 * kDegree, 0, 0});
  const Eigen::Matrix3d plain = estimate_pose(*basis, good, prior).covariance;
  PoseSamples strange = good;
  for (Eigen::Index j = 0; j < strange.f.rows(); ++j)
    strange.f.row(j) *= j % 2 == 0 ? 1.3 : 1 / 1.3;
  const Eigen::Matrix3d wide = estimate_pose(*basis, strange, prior).covariance;
  for (Eigen::Index i = 0; i < 2; ++i) {
    CAPTURE(i);
    CHECK(wide(i, i) > 4 * plain(i, i));
    CHECK(std::sqrt(wide(i, i)) < 0.61 * kDegree);
  }
}

TEST_CASE("pose samples that fit nothing are refused") {
  const auto basis = small_basis();
  PoseSamples good = seen(*glossy(), {});
  CHECK(contains(input_error([&] { estimate_pose(*basis, {}, {0.01, 0}); }), "sightlines"));
  CHECK(contains(input_error([&] { estimate_pose(*basis, good, {-0.01, 0}); }), "negative"));
  good.f(3, 1) = std::nan("");
  CHECK(contains(input_error([&] { estimate_pose(*basis, good, {0.01, 0}); }), "non-finite"));
}
