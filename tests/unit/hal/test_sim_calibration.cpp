#include <algorithm>
#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "hal/sim/part.hpp"
#include "model/reflectance.hpp"
#include "support/input_error.hpp"
#include "support/sim_calibration.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using Eigen::Vector3d;

namespace {

/// A bench that nobody built quite as drawn.
SimDeviation crooked() {
  SimDeviation d;
  d.camera_m = Vector3d(0.003, -0.002, 0.004);
  d.camera_deg = Vector3d(0.4, -0.3, 0.5);
  d.focal = 0.01;
  d.centre_px = Eigen::Vector2d(6, -5);
  d.distortion = {.k1 = -0.08, .k2 = 0.1, .p1 = 0.0005, .p2 = -0.0004};
  d.lights_m = {Vector3d(0.008, -0.006, 0.010), Vector3d(-0.007, 0.009, -0.008)};
  d.aim_m = {Vector3d(0.004, 0.003, 0), Vector3d(-0.003, 0.005, 0)};
  return d;
}

std::vector<NamedCapture> boards(SimStation& station, BoardKind kind) {
  std::vector<NamedCapture> out;
  Scene scene = target_scene(SceneTarget::board);
  scene.board = kind;
  for (int i = 0; i < 7; ++i) {
    out.push_back({"board " + std::to_string(i), record(station, scene, 5, i)});
    scene.jitter = {.shift_mm = {12, 12}, .rotation_deg = 10, .tilt_deg = {20, 20}, .height_mm = 3};
  }
  return out;
}

Calibration levelled(const SimBenchSettings& s, SimStation& station, int whites) {
  Scene dark = target_scene(SceneTarget::black);
  dark.lights_on = false;
  CalibrationInput input;
  input.darks = {record(station, dark, 1, 0), record(station, dark, 1, 1)};
  for (int i = 0; i < whites; ++i) {
    input.whites.push_back(
        record(station, target_scene(SceneTarget::white), 2, static_cast<std::uint64_t>(i)));
  }
  input.geometry = drawn_geometry(s);
  input.nominal = s.noise;
  return calibrate(input);
}

/// A bench calibrated from its recordings alone, once for all tests.
struct Calibrated {
  SimBenchSettings settings = shipped_bench(0.5, crooked());
  SimStation station{settings};
  Calibration calibration;
  GeometryResult found;

  Calibrated() {
    calibration = levelled(settings, station, 4);
    GeometryInput input;
    input.boards = boards(station, BoardKind::checker);
    input.mirrors = {{"mirror", record(station, target_scene(SceneTarget::mirror), 3, 0)}};
    input.plate_m = {0.09, 0.09};
    Scene raised = target_scene(SceneTarget::white);
    raised.pose.height_mm = 10;
    input.raised = {{0.010, {"raised white", record(station, raised, 4, 0)}}};
    found = calibrate_geometry(input, calibration);
  }
};

Calibrated& bench() {
  static Calibrated once;
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

/// |measured / true - 1| of f by blocks of 8 x 8 cells, both lights, sorted: photon noise is
/// averaged out, what remains is what the calibration got wrong.
std::vector<double> block_errors(const SimBenchSettings& s, const std::vector<Reflectance>& f,
                                 const Brdf& brdf, const ScenePose& pose) {
  const Eigen::Isometry3d X_WP = part_pose(pose);
  const Eigen::Isometry3d X_PW = X_WP.inverse();
  const Vector3d eye = X_PW * s.geometry.camera.position();
  std::vector<double> out;
  for (std::size_t l = 0; l < f.size(); ++l) {
    const Vector3d light = X_PW * s.geometry.lights_W[l];
    for (int v0 = 0; v0 + 8 <= f[l].value.rows; v0 += 8) {
      for (int u0 = 0; u0 + 8 <= f[l].value.cols; u0 += 8) {
        Rgb seen = Rgb::Zero(), truth = Rgb::Zero();
        bool inside = true;
        for (int k = 0; k < 64; ++k) {
          const int u = u0 + k % 8, v = v0 + k / 8;
          const Vector3d ray =
              X_PW.linear() * s.geometry.camera.ray_W(cell_centre_px(s.sensor, u, v));
          const Vector3d p = eye - eye.z() / ray.z() * ray;
          inside = inside && std::abs(p.x()) < 0.04 && std::abs(p.y()) < 0.04 &&
                   f[l].mask.at<std::uint8_t>(v, u) == 0;
          if (!inside) break;
          const auto& x = f[l].value.at<cv::Vec3f>(v, u);
          seen += Rgb(x[0], x[1], x[2]);
          truth += brdf.eval(to_half_diff({(light - p).normalized(), (eye - p).normalized()}));
        }
        if (!inside) continue;
        for (int c = 0; c < 3; ++c)
          out.push_back(std::abs(seen[c] / truth[c] - 1));
      }
    }
  }
  std::sort(out.begin(), out.end());
  return out;
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
  Calibrated& b = bench();
  const BrdfPtr gloss = make_brdf(GgxParameters{Rgb(0.3, 0.2, 0.1), Rgb::Constant(0.04), 0.3});
  const BrdfPtr matt = make_brdf(LambertParameters{Rgb(0.6, 0.4, 0.3)});
  ScenePose raised, tilted;
  raised.height_mm = 2;
  tilted.tilt_deg = {0.5, -0.5};
  for (const BrdfPtr& brdf : {gloss, matt}) {
    for (const ScenePose& pose : {ScenePose{}, raised, tilted}) {
      Scene scene = target_scene(SceneTarget::part);
      scene.part_size_mm = {200, 200};
      scene.materials = {{"body", brdf}};
      scene.pose = pose;
      Capture capture = record(b.station, scene, 6, 0);
      capture.sensor = b.calibration.sensor;
      const double deg = std::numbers::pi / 180;
      const PartPlane plane{pose.height_mm / 1e3, {pose.tilt_deg[0] * deg, pose.tilt_deg[1] * deg}};
      const auto f =
          to_reflectance(to_radiance(capture, b.calibration.noise, 2), b.calibration, plane);
      const std::vector<double> errors = block_errors(b.settings, f, *brdf, pose);
      REQUIRE(errors.size() > 1000);
      INFO("height " << pose.height_mm << " tilt " << pose.tilt_deg[0]);
      CHECK(errors[errors.size() / 2] < 0.01);
      CHECK(errors[errors.size() * 95 / 100] < 0.03);
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
