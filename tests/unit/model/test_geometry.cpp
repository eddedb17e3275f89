#include <algorithm>
#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "model/geometry.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;

namespace {

constexpr double kDeg = std::numbers::pi / 180;

NominalRig default_rig() {
  NominalRig rig;
  rig.lights = {{55, 180, 0.3}, {20, 0, 0.3}};
  return rig;
}

SensorFormat sensor_of(int width, int height, Mosaic mosaic) {
  return {width, height, 10, mosaic, 60, 1023};
}

/// Angle between two vectors by their dot product: independent of the code's half vectors.
double angle(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::acos(std::clamp(a.normalized().dot(b.normalized()), -1.0, 1.0));
}

}  // namespace

TEST_CASE("the nominal camera looks at the origin from its polar angle") {
  const auto camera = make_geometry(default_rig(), sensor_of(1456, 1088, Mosaic::rggb)).camera;
  CHECK(camera.position().norm() == Approx(0.18));
  CHECK(angle(camera.position(), Eigen::Vector3d::UnitZ()) == Approx(55 * kDeg));
  CHECK(camera.position().y() == Approx(0).margin(1e-15));
  CHECK(camera.position().x() > 0);
  const Eigen::Vector2d centre = camera.project(Eigen::Vector3d::Zero());
  CHECK(centre.x() == Approx(727.5));
  CHECK(centre.y() == Approx(543.5));
  const Eigen::Matrix3d R = camera.X_WC.linear();
  CHECK((R * R.transpose()).isIdentity(1e-12));
  CHECK(R.determinant() == Approx(1));
}

TEST_CASE("image right is +y and image down is toward the camera") {
  const auto camera = make_geometry(default_rig(), sensor_of(1456, 1088, Mosaic::mono)).camera;
  CHECK(camera.project({0, 0.01, 0}).x() > 727.5);
  CHECK(camera.project({0, 0.01, 0}).y() == Approx(543.5));
  CHECK(camera.project({0.01, 0, 0}).y() > 543.5);
  CHECK(camera.project({0.01, 0, 0}).x() == Approx(727.5));
}

TEST_CASE("the field of view is the full angle of the disc inscribed in the image") {
  const auto camera = make_geometry(default_rig(), sensor_of(1456, 1088, Mosaic::mono)).camera;
  const Eigen::Vector3d axis = camera.ray_W(camera.centre_px);
  CHECK(angle(axis, camera.ray_W(camera.centre_px + Eigen::Vector2d(0, 544))) ==
        Approx(12.5 * kDeg));
  CHECK(angle(axis, camera.ray_W(camera.centre_px + Eigen::Vector2d(-544, 0))) ==
        Approx(12.5 * kDeg));
}

TEST_CASE("projecting what a pixel sees returns the pixel") {
  const auto camera = make_geometry(default_rig(), sensor_of(640, 480, Mosaic::mono)).camera;
  for (const Eigen::Vector2d& px : {Eigen::Vector2d(0, 0), {639, 0}, {12.25, 400}, {320, 479}}) {
    for (const double range : {0.05, 0.18, 2.0}) {
      const Eigen::Vector3d p_W = camera.position() + range * camera.ray_W(px);
      CHECK((camera.project(p_W) - px).norm() < 1e-9);
    }
  }
}

TEST_CASE("lights stand at their polar angle, azimuth and distance") {
  NominalRig rig = default_rig();
  rig.lights.push_back({30, 90, 0.25});
  const auto lights = make_geometry(rig, sensor_of(64, 48, Mosaic::mono)).lights_W;
  REQUIRE(lights.size() == 3);
  CHECK((lights[0] - 0.3 * Eigen::Vector3d(-std::sin(55 * kDeg), 0, std::cos(55 * kDeg))).norm() <
        1e-12);
  CHECK((lights[1] - 0.3 * Eigen::Vector3d(std::sin(20 * kDeg), 0, std::cos(20 * kDeg))).norm() <
        1e-12);
  CHECK((lights[2] - 0.25 * Eigen::Vector3d(0, 0.5, std::cos(30 * kDeg))).norm() < 1e-12);
}

TEST_CASE("cells know their angles and cosines from their place on the plane") {
  const auto mosaic = GENERATE(Mosaic::mono, Mosaic::rggb);
  const SensorFormat sensor = sensor_of(90, 70, mosaic);
  const auto geometry = make_geometry(default_rig(), sensor);
  const auto cells = cell_geometry(geometry, sensor, {1, 1});
  const cv::Size size = sensor.cells();
  REQUIRE(cells.cos_o.size() == size);
  const int side = mosaic == Mosaic::mono ? 1 : 2;
  for (const cv::Point at :
       {cv::Point(0, 0), {5, 31}, {44, 2}, {size.width - 1, size.height - 1}}) {
    const auto xy = cells.position_m.at<cv::Vec2f>(at);
    const Eigen::Vector3d p_W(xy[0], xy[1], 0);
    const Eigen::Vector2d px = geometry.camera.project(p_W);
    CHECK(px.x() == Approx(side * at.x + (side - 1) / 2.0).margin(1e-3));
    CHECK(px.y() == Approx(side * at.y + (side - 1) / 2.0).margin(1e-3));
    const Eigen::Vector3d wo = geometry.camera.position() - p_W;
    CHECK(cells.cos_o.at<float>(at) == Approx(wo.z() / wo.norm()).epsilon(1e-5));
    for (std::size_t l = 0; l < 2; ++l) {
      const Eigen::Vector3d wi = geometry.lights_W[l] - p_W;
      const auto a = cells.angles[l].at<cv::Vec3f>(at);
      CHECK(cells.cos_i[l].at<float>(at) == Approx(wi.z() / wi.norm()).epsilon(1e-5));
      CHECK(2 * a[1] == Approx(angle(wi, wo)).margin(1e-5));
      CHECK(
          a[0] ==
          Approx(angle(wi.normalized() + wo.normalized(), Eigen::Vector3d::UnitZ())).margin(1e-5));
    }
  }
}

