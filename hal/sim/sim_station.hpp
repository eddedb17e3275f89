// The simulated station: one bench that camera, lights and trigger share.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "hal/camera.hpp"
#include "hal/lights.hpp"
#include "hal/sim/scene.hpp"
#include "hal/trigger.hpp"
#include "model/geometry.hpp"
#include "model/monitor_patch.hpp"

namespace brdfgate {

/// How the simulated bench is built other than drawn: what a calibration has to find. Nothing by
/// default. Camera and lights deviate from the nominal rig, the world (the nest) stays.
struct SimDeviation {
  Eigen::Vector3d camera_m = Eigen::Vector3d::Zero();    ///< shift of the camera, in W
  Eigen::Vector3d camera_deg = Eigen::Vector3d::Zero();  ///< turn about its own x, then y, then z
  double focal = 0;                                      ///< relative change of the focal length
  Eigen::Vector2d centre_px = Eigen::Vector2d::Zero();
  LensDistortion distortion;
  std::vector<Eigen::Vector3d> lights_m;  ///< shift of each light in W; empty: none
  std::vector<Eigen::Vector3d> aim_m;     ///< where each light points, in W; empty: the origin
  bool operator==(const SimDeviation&) const = default;
};
/// The geometry as built.
StationGeometry deviated(const StationGeometry& nominal, const SimDeviation& deviation);

/// Physical properties of the simulated bench, fixed for its life.
struct SimBenchSettings {
  SensorFormat sensor;
  SensorNoise noise;
  double full_well_e = 10000;    ///< electrons at full_well_dn and analogue gain 1
  double dark_current_e_s = 5;   ///< electrons per second and pixel
  double line_time_s = 14.8e-6;  ///< exposures are whole lines, at least one
  double vignetting =
      0.15;  ///< loss of signal at the image's corner, growing with the square of the radius
  double gamma = 1;  ///< a tone curve after the sensor: count over black, share of the range, to 1
                     ///< / gamma
  StationGeometry geometry;              ///< true positions
  std::vector<Eigen::Vector3d> aim_W{};  ///< where each light points; empty: the origin
  double led_radius_m = 0.0005;          ///< emitter's disc
  double light_rise_s = 0;               ///< time constant of the lights' rise and fall; 0: at once
  double light_settle_s = 0;             ///< from switching until frames may count
  double white_exposure_s =
      0.008;  ///< a 0.99 Lambertian at the centre reaches half of full well in this
  Rgb fixture_albedo{0.01, 0.25, 0.40};
  /// What the camera's channels make of linear sRGB: rows red, green, blue. Fixture and monitor
  /// patch are given as the camera sees them.
  Eigen::Matrix3d camera_rgb = Eigen::Matrix3d::Identity();
  std::optional<MonitorPatch> patch{};  ///< on the fixture, Lambertian
  /// A file that says how the camera fails at the moment (hal/sim/camera_fault.hpp); empty: never.
  std::filesystem::path camera_fault_file{};
  SimDeviation deviation{};  ///< what geometry and aim_W were made with: for the record
};

/// Bench, camera and lights. A light that was not switched on leaves the frame dark. Deterministic:
/// part n of seed s is the same part with the same noise on every run. Rendering happens once per
/// part and light; a frame adds exposure, noise, quantisation and saturation. No real time passes:
/// timestamps run on the bench's own clock. A light's output follows its switch exponentially.
class SimStation {
 public:
  explicit SimStation(const SimBenchSettings& settings);
  ~SimStation();
  SimStation(const SimStation&) = delete;
  SimStation& operator=(const SimStation&) = delete;

  /// Puts part `index` (0, 1, ...) of the scene under the camera: draws pose, variation and noise
  /// from (seed, index).
  void place(const Scene& scene, std::uint64_t seed, std::uint64_t index);

  Camera& camera();
  Lights& lights();
  Trigger& trigger();
  /// Puts one edge on the simulated trigger line; safe from another thread.
  void fire_trigger();

  /// What was drawn for the part in place: for tests.
  struct Drawn {
    ScenePose pose;
    BrdfChange variation;
  };
  const Drawn& drawn() const;

 private:
  struct Bench;
  std::unique_ptr<Bench> bench_;
};

}  // namespace brdfgate
