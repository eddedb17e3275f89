// A small simulated bench for tests: the product's rig in front of few, precise pixels.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <vector>

#include "hal/sim/sim_station.hpp"

namespace brdfgate::test {

inline constexpr double kBlackDn = 100;
inline constexpr double kDnPerElectron = 5;
inline constexpr double kWhiteExposureS = 0.008;

/// Sixteen bits at 5 DN per electron, so that quantisation is a tenth of an electron; no dark
/// current, no vignetting, a point emitter, 1 us lines. The world's origin lies exactly on the
/// centre of pixel (width / 2, height / 2).
inline SimBenchSettings precise_bench(int width = 64, int height = 48,
                                      Mosaic mosaic = Mosaic::mono) {
  SimBenchSettings s;
  s.sensor = {.width = width,
              .height = height,
              .bits = 16,
              .mosaic = mosaic,
              .black_level_dn = kBlackDn,
              .full_well_dn = 60000};
  s.noise = {.gain_dn_per_e = kDnPerElectron, .read_noise_dn = 2};
  s.full_well_e = 10000;
  s.dark_current_e_s = 0;
  s.line_time_s = 1e-6;
  s.vignetting = 0;
  s.led_radius_m = 0;
  s.white_exposure_s = kWhiteExposureS;
  NominalRig rig;
  rig.lights = {{.theta_deg = 55, .phi_deg = 180, .distance_m = 0.3},
                {.theta_deg = 20, .phi_deg = 0, .distance_m = 0.3}};
  s.geometry = make_geometry(rig, s.sensor);
  s.geometry.camera.centre_px = Eigen::Vector2d(width / 2, height / 2);
  return s;
}

inline SceneMaterial lambert_material(const std::string& name, const Rgb& albedo) {
  return {name, make_brdf(LambertParameters{albedo})};
}
inline SceneMaterial lambert_material(const std::string& name, double albedo) {
  return lambert_material(name, Rgb::Constant(albedo));
}

/// A noiseless scene of one target.
inline Scene scene_of(SceneTarget target) {
  Scene scene;
  scene.target = target;
  scene.sensor.noise = false;
  return scene;
}
inline Scene part_of(std::vector<SceneMaterial> materials) {
  Scene scene = scene_of(SceneTarget::part);
  scene.materials = std::move(materials);
  return scene;
}

/// One exposure under one light (or none) of what is in place.
inline RawFrame take(SimStation& station, LightIndex light, double exposure_s = kWhiteExposureS,
                     double gain = 1) {
  if (light == kNoLight) {
    station.lights().all_off();
  } else {
    station.lights().on(light);
  }
  station.camera().arm({{.exposure_s = exposure_s, .gain = gain}});
  RawFrame frame = station.camera().next_frame(std::chrono::seconds(10));
  station.lights().all_off();
  return frame;
}

inline RawFrame take(const SimBenchSettings& settings, const Scene& scene, LightIndex light,
                     double exposure_s = kWhiteExposureS) {
  SimStation station(settings);
  station.place(scene, 1, 0);
  return take(station, light, exposure_s);
}

/// Electrons of a count on the precise bench.
inline double electrons(const RawFrame& frame, int row, int column) {
  return (frame.counts.at<std::uint16_t>(row, column) - kBlackDn) / kDnPerElectron;
}
/// The same at the pixel nearest to the image of a world point.
inline double electrons_at(const SimBenchSettings& settings, const RawFrame& frame,
                           const Eigen::Vector3d& p_W) {
  const Eigen::Vector2d pixel = settings.geometry.camera.project(p_W);
  return electrons(frame, static_cast<int>(std::lround(pixel.y())),
                   static_cast<int>(std::lround(pixel.x())));
}

}  // namespace brdfgate::test
