#include "config/station_config.hpp"

#include <arpa/inet.h>

#include <algorithm>
#include <set>

#include "config/camera_yaml.hpp"
#include "config/judge_yaml.hpp"
#include "config/lines_yaml.hpp"
#include "config/sensor_yaml.hpp"
#include "config/station_checks.hpp"
#include "config/yaml_reader.hpp"
#include "model/estimators.hpp"
#include "model/hash.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

/// A response is a table of every count.
constexpr int kMostToneCurveBits = 10;

YamlRange between(double least, double most) {
  return {least, most, false};
}

YamlRange strictly_between(double least, double most) {
  return {least, most, true};
}

fs::path read_path(const YamlNode& node, const fs::path& folder) {
  const std::string text = node.as_text();
  if (text.empty()) node.fail("empty", "a path");
  return (folder / text).lexically_normal();
}

std::vector<fs::path> read_paths(const YamlNode& list, const fs::path& folder) {
  std::vector<fs::path> out;
  for (const YamlNode& node : list.items())
    out.push_back(read_path(node, folder));
  return out;
}

std::string read_name(const YamlNode& root) {
  const std::string name = root.text("station");
  const bool printable = std::none_of(name.begin(), name.end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20 || c == 0x7f;
  });
  if (name.empty() || name.size() > 100 || !printable) {
    root.fail_at("station", shown(name), "1 to 100 printable characters");
  }
  return name;
}

std::vector<double> read_exposures_ms(const YamlNode& camera, std::string_view key) {
  const YamlNode list = camera.at(key);
  const std::vector<YamlNode> nodes = list.items();
  if (nodes.empty() || nodes.size() > 16) {
    list.fail(std::to_string(nodes.size()) + " exposures", "1 to 16");
  }
  std::vector<double> out;
  for (const YamlNode& node : nodes) {
    const double ms = node.as_number(strictly_between(0, 60000));
    if (!out.empty() && ms <= out.back()) {
      node.fail(number_text(ms) + " after " + number_text(out.back()), "rising exposures");
    }
    out.push_back(ms);
  }
  return out;
}

void read_scenes(const YamlNode& node, const fs::path& folder, CameraConfig& camera) {
  const YamlNode scenes = node.at("scenes");
  camera.scenes = read_paths(scenes, folder);
  if (camera.scenes.empty() || camera.scenes.size() > 1000) {
    scenes.fail(std::to_string(camera.scenes.size()) + " scenes",
                "1 to 1000: the simulated camera needs something to see");
  }
  if (node.has("seed")) {
    camera.seed = static_cast<std::uint64_t>(node.integer64("seed", 0, INT64_MAX));
  }
}

CameraConfig read_camera(const YamlNode& node, const fs::path& folder) {
  CameraConfig camera;
  camera.backend = static_cast<CameraBackend>(node.choice("backend", camera_backend_names()));
  const YamlNode sensor = node.at("sensor");
  camera.sensor = read_sensor_format(sensor, "black_level_dn");
  camera.noise.gain_dn_per_e = sensor.number("gain_dn_per_electron", strictly_between(0, 1000));
  camera.noise.read_noise_dn = sensor.number("read_noise_dn", between(0, 1000));
  camera.tone_curve =
      sensor.has("response") && sensor.choice("response", {"linear", "tone_curve"}) == 1;
  if (camera.tone_curve && camera.sensor.bits > kMostToneCurveBits) {
    sensor.fail_at("response", "a tone curve with " + std::to_string(camera.sensor.bits) + " bits",
                   "at most " + std::to_string(kMostToneCurveBits) + " bits, or linear");
  }
  sensor.finish();
  camera.bracket_ms = read_exposures_ms(node, "bracket_ms");
  camera.ambient_ms = read_exposures_ms(node, "ambient_ms");
  camera.gain = node.number("gain", between(1, 64));
  camera.frame_timeout_ms =
      node.number_or("frame_timeout_ms", camera.frame_timeout_ms, between(1, 120000));
  const double longest = std::max(camera.bracket_ms.back(), camera.ambient_ms.back());
  if (camera.frame_timeout_ms <= longest) {
    node.fail_at("frame_timeout_ms",
                 number_text(camera.frame_timeout_ms) + " ends before the longest exposure",
                 "more than " + number_text(longest));
  }
  if (camera.backend == CameraBackend::simulated) {
    read_scenes(node, folder, camera);
  } else {
    read_camera_device(node, camera);
  }
  node.finish();
  return camera;
}