TEST_CASE("the middle of the plane mirrors light 1 into the camera") {
  const SensorFormat sensor = sensor_of(91, 71, Mosaic::mono);
  const auto cells = cell_geometry(make_geometry(default_rig(), sensor), sensor, {1, 1});
  const auto a = cells.angles[0].at<cv::Vec3f>(35, 45);
  CHECK(a[0] == Approx(0).margin(1e-6));
  CHECK(a[1] == Approx(55 * kDeg).margin(1e-6));
  CHECK(cells.angles[1].at<cv::Vec3f>(35, 45)[1] == Approx(17.5 * kDeg).margin(1e-6));
}

TEST_CASE("only the inspected rectangle is inside") {
  const SensorFormat sensor = sensor_of(728, 544, Mosaic::mono);
  const auto cells =
      cell_geometry(make_geometry(default_rig(), sensor), sensor, cv::Size2d(0.04, 0.02));
  int inside = 0;
  for (int v = 0; v < sensor.height; ++v) {
    for (int u = 0; u < sensor.width; ++u) {
      const auto xy = cells.position_m.at<cv::Vec2f>(v, u);
      const bool in = std::abs(xy[0]) <= 0.02F && std::abs(xy[1]) <= 0.01F;
      inside += in ? 1 : 0;
      if ((cells.inside.at<unsigned char>(v, u) == 255) != in) FAIL("cell " << u << ", " << v);
    }
  }
  CHECK(inside > 1000);
}

TEST_CASE("cells that look past the plane's horizon are outside and finite") {
  NominalRig rig = default_rig();
  rig.camera_deg = 84;
  const SensorFormat sensor = sensor_of(64, 64, Mosaic::mono);
  const auto cells = cell_geometry(make_geometry(rig, sensor), sensor, cv::Size2d(100, 100));
  CHECK(cells.inside.at<unsigned char>(0, 32) == 0);  // up: 84 + 12.4 degrees from the normal
  CHECK(cells.inside.at<unsigned char>(63, 32) == 255);
  CHECK(cv::checkRange(cells.position_m));
  CHECK(cv::checkRange(cells.angles[0]));
}

TEST_CASE("a light below a point's horizon puts it outside") {
  NominalRig rig = default_rig();
  rig.lights = {{55, 180, 0.3}, {95, 0, 0.3}};
  const SensorFormat sensor = sensor_of(32, 32, Mosaic::mono);
  const auto cells = cell_geometry(make_geometry(rig, sensor), sensor, {1, 1});
  CHECK(cv::countNonZero(cells.inside) == 0);
}

TEST_CASE("an impossible rig is refused by its field") {
  const SensorFormat sensor = sensor_of(64, 48, Mosaic::mono);
  NominalRig rig = default_rig();
  rig.fov_deg = 180;
  CHECK(test::contains(test::input_error([&] { return make_geometry(rig, sensor); }),
                       "field_of_view_deg"));
  rig = default_rig();
  rig.camera_m = 0;
  CHECK(test::contains(test::input_error([&] { return make_geometry(rig, sensor); }), "distance"));
  rig = default_rig();
  rig.camera_deg = 90;
  CHECK(
      test::contains(test::input_error([&] { return make_geometry(rig, sensor); }), "polar angle"));
  CHECK(test::contains(
      test::input_error([&] { return make_geometry(default_rig(), SensorFormat{}); }), "0 x 0"));
}

TEST_CASE("a distorting lens maps there and back, and projects as OpenCV's formula says") {
  LensDistortion lens{.k1 = -0.2, .k2 = 0.08, .p1 = 0.001, .p2 = -0.002, .k3 = 0.01};
  for (const double x : {-0.3, 0.0, 0.25}) {
    for (const double y : {-0.2, 0.1, 0.3}) {
      const Eigen::Vector2d ideal(x, y);
      CHECK((lens.remove(lens.apply(ideal)) - ideal).norm() < 1e-11);
    }
  }
  // Radius 0.5 along x: 0.5 (1 - 0.2/4 + 0.08/16 + 0.01/64) + p2 (0.25 + 2 * 0.25).
  const Eigen::Vector2d edge = lens.apply({0.5, 0});
  CHECK(edge.x() == Approx(0.5 * (1 - 0.05 + 0.005 + 0.01 / 64) - 0.002 * 0.75));
  CHECK(edge.y() == Approx(0.001 * 0.25));
  CHECK(LensDistortion{}.none());
}
