// Colour from end to end on the simulated station: a chart under a camera that is not sRGB.
#include <Eigen/LU>
#include <algorithm>
#include <numbers>

#include "catch.hpp"
#include "model/camera_colour.hpp"
#include "support/input_error.hpp"
#include "support/sim_calibration.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

/// The shipped station on a quarter of its pixels, its channels as given.
struct ColourBench {
  SimBenchSettings settings = shipped_bench(0.25, {});
  std::unique_ptr<SimStation> station;
  Calibration calibration;

  explicit ColourBench(const Eigen::Matrix3d& camera_rgb) {
    settings.camera_rgb = camera_rgb;
    station = std::make_unique<SimStation>(settings);
    Scene dark = target_scene(SceneTarget::black);
    dark.lights_on = false;
    CalibrationInput input;
    input.darks = {record(*station, dark, 1, 0)};
    input.geometry = settings.geometry;
    input.nominal = settings.noise;
    for (std::uint64_t i = 0; i < 4; ++i)
      input.whites.push_back(record(*station, target_scene(SceneTarget::white), 2, i));
    calibration = calibrate(input);
  }

  std::vector<Reflectance> seen(const Scene& scene) {
    Capture capture = record(*station, scene, 3, 0);
    capture.sensor = calibration.sensor;
    return to_reflectance(to_radiance(capture, calibration.noise, 2), calibration);
  }
};

const Eigen::Matrix3d& wide_camera() {
  static const Eigen::Matrix3d m{{0.72, 0.23, 0.05}, {0.16, 0.74, 0.10}, {0.04, 0.20, 0.76}};
  return m;
}

}  // namespace

TEST_CASE("a chart gives a camera that is not sRGB its colours, and a part its own") {
  ColourBench bench(wide_camera());
  const auto rgb =
      chart_rgb(bench.seen(target_scene(SceneTarget::chart)), bench.calibration, classic_chart());
  for (const ColourModel model : {ColourModel::matrix, ColourModel::root_polynomial}) {
    const CameraColour colour = fit_camera_colour(rgb, classic_chart(), model);
    CHECK(colour.de00_mean < 0.5);
    CHECK(colour.de00_max < 1.5);
    CHECK(colour.illuminant == "D50");
    const Rgb albedo(0.42, 0.18, 0.09);
    Scene part = target_scene(SceneTarget::part);
    part.materials = {{"body", make_brdf(LambertParameters{albedo})}};
    const auto f = bench.seen(part);
    const cv::Rect middle(f[1].value.cols / 2 - 20, f[1].value.rows / 2 - 20, 40, 40);
    const cv::Scalar mean = cv::mean(f[1].value(middle));
    const Eigen::Array3d camera = std::numbers::pi * Eigen::Array3d(mean[0], mean[1], mean[2]);
    CHECK(delta_e00(xyz_to_lab(colour.xyz(camera)), linear_srgb_to_lab(albedo)) < 0.6);
    // As if the camera were sRGB, it would be far off.
    CHECK(delta_e00(linear_srgb_to_lab(camera), linear_srgb_to_lab(albedo)) > 5);
  }
}

TEST_CASE("a chart that is not where it should be is named") {
  ColourBench bench(Eigen::Matrix3d::Identity());
  Scene scene = target_scene(SceneTarget::chart);
  const auto refusal = [&](const Scene& s) {
    return input_error([&] {
      return fit_camera_colour(chart_rgb(bench.seen(s), bench.calibration, classic_chart()),
                               classic_chart(), ColourModel::matrix);
    });
  };
  SECTION("moved by half a patch") {
    scene.pose.shift_mm = {0, 7};
    CHECK_THAT(refusal(scene), Catch::Contains("is not uniform"));
  }
  SECTION("upside down") {
    scene.pose.rotation_deg = 180;
    CHECK_THAT(refusal(scene), Catch::Contains("upright and in its place"));
  }
  SECTION("none there") {
    CHECK_THAT(refusal(target_scene(SceneTarget::white)),
               Catch::Contains("upright and in its place"));
  }
}
