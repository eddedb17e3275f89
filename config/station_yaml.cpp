// The way back: a resolved configuration as text that read_station_config takes.
#include <array>
#include <charconv>

#include "config/camera_yaml.hpp"
#include "config/judge_yaml.hpp"
#include "config/lines_yaml.hpp"
#include "config/sensor_yaml.hpp"
#include "config/station_config.hpp"
#include "config/yaml_reader.hpp"

namespace brdfgate {
namespace {

using YAML::Emitter;

/// A length or time that is kept in SI units, back in the file's: fifteen digits hide the rounding
/// of the conversion (14.8, not 14.799999999999999) and read back to the same figure.
std::string converted(double value) {
  std::array<char, 40> text{};
  const auto end =
      std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general, 15)
          .ptr;
  return {text.data(), end};
}

void put(Emitter& out, const char* key, const std::string& value) {
  out << YAML::Key << key << YAML::Value << value;
}

void put(Emitter& out, const char* key, double value) {
  put(out, key, number_text(value));
}

void put(Emitter& out, const char* key, int value) {
  put(out, key, std::to_string(value));
}

void put(Emitter& out, const char* key, bool value) {
  put(out, key, std::string(value ? "true" : "false"));
}

template <typename Values, typename Text>
void put_list(Emitter& out, const char* key, const Values& values, const Text& text) {
  out << YAML::Key << key << YAML::Value << YAML::Flow << YAML::BeginSeq;
  for (const auto& value : values)
    out << text(value);
  out << YAML::EndSeq;
}

template <typename Fields>
void put_map(Emitter& out, const char* key, const Fields& fields) {
  out << YAML::Key << key << YAML::Value << YAML::BeginMap;
  fields();
  out << YAML::EndMap;
}

std::string path_text(const std::filesystem::path& path) {
  return path.string();
}

void put_camera(Emitter& out, const CameraConfig& camera) {
  put(out, "backend", camera_backend_names().at(static_cast<std::size_t>(camera.backend)));
  put_map(out, "sensor", [&] {
    put(out, "width", camera.sensor.width);
    put(out, "height", camera.sensor.height);
    put(out, "bits", camera.sensor.bits);
    put(out, "mosaic", mosaic_name(camera.sensor.mosaic));
    put(out, "black_level_dn", camera.sensor.black_level_dn);
    put(out, "full_well_dn", camera.sensor.full_well_dn);
    put(out, "gain_dn_per_electron", camera.noise.gain_dn_per_e);
    put(out, "read_noise_dn", camera.noise.read_noise_dn);
    put(out, "response", std::string(camera.tone_curve ? "tone_curve" : "linear"));
  });
  put_list(out, "bracket_ms", camera.bracket_ms, number_text);
  put_list(out, "ambient_ms", camera.ambient_ms, number_text);
  put(out, "gain", camera.gain);
  put(out, "frame_timeout_ms", camera.frame_timeout_ms);
  if (camera.backend != CameraBackend::simulated) return put_camera_device(out, camera);
  put_list(out, "scenes", camera.scenes, path_text);
  put(out, "seed", std::to_string(camera.seed));
}

void put_rig(Emitter& out, const NominalRig& rig) {
  put_map(out, "camera", [&] {
    put(out, "theta_deg", rig.camera_deg);
    put(out, "distance_mm", converted(rig.camera_m * 1000));
  });
  put(out, "field_of_view_deg", rig.fov_deg);
  out << YAML::Key << "lights" << YAML::Value << YAML::BeginSeq;
  for (const NominalRig::Light& light : rig.lights) {
    out << YAML::BeginMap;
    put(out, "theta_deg", light.theta_deg);
    put(out, "phi_deg", light.phi_deg);
    put(out, "distance_mm", converted(light.distance_m * 1000));
    out << YAML::EndMap;
  }
  out << YAML::EndSeq;
}

template <typename Vector>
void put_vector(Emitter& out, const char* key, const Vector& values, double scale = 1) {
  put_list(out, key, values, [&](double value) { return converted(value * scale); });
}

void put_points_mm(Emitter& out, const char* key, const std::vector<Eigen::Vector3d>& points_m) {
  if (points_m.empty()) return;
  out << YAML::Key << key << YAML::Value << YAML::BeginSeq;
  for (const Eigen::Vector3d& p : points_m) {
    out << YAML::Flow << YAML::BeginSeq;
    for (const double metres : p)
      out << converted(metres * 1000);
    out << YAML::EndSeq;
  }
  out << YAML::EndSeq;
}

void put_deviation(Emitter& out, const SimDeviation& d) {
  put_vector(out, "camera_mm", d.camera_m, 1000);
  put_vector(out, "camera_deg", d.camera_deg);
  put(out, "focal", d.focal);
  put_vector(out, "centre_px", d.centre_px);
  put_vector(out, "distortion",
             std::array{d.distortion.k1, d.distortion.k2, d.distortion.p1, d.distortion.p2,
                        d.distortion.k3});
  put_points_mm(out, "lights_mm", d.lights_m);
  put_points_mm(out, "aim_mm", d.aim_m);
}

void put_simulator(Emitter& out, const SimBenchSettings& sim) {
  put(out, "full_well_e", sim.full_well_e);
  put(out, "dark_current_e_s", sim.dark_current_e_s);
  put(out, "line_time_us", converted(sim.line_time_s * 1e6));
  put(out, "vignetting", sim.vignetting);
  put(out, "led_radius_mm", converted(sim.led_radius_m * 1000));
  put(out, "white_exposure_ms", converted(sim.white_exposure_s * 1000));
  if (sim.camera_rgb != Eigen::Matrix3d::Identity()) {
    const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> m = sim.camera_rgb;
    put_list(out, "camera_rgb", m.reshaped<Eigen::RowMajor>(), number_text);
  }
  put(out, "light_rise_ms", converted(sim.light_rise_s * 1000));
  if (!sim.camera_fault_file.empty()) {
    put(out, "camera_fault_file", path_text(sim.camera_fault_file));
  }
  if (sim.gamma != 1) put(out, "gamma", sim.gamma);
  if (!(sim.deviation == SimDeviation{})) {
    put_map(out, "deviation", [&] { put_deviation(out, sim.deviation); });
  }
}

void put_monitor(Emitter& out, const MonitorPatch& patch) {
  put_vector(out, "at_mm", patch.at_m, 1000);
  put_vector(out, "size_mm", patch.size_m, 1000);
  put_list(out, "albedo", patch.albedo, number_text);
  put(out, "max_drift", patch.max_drift);
}

void put_inspection(Emitter& out, const InspectionConfig& inspection) {
  put_list(out, "region_mm", inspection.region_mm, number_text);
  put_map(out, "fixture", [&] {
    const auto& albedo = inspection.fixture.reflectance;
    put_list(out, "albedo", std::array{albedo[0], albedo[1], albedo[2]}, number_text);
    put(out, "tolerance", inspection.fixture.tolerance);
  });
  put(out, "max_clusters", inspection.max_clusters);
  put(out, "method", inspection.method);
  put(out, "eta", inspection.eta);
  put(out, "fixture_tilt_sigma_deg", inspection.fixture_tilt_sigma_deg);
  put(out, "fixture_height_sigma_mm", inspection.fixture_height_sigma_mm);
  put(out, "part_height_mm", inspection.part_height_mm);
  if (inspection.monitor) {
    put_map(out, "monitor", [&] { put_monitor(out, *inspection.monitor); });
  }
  static constexpr std::array<const char*, 3> kColour{"none", "linear_srgb_d65", "chart"};
  put(out, "colour", std::string(kColour.at(static_cast<std::size_t>(inspection.colour))));
}

void put_judge(Emitter& out, const JudgeSettings& judge) {
  for (const auto& [key, value] : judge_settings_text(judge))
    put(out, key.c_str(), value);
}

void put_plc(Emitter& out, const PlcConfig& plc) {
  put_map(out, "tcp", [&] {
    put(out, "enabled", plc.tcp.enabled);
    put(out, "bind", plc.tcp.bind);
    put(out, "port", plc.tcp.port);
    put_list(out, "allow", plc.tcp.allow, [](const std::string& address) { return address; });
    put(out, "max_clients", plc.tcp.max_clients);
    put(out, "request_deadline_ms", plc.tcp.request_deadline_ms);
    put(out, "idle_timeout_s", plc.tcp.idle_timeout_s);
  });
  put(out, "unit_id", plc.unit_id);
  put(out, "word_order", std::string(plc.word_order == WordOrder::abcd ? "abcd" : "cdab"));
  put(out, "handshake_timeout_s", plc.handshake_timeout_s);
  put(out, "heartbeat_timeout_s", plc.heartbeat_timeout_s);
}

void put_files(Emitter& out, const StationConfig::Files& files) {
  put(out, "basis", path_text(files.basis));
  put(out, "calibration", path_text(files.calibration));
  put_list(out, "recipes", files.recipes, path_text);
  put(out, "state_dir", path_text(files.state_dir));
}

}  // namespace

std::string to_yaml(const StationConfig& config) {
  Emitter out;
  out << YAML::BeginMap;
  put(out, "station", config.name);
  put_map(out, "camera", [&] { put_camera(out, config.camera); });
  put_map(out, "rig", [&] { put_rig(out, config.rig); });
  if (config.camera.backend == CameraBackend::simulated) {
    put_map(out, "simulator", [&] { put_simulator(out, config.simulator); });
  }
  put_lines(out, config);
  put_map(out, "inspection", [&] { put_inspection(out, config.inspection); });
  put_map(out, "judge", [&] { put_judge(out, config.judge); });
  put_map(out, "upkeep", [&] {
    put(out, "max_age_days", config.upkeep.max_age_days);
    put(out, "grace_days", config.upkeep.grace_days);
  });
  put_map(out, "plc", [&] { put_plc(out, config.plc); });
  put_map(out, "files", [&] { put_files(out, config.files); });
  out << YAML::EndMap;
  return std::string(out.c_str()) + "\n";
}

}  // namespace brdfgate
