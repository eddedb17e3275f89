// Calibration recordings of a simulated bench, as a technician would take them.
#pragma once

#include <string>
#include <vector>

#include "hal/sim/sim_station.hpp"
#include "model/geometry_calibration.hpp"

namespace brdfgate::test {

/// The shipped station at `scale` of its sensor's size, built other than drawn.
inline SimBenchSettings shipped_bench(double scale, const SimDeviation& deviation) {
  SimBenchSettings s;
  s.sensor = {.width = 2 * static_cast<int>(728 * scale),
              .height = 2 * static_cast<int>(544 * scale),
              .bits = 10,
              .mosaic = Mosaic::rggb,
              .black_level_dn = 60,
              .full_well_dn = 1023};
  s.noise = {.gain_dn_per_e = 0.0963, .read_noise_dn = 0.3};
  NominalRig rig;
  rig.lights = {{.theta_deg = 55, .phi_deg = 180, .distance_m = 0.3},
                {.theta_deg = 20, .phi_deg = 0, .distance_m = 0.3}};
  s.geometry = deviated(make_geometry(rig, s.sensor), deviation);
  s.aim_W = deviation.aim_m;
  s.deviation = deviation;
  return s;
}

inline StationGeometry drawn_geometry(const SimBenchSettings& s) {
  NominalRig rig;
  rig.lights = {{.theta_deg = 55, .phi_deg = 180, .distance_m = 0.3},
                {.theta_deg = 20, .phi_deg = 0, .distance_m = 0.3}};
  return make_geometry(rig, s.sensor);
}

/// The shipped exposures; a study may take others.
inline std::vector<double>& bracket_s() {
  static std::vector<double> times{0.03e-3, 0.4e-3, 5e-3, 60e-3};
  return times;
}

/// A dark recording, or one under no light and then each light.
inline Capture record(SimStation& station, const Scene& scene, std::uint64_t seed,
                      std::uint64_t index) {
  station.place(scene, seed, index);
  Capture capture{station.camera().format(), {}};
  const int lights = scene.lights_on ? station.lights().count() : 0;
  for (LightIndex light = 0; light <= lights; ++light) {
    if (light == kNoLight) {
      station.lights().all_off();
    } else {
      station.lights().on(light);
    }
    for (const double t : bracket_s()) {
      station.camera().arm({{.exposure_s = t}});
      capture.frames.push_back(station.camera().next_frame(std::chrono::seconds(10)));
      capture.frames.back().light = light;
    }
  }
  station.lights().all_off();
  return capture;
}

inline Scene target_scene(SceneTarget target) {
  Scene scene;
  scene.target = target;
  return scene;
}

}  // namespace brdfgate::test