NominalRig::Light read_light(const YamlNode& node) {
  NominalRig::Light light;
  light.theta_deg = node.number("theta_deg", between(0, 85));
  light.phi_deg = node.number("phi_deg", between(-360, 360));
  light.distance_m = node.number("distance_mm", between(1, 10000)) / 1000;
  node.finish();
  return light;
}

NominalRig read_rig(const YamlNode& node) {
  NominalRig rig;
  const YamlNode camera = node.at("camera");
  rig.camera_deg = camera.number("theta_deg", between(0, 85));
  rig.camera_m = camera.number("distance_mm", between(1, 10000)) / 1000;
  camera.finish();
  rig.fov_deg = node.number("field_of_view_deg", strictly_between(0, 120));
  const YamlNode lights = node.at("lights");
  for (const YamlNode& light : lights.items())
    rig.lights.push_back(read_light(light));
  if (rig.lights.size() != 2) {
    lights.fail(std::to_string(rig.lights.size()) + " lights",
                "2: the mirror light (highlight), then the diffuse light");
  }
  node.finish();
  return rig;
}

Eigen::Vector3d point_mm(const YamlNode& node) {
  std::vector<double> mm;
  for (const YamlNode& value : node.items())
    mm.push_back(value.as_number(between(-1000, 1000)));
  if (mm.size() != 3) node.fail(std::to_string(mm.size()) + " numbers", "x, y and z in mm");
  return Eigen::Vector3d(mm.data()) / 1000;
}

std::vector<Eigen::Vector3d> points_mm(const YamlNode& node, std::string_view key) {
  std::vector<Eigen::Vector3d> out;
  if (!node.has(key)) return out;
  const YamlNode list = node.at(key);
  for (const YamlNode& point : list.items())
    out.push_back(point_mm(point));
  if (out.size() != 2) list.fail(std::to_string(out.size()) + " lights", "2");
  return out;
}

SimDeviation read_deviation(const YamlNode& node) {
  SimDeviation d;
  if (node.has("camera_mm")) d.camera_m = point_mm(node.at("camera_mm"));
  if (node.has("camera_deg")) {
    d.camera_deg = Eigen::Vector3d(node.numbers("camera_deg", 3, between(-10, 10)).data());
  }
  d.focal = node.number_or("focal", 0, between(-0.2, 0.2));
  if (node.has("centre_px")) {
    d.centre_px = Eigen::Vector2d(node.numbers("centre_px", 2, between(-1000, 1000)).data());
  }
  if (node.has("distortion")) {
    const auto k = node.numbers("distortion", 5, between(-1, 1));
    d.distortion = {k[0], k[1], k[2], k[3], k[4]};
  }
  d.lights_m = points_mm(node, "lights_mm");
  d.aim_m = points_mm(node, "aim_mm");
  node.finish();
  return d;
}

SimBenchSettings read_simulator(const YamlNode& node, const fs::path& folder) {
  SimBenchSettings sim;
  sim.full_well_e = node.number("full_well_e", strictly_between(0, 1e7));
  sim.dark_current_e_s = node.number("dark_current_e_s", between(0, 1e6));
  sim.line_time_s = node.number("line_time_us", strictly_between(0, 1000)) / 1e6;
  sim.vignetting = node.number("vignetting", between(0, 0.9));
  sim.led_radius_m = node.number("led_radius_mm", between(0, 100)) / 1000;
  sim.white_exposure_s = node.number("white_exposure_ms", strictly_between(0, 60000)) / 1000;
  if (node.has("camera_rgb")) {
    const auto m = node.numbers("camera_rgb", 9, between(-10, 10));
    sim.camera_rgb = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(m.data());
  }
  sim.light_rise_s = node.number_or("light_rise_ms", 0, between(0, 1000)) / 1000;
  if (node.has("camera_fault_file")) {
    sim.camera_fault_file = read_path(node.at("camera_fault_file"), folder);
  }
  sim.gamma = node.number_or("gamma", sim.gamma, between(1, 4));
  if (node.has("deviation")) sim.deviation = read_deviation(node.at("deviation"));
  node.finish();
  return sim;
}

