#include <algorithm>
#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "hal/sim/part.hpp"
#include "model/reflectance.hpp"
#include "support/input_error.hpp"
#include "support/station_accuracy.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using Eigen::Vector3d;

namespace {

/// Calibrated once for all tests.
using Calibrated = CalibratedBench;
Calibrated& bench() {
  static Calibrated once(0.5, 4);
  return once;
}

/// Worst distance in sensor pixels between where two cameras see points of the plane.
double worst_projection(const PinholeCamera& a, const PinholeCamera& b) {
  double worst = 0;
  for (const double x : {-0.035, 0.0, 0.035}) {
    for (const double y : {-0.035, 0.0, 0.035})
      worst = std::max(worst, (a.project({x, y, 0}) - b.project({x, y, 0})).norm());
  }
  return worst;
}

}  // namespace

TEST_CASE("the camera of a bench built otherwise than drawn is found from its board") {
  const Calibrated& b = bench();
  const PinholeCamera& truth = b.settings.geometry.camera;
  const PinholeCamera& found = b.calibration.geometry.camera;
  CHECK(b.found.camera->rms_px < 0.2);
  CHECK(worst_projection(found, truth) < 0.3);
  CHECK((found.position() - truth.position()).norm() < 0.003 * 0.18);
  CHECK(b.calibration.quality.camera.source == GeometrySource::fitted);
  // Where it was thought to be is far off: nothing of the truth was handed over.
  CHECK(worst_projection(drawn_geometry(b.settings).camera, truth) > 20);
}

TEST_CASE("a ChArUco board that is partly out of view gives the camera too") {
  Calibrated& b = bench();
  Calibration c = b.calibration;
  c.geometry = drawn_geometry(b.settings);
  c.quality = {};
  GeometryInput input;
  input.pattern.kind = BoardKind::charuco;
  Scene scene = target_scene(SceneTarget::board);
  scene.board = BoardKind::charuco;
  for (const double y : {0.0, 35.0}) {
    scene.pose.shift_mm = {0, y};
    input.boards.push_back({"board", record(b.station, scene, 9, 0)});
  }
  input.by_hand.lights_W = {b.settings.geometry.lights_W[0], b.settings.geometry.lights_W[1]};
  const GeometryResult found = calibrate_geometry(input, c);
  CHECK_FALSE(found.camera->intrinsics);  // two views fit the pose alone
  CHECK(found.camera->view_rms_px.size() == 2);
  CHECK(found.camera->errors_px[1].size() < found.camera->errors_px[0].size());
}

TEST_CASE("lights are found within a hundredth of their distance from falloff and highlight") {
  const Calibrated& b = bench();
  for (std::size_t l = 0; l < 2; ++l) {
    const Vector3d off = b.calibration.geometry.lights_W[l] - b.settings.geometry.lights_W[l];
    INFO("light " << l + 1 << " off by mm " << 1e3 * off.transpose());
    CHECK(off.norm() < 0.01 * b.settings.geometry.lights_W[l].norm());
    CHECK(b.found.lights->lights[l].rms < 0.003);
  }
  CHECK(b.found.highlights.size() == 1);
  CHECK(b.found.lights->lights[0].from_highlight);
}

TEST_CASE("reflectance is right at the reference's height, above it and tilted") {
  // tests/station makes the whole table; here two materials, and what two repeats cannot tell is
  // left to the next test.
  Calibrated& b = bench();
  const auto whites = fresh_whites(b, 2, 1);
  const std::vector<KnownMaterial> known = known_materials();
  for (const KnownMaterial& material : {known[0], known[2]}) {
    for (const KnownPose& pose : known_poses()) {
      for (const Accuracy& a : accuracy_of(b, material.brdf, pose.pose, whites)) {
        INFO(material.name << ", " << pose.name);
        REQUIRE(a.blocks.count > 1000);
        CHECK(a.blocks.median < 0.01);
        CHECK(a.blocks.p95 < 0.03);
      }
    }
  }
}

TEST_CASE("the sigma of reflectance is the scatter of repeats, white reference and all") {
  CalibratedBench small(0.25, 4);
  const auto whites = fresh_whites(small, 20, 2);
  for (const KnownMaterial& material : {known_materials()[1], known_materials()[3]}) {
    for (const Accuracy& a : accuracy_of(small, material.brdf, {}, whites)) {
      INFO(material.name);
      CHECK(a.sigma_ratio == Approx(1).margin(0.1));
      CHECK(a.averaged.median < 0.01);
      CHECK(a.averaged.p95 < 0.03);
    }
  }
}

TEST_CASE("bad calibration captures are named") {
  Calibrated& b = bench();
  Calibration c = b.calibration;
  c.geometry.lights_W = drawn_geometry(b.settings).lights_W;
  GeometryInput input;
  input.plate_m = {0.09, 0.09};
  input.by_hand.camera = b.calibration.geometry.camera;
  const auto refusal = [&] {
    Calibration copy = c;
    return input_error([&] { return calibrate_geometry(input, copy); });
  };
  SECTION("a reference in shadow") {
    c.white[1].value = c.white[1].value.clone();
    c.white[1].value(cv::Rect(150, 100, 40, 40)) *= 0.7;
    CHECK_THAT(refusal(), Catch::Contains("light 2") && Catch::Contains("in shadow or dirty"));
  }
  SECTION("a bent reference") {
    // A sag of 1 mm over 90 mm: the normal turns by up to 2.5 degrees along y.
    for (std::size_t l = 0; l < 2; ++l) {
      c.white[l].value = c.white[l].value.clone();
      const Eigen::Vector3d light = b.settings.geometry.lights_W[l];
      for (int v = 0; v < c.white[l].value.rows; ++v) {
        for (int u = 0; u < c.white[l].value.cols; ++u) {
          const Vector3d eye = b.settings.geometry.camera.position();
          const Vector3d ray = b.settings.geometry.camera.ray_W(cell_centre_px(c.sensor, u, v));
          const Vector3d p = eye - eye.z() / ray.z() * ray;
          const double slope = 8 * 0.001 * p.x() / (0.09 * 0.09);
          const Vector3d n = Vector3d(slope, 0, 1).normalized();
          const Vector3d to = (light - p).normalized();
          c.white[l].value.at<cv::Vec3f>(v, u) *= static_cast<float>(n.dot(to) / to.z());
        }
      }
    }
    CHECK_THAT(refusal(), Catch::Contains("bent"));
  }
  SECTION("a board out of the image") {
    input.by_hand.camera.reset();
    Scene scene = target_scene(SceneTarget::board);
    scene.pose.shift_mm = {0, 40};
    input.boards = {{"part_0001", record(b.station, scene, 7, 0)}};
    CHECK_THAT(refusal(), Catch::Contains("part_0001") && Catch::Contains("no whole checkerboard"));
  }
  SECTION("a first board that does not lie in the nest") {
    input.by_hand.camera.reset();
    Scene scene = target_scene(SceneTarget::board);
    scene.pose.tilt_deg = {0, 12};
    input.boards = {{"part_0001", record(b.station, scene, 7, 0)}};
    CHECK_THAT(refusal(), Catch::Contains("flat in the nest"));
  }
  SECTION("no mirror where a mirror should be") {
    input.mirrors = {{"mirror", record(b.station, target_scene(SceneTarget::white), 7, 0)}};
    CHECK_THAT(refusal(), Catch::Contains("shows no highlight"));
  }
}
