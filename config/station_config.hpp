// The station's configuration: plain data with units and ranges; config/station.yaml is the model.
// Ranges include their ends; (a, b) excludes them.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "hal/camera_settings.hpp"
#include "hal/gpio/gpio_settings.hpp"
#include "hal/sim/sim_station.hpp"
#include "model/geometry.hpp"
#include "model/monitor_patch.hpp"
#include "model/recipe.hpp"
#include "model/regions.hpp"

namespace brdfgate {

enum class CameraBackend { simulated, v4l2, libcamera };
/// How camera RGB becomes colour: not at all, as declared, or by a chart in the calibration alone.
enum class ColourSource { none, linear_srgb_d65, chart };
enum class WordOrder { abcd, cdab };  ///< of u32 and float32: big-endian words first, or swapped

struct CameraConfig {
  CameraBackend backend = CameraBackend::simulated;
  CameraDeviceSettings device;  ///< v4l2 and libcamera only; ranges: config/camera_yaml.hpp
  SensorFormat sensor;          ///< ranges: config/sensor_yaml.hpp
  /// Datasheet values; the calibration's measured ones override them. Gain (0, 1000) DN per
  /// electron, read noise 0..1000 DN.
  SensorNoise noise;
  /// The camera's counts follow a tone curve (gamma), which the calibration recovers; 8 to 10 bits.
  bool tone_curve = false;         ///< optional
  std::vector<double> bracket_ms;  ///< exposures under each light, (0, 60000) ms, rising, 1..16
  std::vector<double> ambient_ms;  ///< exposures without light, (0, 60000) ms, rising, 1..16
  double gain = 1;                 ///< analogue, linear, 1..64
  double frame_timeout_ms = 1000;  ///< 1..120000, above every exposure; optional
  std::vector<std::filesystem::path> scenes;  ///< simulated only: by trigger_id or in turn, 1..1000
  std::uint64_t seed = 1;                     ///< simulated only, 0..2^63 - 1; optional
};

struct InspectionConfig {
  /// Inspected rectangle on the plane, centred on the origin, x and y: (0, 10000) mm; the middle of
  /// each edge lies in the image.
  std::array<double, 2> region_mm{};
  FixtureAppearance fixture;  ///< albedo 0..1 per channel, tolerance (0, 1)
  int max_clusters = 8;       ///< 1..8
  std::string method = "gp";  ///< of estimator_names(); empty: the basis' first
  double eta = 40;            ///< ridge penalty for 298 samples, (0, 1e6)
  /// How well the fixture seats parts, standard deviations: [0, 10) degrees about each axis, [0,
  /// 10) mm; 0: taken as perfect, not estimated.
  double fixture_tilt_sigma_deg = 0.3;
  double fixture_height_sigma_mm = 0;
  /// Height of the parts' surface over the white reference's, -50..50 mm; optional, 0.
  double part_height_mm = 0;
  /// A white patch in view, optional: at_mm -1000..1000, size_mm (0, 1000), albedo (0, 1] per
  /// channel, max_drift (0, 1).
  std::optional<MonitorPatch> monitor;
  /// Never with a mono sensor. What a chart in the calibration says outranks a declaration.
  ColourSource colour = ColourSource::none;
};

/// steady: a light burns for its whole bracket; pulsed: for one exposure at a time.
enum class LightsMode { steady, pulsed };

struct LightsConfig {
  GpioLightsSettings gpio;  ///< settle and max_on hold for simulated lights too
  LightsMode mode = LightsMode::steady;
};

struct TriggerConfig {
  GpioTriggerSettings gpio;
  /// The PLC's trigger_enable must be set and results be acknowledged. False: a machine without a
  /// PLC; the line alone starts an inspection, and the next edge acknowledges the last result.
  bool needs_enable = true;
};

struct PlcConfig {
  struct Tcp {
    bool enabled = true;
    std::string bind = "127.0.0.1";     ///< IPv4 or IPv6 address of one of this machine's networks
    int port = 1502;                    ///< 1..65535, or 0 for any free one
    std::vector<std::string> allow;     ///< client addresses, IPv4 or IPv6; empty: everyone
    int max_clients = 8;                ///< 1..64
    double request_deadline_ms = 2000;  ///< from a request's first byte to its last, 10..60000
    double idle_timeout_s = 60;         ///< a silent client is dropped, 1..86400
  } tcp;
  int unit_id = 1;  ///< 1..247
  WordOrder word_order = WordOrder::abcd;
  double handshake_timeout_s = 10;  ///< a PLC that never acknowledges is released, 0.1..3600
  double heartbeat_timeout_s = 0;   ///< 0..3600; 0: plc_heartbeat is not watched; optional
};

/// How long a calibration holds; optional as a whole.
struct UpkeepConfig {
  int max_age_days = 0;  ///< 0..36500; 0: until the white reference's certificate ends
  int grace_days = 30;   ///< 0..36500, after it is due: a warning; then parts are not judged
};

struct StationConfig {
  std::string name;  ///< for people: 1..100 characters
  CameraConfig camera;
  /// Camera: theta 0..85 degrees, 0.001..10 m; field of view (0, 120) degrees; two lights, theta
  /// 0..85 degrees, phi -360..360 degrees, 0.001..10 m: 1 has its highlight inside the inspected
  /// region, 2 outside.
  NominalRig rig;
  /// Simulated only; sensor, noise, geometry and fixture are filled from the above. Optional as a
  /// whole. full_well_e (0, 1e7), dark_current_e_s 0..1e6, line time (0, 1000) us, vignetting
  /// 0..0.9, led_radius 0..100 mm, white_exposure (0, 60000) ms; light_rise 0..1000 ms, optional.
  SimBenchSettings simulator;
  LightsConfig lights;                   ///< optional with a simulated camera
  std::optional<TriggerConfig> trigger;  ///< a line of the machine beside the PLC's trigger bit
  std::optional<GpioOutputsSettings> outputs;
  InspectionConfig inspection;
  JudgeSettings judge;  ///< ranges: config/station.yaml
  UpkeepConfig upkeep;
  PlcConfig plc;
  struct Files {
    std::filesystem::path basis;
    std::filesystem::path calibration;
    /// No file twice; may be empty: everything is "not judged"; optional.
    std::vector<std::filesystem::path> recipes;
    std::filesystem::path state_dir;  ///< counters kept over restarts; created when missing
  } files;
  std::string hash;  ///< SHA-256 of the file's bytes, hex
  /// SHA-256 over what a calibration depends on (sensor, rig with its lights), hex.
  std::string station_hash;
};

/// Reads and validates. Strict: an unknown key, a missing key, a wrong type, a value out of range
/// or a contradiction is an InputError with file:line:column and the field's path. Relative paths
/// are relative to the file; the result has absolute ones. Whether the named files exist is for
/// those who open them.
StationConfig read_station_config(const std::filesystem::path& file);

/// The resolved configuration as YAML, every field with its value: what `brdfgate check` prints.
/// read_station_config takes it back to the same values.
std::string to_yaml(const StationConfig& config);

}  // namespace brdfgate