MonitorPatch read_monitor(const YamlNode& node) {
  MonitorPatch patch;
  patch.at_m = Eigen::Vector2d(node.numbers("at_mm", 2, between(-1000, 1000)).data()) / 1000;
  patch.size_m =
      Eigen::Vector2d(node.numbers("size_mm", 2, strictly_between(0, 1000)).data()) / 1000;
  const YamlNode albedo = node.at("albedo");
  std::vector<double> channels;
  for (const YamlNode& value : albedo.items())
    channels.push_back(value.as_number(between(0.01, 1)));
  if (channels.size() != 3) {
    albedo.fail(std::to_string(channels.size()) + " figures", "3: red, green, blue");
  }
  patch.albedo = Eigen::Array3d(channels.data());
  patch.max_drift = node.number_or("max_drift", patch.max_drift, strictly_between(0, 1));
  node.finish();
  return patch;
}

InspectionConfig read_inspection(const YamlNode& node, const SensorFormat& sensor) {
  InspectionConfig inspection;
  const auto region = node.numbers("region_mm", 2, strictly_between(0, 10000));
  inspection.region_mm = {region[0], region[1]};
  const YamlNode fixture = node.at("fixture");
  const auto albedo = fixture.numbers("albedo", 3, between(0, 1));
  inspection.fixture.reflectance = {albedo[0], albedo[1], albedo[2]};
  inspection.fixture.tolerance = fixture.number("tolerance", strictly_between(0, 1));
  fixture.finish();
  inspection.max_clusters = node.integer("max_clusters", 1, 8);
  const std::vector<std::string> methods = estimator_names();
  inspection.method = methods[node.choice("method", methods)];
  inspection.eta = node.number("eta", strictly_between(0, 1e6));
  inspection.fixture_tilt_sigma_deg = node.number("fixture_tilt_sigma_deg", YamlRange{0, 10});
  inspection.fixture_height_sigma_mm =
      node.number_or("fixture_height_sigma_mm", 0, YamlRange{0, 10});
  inspection.part_height_mm = node.number_or("part_height_mm", 0, YamlRange{-50, 50});
  if (node.has("monitor")) inspection.monitor = read_monitor(node.at("monitor"));
  inspection.colour =
      static_cast<ColourSource>(node.choice("colour", {"none", "linear_srgb_d65", "chart"}));
  if (inspection.colour != ColourSource::none && sensor.mosaic == Mosaic::mono) {
    node.fail_at("colour", "a mono sensor measures no colour", "none");
  }
  node.finish();
  return inspection;
}

UpkeepConfig read_upkeep(const YamlNode& node) {
  UpkeepConfig upkeep;
  upkeep.max_age_days = node.integer_or("max_age_days", upkeep.max_age_days, 0, 36500);
  upkeep.grace_days = node.integer_or("grace_days", upkeep.grace_days, 0, 36500);
  node.finish();
  return upkeep;
}

std::string read_address(const YamlNode& node) {
  const std::string text = node.as_text();
  in6_addr parsed{};
  const bool known = inet_pton(AF_INET, text.c_str(), &parsed) == 1 ||
                     inet_pton(AF_INET6, text.c_str(), &parsed) == 1;
  if (!known) node.fail(shown(text), "an IPv4 or IPv6 address");
  return text;
}

PlcConfig::Tcp read_tcp(const YamlNode& node) {
  PlcConfig::Tcp tcp;
  tcp.enabled = node.boolean("enabled");
  tcp.bind = read_address(node.at("bind"));
  tcp.port = node.integer("port", 0, 65535);
  for (const YamlNode& client : node.at("allow").items())
    tcp.allow.push_back(read_address(client));
  tcp.max_clients = node.integer("max_clients", 1, 64);
  tcp.request_deadline_ms = node.number("request_deadline_ms", between(10, 60000));
  tcp.idle_timeout_s = node.number("idle_timeout_s", between(1, 86400));
  node.finish();
  return tcp;
}

