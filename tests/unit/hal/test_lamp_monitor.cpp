// A white patch beside the part against lamps that drift, on the simulated station.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "model/lamp_monitor.hpp"
#include "model/reflectance.hpp"
#include "support/input_error.hpp"
#include "support/sim_calibration.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

MonitorPatch shipped_patch() {
  MonitorPatch patch;
  patch.at_m = {-0.056, 0};
  patch.size_m = {0.012, 0.012};
  return patch;
}

/// The shipped station on a quarter of its pixels with a patch, calibrated as drawn.
struct Watched {
  SimBenchSettings settings = shipped_bench(0.25, {});
  MonitorPatch patch = shipped_patch();
  std::unique_ptr<SimStation> station;
  Calibration calibration;

  explicit Watched(const Eigen::Array3d& really = Eigen::Array3d::Constant(0.9)) {
    settings.patch = patch;
    settings.patch->albedo = really;
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

  RadianceSet seen(const Scene& scene, std::uint64_t index = 0) {
    Capture capture = record(*station, scene, 3, index);
    capture.sensor = calibration.sensor;
    return to_radiance(capture, calibration.noise, 2);
  }
  std::vector<LampLevel> levels(const RadianceSet& set) {
    return lamp_levels(set.lights, calibration,
                       patch_cells(calibration.geometry, calibration.sensor, patch),
                       patch_reflectance(patch, calibration));
  }
};

Scene grey_part(double albedo) {
  Scene scene = target_scene(SceneTarget::part);
  scene.materials = {{"body", make_brdf(LambertParameters{Rgb::Constant(albedo)})}};
  return scene;
}

/// Mean reflectance over the middle of the image, all channels.
double middle(const Reflectance& f) {
  const cv::Rect block(f.value.cols / 2 - 20, f.value.rows / 2 - 20, 40, 40);
  const cv::Scalar mean = cv::mean(f.value(block));
  return (mean[0] + mean[1] + mean[2]) / 3;
}

}  // namespace

TEST_CASE("a patch tells each lamp's drift, whatever the part, and reflectance is freed of it") {
  Watched w;
  for (const auto& drift : {std::array{0.0, 0.0}, std::array{0.01, -0.01}, std::array{-0.2, 0.1}}) {
    for (const double albedo : {0.03, 0.6}) {
      Scene scene = grey_part(albedo);
      scene.light.drift = drift;
      scene.light.ambient = 0.01;
      const RadianceSet set = w.seen(scene);
      const auto levels = w.levels(set);
      REQUIRE(levels.size() == 2);
      std::vector<Eigen::Array3d> lamps;
      for (std::size_t l = 0; l < 2; ++l) {
        INFO("drift " << drift[l] << " albedo " << albedo << " light " << l + 1);
        CHECK(levels[l].known);
        CHECK(levels[l].drift() == Approx(drift[l]).margin(0.004));
        lamps.push_back(levels[l].ratio);
      }
      const auto f = to_reflectance(set, w.calibration, PartPlane{}, lamps);
      const auto uncorrected = to_reflectance(set, w.calibration, PartPlane{});
      for (std::size_t l = 0; l < 2; ++l) {
        INFO("drift " << drift[l] << " albedo " << albedo << " light " << l + 1);
        CHECK(middle(f[l]) == Approx(albedo / std::numbers::pi).epsilon(0.005));
        CHECK(middle(uncorrected[l]) ==
              Approx(albedo / std::numbers::pi * (1 + drift[l])).epsilon(0.003));
        // The sigma of a value follows its scale.
        const double scale = cv::mean(f[l].value)[1] / cv::mean(uncorrected[l].value)[1];
        CHECK(cv::mean(f[l].variance)[1] / cv::mean(uncorrected[l].variance)[1] ==
              Approx(scale * scale).epsilon(1e-4));
      }
    }
  }
}

TEST_CASE("a patch that is covered, soiled, clipped or out of view is not known") {
  Watched w;
  Scene scene = grey_part(0.3);
  SECTION("a part lies half over it") {
    scene.pose.shift_mm = {-16, 0};
  }
  SECTION("a part lies over a corner of it") {
    scene.pose.shift_mm = {-20, 42};
  }
  for (const LampLevel& level : w.levels(w.seen(scene))) {
    CHECK_FALSE(level.known);
    CHECK(std::isnan(level.drift()));
    CHECK((level.ratio == 1).all());
  }
}

TEST_CASE("clipped or unseen patches are not known") {
  Watched w;
  RadianceSet set = w.seen(grey_part(0.3));
  const auto cells = patch_cells(w.calibration.geometry, w.calibration.sensor, w.patch);
  const auto expected = patch_reflectance(w.patch, w.calibration);
  REQUIRE(cells.size() > 80);
  for (std::size_t i = 0; i < cells.size(); i += 2)
    set.lights[1].mask.at<unsigned char>(cells[i]) = kClipped;
  set.lights[1].mask.at<unsigned char>(cells[1]) = kClipped;
  const auto levels = lamp_levels(set.lights, w.calibration, cells, expected);
  CHECK(levels[0].known);
  CHECK_FALSE(levels[1].known);
  CHECK_FALSE(lamp_levels(set.lights, w.calibration, {}, expected)[0].known);
  const auto one_light = std::vector<Radiance>{set.lights[0]};
  CHECK_THAT(input_error([&] { return lamp_levels(one_light, w.calibration, cells, expected); }),
             Catch::Contains("2 as calibrated"));
}

TEST_CASE("a patch's own reflectance is measured in the open nest") {
  // Not what its maker says, and not grey.
  Watched w(Eigen::Array3d(0.93, 0.88, 0.80));
  Scene nest = target_scene(SceneTarget::part);
  nest.present = false;
  w.calibration.patch_f = measure_patch(w.seen(nest).lights, w.calibration, w.patch);
  REQUIRE(w.calibration.patch_f.size() == 2);
  CHECK((w.calibration.patch_f[0] * std::numbers::pi - Eigen::Array3d(0.93, 0.88, 0.80))
            .abs()
            .maxCoeff() < 0.004);
  Scene scene = grey_part(0.3);
  scene.light.drift = {0.02, 0};
  const auto levels = w.levels(w.seen(scene, 1));
  CHECK(levels[0].drift() == Approx(0.02).margin(0.004));
  CHECK(levels[1].drift() == Approx(0).margin(0.004));
  Scene covered = grey_part(0.3);
  covered.pose.shift_mm = {-16, 0};
  const RadianceSet set = w.seen(covered);
  CHECK_THAT(input_error([&] { return measure_patch(set.lights, w.calibration, w.patch); }),
             Catch::Contains("monitor patch under light 1") && Catch::Contains("covered"));
}