PlcConfig read_plc(const YamlNode& node) {
  PlcConfig plc;
  plc.tcp = read_tcp(node.at("tcp"));
  plc.unit_id = node.integer("unit_id", 1, 247);
  plc.word_order = static_cast<WordOrder>(node.choice("word_order", {"abcd", "cdab"}));
  plc.handshake_timeout_s = node.number("handshake_timeout_s", between(0.1, 3600));
  plc.heartbeat_timeout_s =
      node.number_or("heartbeat_timeout_s", plc.heartbeat_timeout_s, between(0, 3600));
  node.finish();
  return plc;
}

StationConfig::Files read_files(const YamlNode& node, const fs::path& folder) {
  StationConfig::Files files;
  files.basis = read_path(node.at("basis"), folder);
  files.calibration = read_path(node.at("calibration"), folder);
  files.state_dir = read_path(node.at("state_dir"), folder);
  if (node.has("recipes")) {
    for (const YamlNode& entry : node.at("recipes").items()) {
      const fs::path recipe = read_path(entry, folder);
      if (std::count(files.recipes.begin(), files.recipes.end(), recipe) != 0) {
        entry.fail(shown(recipe.string()) + " a second time", "every recipe once");
      }
      files.recipes.push_back(recipe);
    }
  }
  node.finish();
  return files;
}

void complete_simulator(StationConfig& config) {
  config.simulator.sensor = config.camera.sensor;
  config.simulator.noise = config.camera.noise;
  config.simulator.geometry =
      deviated(make_geometry(config.rig, config.camera.sensor), config.simulator.deviation);
  config.simulator.light_settle_s =
      std::chrono::duration<double>(config.lights.gpio.settle).count();
  config.simulator.aim_W = config.simulator.deviation.aim_m;
  config.simulator.fixture_albedo = config.inspection.fixture.reflectance;
  config.simulator.patch = config.inspection.monitor;
}

/// What a calibration depends on, in one spelling whatever the file's.
std::string calibration_inputs(const StationConfig& config) {
  const SensorFormat& sensor = config.camera.sensor;
  std::string text = "brdfgate.station/1";
  const auto add = [&text](double value) { text += " " + number_text(value); };
  for (const int value : {sensor.width, sensor.height, sensor.bits})
    add(value);
  text += " " + mosaic_name(sensor.mosaic);
  if (config.camera.tone_curve) text += " tone_curve";
  for (const double value : {sensor.black_level_dn, sensor.full_well_dn})
    add(value);
  for (const double value : {config.rig.camera_deg, config.rig.camera_m, config.rig.fov_deg}) {
    add(value);
  }
  for (const NominalRig::Light& light : config.rig.lights) {
    for (const double value : {light.theta_deg, light.phi_deg, light.distance_m})
      add(value);
  }
  return text;
}

}  // namespace

StationConfig read_station_config(const fs::path& file) {
  const std::string bytes = read_bytes(file, YamlNode::kMaxBytes);
  const YamlNode root = YamlNode::load_text(bytes, file.string());
  const fs::path folder = fs::absolute(file).parent_path();
  StationConfig config;
  config.name = read_name(root);
  config.camera = read_camera(root.at("camera"), folder);
  config.rig = read_rig(root.at("rig"));
  if (root.has("simulator")) {
    if (config.camera.backend != CameraBackend::simulated) {
      root.fail_at("simulator", "camera.backend is not simulated", "no such section");
    }
    config.simulator = read_simulator(root.at("simulator"), folder);
  }
  config.lights = read_lights(root, config.camera);
  config.trigger = read_trigger(root);
  config.outputs = read_outputs(root);
  const YamlNode inspection = root.at("inspection");
  config.inspection = read_inspection(inspection, config.camera.sensor);
  config.judge = read_judge_settings(root.at("judge"));
  if (root.has("upkeep")) config.upkeep = read_upkeep(root.at("upkeep"));
  config.plc = read_plc(root.at("plc"));
  config.files = read_files(root.at("files"), folder);
  root.finish();
  complete_simulator(config);
  check_region(config, inspection.at("region_mm"));
  if (config.inspection.monitor) check_monitor(config, inspection.at("monitor"));
  check_highlights(config, root.at("rig").at("lights").items());
  config.hash = sha256_hex(bytes);
  config.station_hash = sha256_hex(calibration_inputs(config));
  return config;
}

}  // namespace brdfgate
