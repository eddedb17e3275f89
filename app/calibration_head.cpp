#include "app/calibration_head.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>

#include "config/sensor_yaml.hpp"
#include "config/yaml_reader.hpp"

namespace brdfgate {
namespace {

constexpr int kMostLights = 8;
constexpr int kMostResponseBits = 10;  // a table of every count; the station file's limit too
constexpr const char* kChecksumLine = "\nchecksum: ";

template <typename Numbers>
YAML::Node flow_list(const Numbers& numbers) {
  YAML::Node list(YAML::NodeType::Sequence);
  list.SetStyle(YAML::EmitterStyle::Flow);
  for (const double value : numbers)
    list.push_back(number_text(value));
  return list;
}

YAML::Node sensor_node(const SensorFormat& sensor) {
  YAML::Node node;
  node["width"] = sensor.width;
  node["height"] = sensor.height;
  node["bits"] = sensor.bits;
  node["mosaic"] = mosaic_name(sensor.mosaic);
  node["black_level_dn"] = number_text(sensor.black_level_dn);
  node["full_well_dn"] = number_text(sensor.full_well_dn);
  return node;
}

const std::vector<std::string>& source_names() {
  static const std::vector<std::string> names{"nominal", "fitted", "by_hand"};
  return names;
}

/// Nothing is written for a nominal place: a file without a fitted geometry is as it always was.
void add_quality(YAML::Node& node, const PlaceQuality& quality, const char* residual) {
  if (quality.source == GeometrySource::nominal) return;
  node["source"] = source_names().at(static_cast<std::size_t>(quality.source));
  node["sigma_m"] = number_text(quality.sigma_m);
  node[residual] = number_text(quality.residual);
}

PlaceQuality read_quality(const YamlNode& node, const char* residual) {
  PlaceQuality quality;
  if (!node.has("source")) return quality;
  quality.source = static_cast<GeometrySource>(node.choice("source", source_names()));
  quality.sigma_m = node.number("sigma_m", {.least = 0});
  quality.residual = node.number(residual, {.least = 0});
  return quality;
}

YAML::Node camera_node(const PinholeCamera& camera, const PlaceQuality& quality) {
  YAML::Node node;
  node["focal_px"] = number_text(camera.focal_px);
  node["centre_px"] = flow_list(camera.centre_px);
  const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> pose = camera.X_WC.matrix().topRows<3>();
  node["pose_WC"] = flow_list(pose.reshaped<Eigen::RowMajor>());
  const LensDistortion& d = camera.distortion;
  if (!d.none()) node["distortion"] = flow_list(std::array{d.k1, d.k2, d.p1, d.p2, d.k3});
  add_quality(node, quality, "rms_px");
  return node;
}

YAML::Node lights_node(const StationGeometry& geometry, const GeometryQuality& quality,
                       const std::vector<double>& white_scale) {
  YAML::Node list(YAML::NodeType::Sequence);
  for (std::size_t l = 0; l < white_scale.size(); ++l) {
    YAML::Node light;
    light["position_m"] = flow_list(geometry.lights_W.at(l));
    light["white_scale_dn_s"] = number_text(white_scale[l]);
    if (l < quality.lights.size()) add_quality(light, quality.lights[l], "rms");
    list.push_back(light);
  }
  return list;
}

PinholeCamera read_camera(const YamlNode& node, PlaceQuality& quality) {
  PinholeCamera camera;
  camera.focal_px = node.number("focal_px", {.least = 0, .open = true});
  camera.centre_px = Eigen::Vector2d(node.numbers("centre_px", 2).data());
  const std::vector<double> pose = node.numbers("pose_WC", 12);
  using Pose = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
  camera.X_WC.matrix().topRows<3>() = Eigen::Map<const Pose>(pose.data());
  const Eigen::Matrix3d R = camera.X_WC.linear();
  if (!(R * R.transpose()).isIdentity(1e-6) || R.determinant() < 0) {
    node.fail_at("pose_WC", "its left 3 x 3 part is no rotation",
                 "a right-handed orthonormal frame, row by row");
  }
  if (node.has("distortion")) {
    const std::vector<double> d = node.numbers("distortion", 5);
    camera.distortion = {d[0], d[1], d[2], d[3], d[4]};
  }
  quality = read_quality(node, "rms_px");
  node.finish();
  return camera;
}

void read_lights(const YamlNode& list, CalibrationHead& head) {
  for (const YamlNode& light : list.items()) {
    head.calibration.geometry.lights_W.emplace_back(light.numbers("position_m", 3).data());
    head.white_scale.push_back(light.number("white_scale_dn_s", {.least = 0, .open = true}));
    head.calibration.quality.lights.push_back(read_quality(light, "rms"));
    light.finish();
  }
  if (head.white_scale.empty() || head.white_scale.size() > kMostLights) {
    list.fail(std::to_string(head.white_scale.size()) + " lights",
              "1 to " + std::to_string(kMostLights));
  }
}

SensorNoise read_noise(const YamlNode& node) {
  SensorNoise noise;
  noise.gain_dn_per_e = node.number("gain_dn_per_electron", {.least = 0, .open = true});
  noise.read_noise_dn = node.number("read_noise_dn", {.least = 0});
  node.finish();
  return noise;
}

YAML::Node certificate_node(const WhiteCertificate& certificate) {
  YAML::Node node;
  node["number"] = certificate.number;
  node["date"] = certificate.date;
  node["due"] = certificate.due;
  return node;
}

/// Flat list, light by light.
std::vector<double> flat(const std::vector<Eigen::Array3d>& per_light) {
  std::vector<double> out;
  for (const Eigen::Array3d& f : per_light)
    out.insert(out.end(), f.begin(), f.end());
  return out;
}

constexpr std::array<const char*, 2> kColourModels{"matrix", "root_polynomial"};

YAML::Node colour_node(const CameraColour& colour) {
  YAML::Node node;
  node["model"] = kColourModels.at(static_cast<std::size_t>(colour.model));
  node["chart"] = colour.chart;
  node["chart_illuminant"] = colour.illuminant;
  node["illuminant"] = "D65";
  node["observer_deg"] = "2";
  const Eigen::MatrixXd rows = colour.to_xyz.transpose();  // row by row
  node["to_xyz"] = flow_list(rows.reshaped());
  node["de00_mean"] = number_text(colour.de00_mean);
  node["de00_max"] = number_text(colour.de00_max);
  return node;
}

CameraColour read_colour(const YamlNode& node) {
  CameraColour colour;
  colour.model =
      static_cast<ColourModel>(node.choice("model", {kColourModels.begin(), kColourModels.end()}));
  colour.chart = node.text("chart");
  colour.illuminant = node.text("chart_illuminant");
  node.choice("illuminant", {"D65"});
  node.choice("observer_deg", {"2"});
  const std::size_t terms = colour.model == ColourModel::matrix ? 3 : 6;
  const auto m = node.numbers("to_xyz", 3 * terms);
  colour.to_xyz =
      Eigen::Map<const Eigen::MatrixXd>(m.data(), static_cast<Eigen::Index>(terms), 3).transpose();
  colour.de00_mean = node.number("de00_mean", {.least = 0});
  colour.de00_max = node.number("de00_max", {.least = 0});
  node.finish();
  return colour;
}

YAML::Node white_factor_node(const Calibration& calibration) {
  YAML::Node node;
  node["table"] = calibration.white_factor;
  node["sigma"] = number_text(calibration.white_sigma);
  return node;
}

void read_white_factor(const YamlNode& root, Calibration& calibration) {
  if (!root.has("white_factor")) return;
  const YamlNode node = root.at("white_factor");
  calibration.white_factor = node.text("table");
  calibration.white_sigma = node.number("sigma", {.least = 0, .most = 1});
  node.finish();
}

YAML::Node curve_node(const ToneCurve& curve) {
  YAML::Node node;
  node["least"] = curve.least;
  node["most"] = curve.most;
  node["log_x"] = flow_list(curve.log_x);
  node["sigma"] = flow_list(curve.sigma);
  return node;
}

/// Channel by channel.
YAML::Node response_node(const Response& response) {
  YAML::Node list(YAML::NodeType::Sequence);
  for (const ToneCurve& curve : response)
    list.push_back(curve_node(curve));
  return list;
}

ToneCurve read_curve(const YamlNode& node, const SensorFormat& sensor) {
  const int levels = 1 << sensor.bits;
  ToneCurve curve;
  curve.least = node.integer("least", 0, levels - 1);
  curve.most = node.integer("most", curve.least, levels - 1);
  curve.log_x =
      node.numbers("log_x", static_cast<std::size_t>(levels), {.least = -100, .most = 100});
  curve.sigma = node.numbers("sigma", static_cast<std::size_t>(levels),
                             {.least = 0, .most = 100, .open = true});
  if (!std::is_sorted(curve.log_x.begin(), curve.log_x.end())) {
    node.fail_at("log_x", "falls from one count to the next", "rising figures");
  }
  node.finish();
  return curve;
}

Response read_response(const YamlNode& list, const SensorFormat& sensor) {
  Response response;
  if (sensor.bits > kMostResponseBits) {
    list.fail("a response for " + std::to_string(sensor.bits) + " bits",
              "at most " + std::to_string(kMostResponseBits));
  }
  for (const YamlNode& node : list.items())
    response.push_back(read_curve(node, sensor));
  if (static_cast<int>(response.size()) != sensor.channels()) {
    list.fail(std::to_string(response.size()) + " curves",
              std::to_string(sensor.channels()) + ", one per colour");
  }
  return response;
}

/// What newer calibrations may say besides.
void read_optional(const YamlNode& root, Calibration& calibration) {
  read_white_factor(root, calibration);
  if (root.has("colour")) calibration.colour = read_colour(root.at("colour"));
  const std::size_t lights = calibration.geometry.lights_W.size();
  if (root.has("monitor_patch_f")) {
    const auto f =
        root.numbers("monitor_patch_f", 3 * lights, {.least = 0, .most = 10, .open = true});
    for (std::size_t l = 0; l < lights; ++l)
      calibration.patch_f.emplace_back(Eigen::Array3d(&f[3 * l]));
  }
  if (root.has("response")) {
    calibration.response = read_response(root.at("response"), calibration.sensor);
  }
  if (root.has("white_certificate")) {
    const YamlNode node = root.at("white_certificate");
    calibration.certificate = {node.text("number"), node.text("date"), node.text("due")};
    node.finish();
  }
  if (root.has("stray_share")) {
    calibration.stray_share = root.numbers("stray_share", lights, {.least = -1, .most = 1});
  }
}

void check_schema(const YamlNode& root) {
  const std::string schema = root.text("schema");
  if (schema != kCalibrationSchema) {
    root.fail_at("schema", shown(schema), std::string("'") + kCalibrationSchema + "'");
  }
}

}  // namespace

std::string calibration_head_text(const Calibration& calibration,
                                  const std::vector<double>& white_scale) {
  YAML::Node noise;
  noise["gain_dn_per_electron"] = number_text(calibration.noise.gain_dn_per_e);
  noise["read_noise_dn"] = number_text(calibration.noise.read_noise_dn);
  YAML::Emitter out;
  out << YAML::BeginMap;
  out << YAML::Key << "schema" << YAML::Value << kCalibrationSchema;
  out << YAML::Key << "created" << YAML::Value << YAML::DoubleQuoted << calibration.created;
  out << YAML::Key << "station_hash" << YAML::Value << YAML::DoubleQuoted
      << calibration.station_hash;
  out << YAML::Key << "sensor" << YAML::Value << sensor_node(calibration.sensor);
  out << YAML::Key << "noise" << YAML::Value << noise;
  out << YAML::Key << "camera" << YAML::Value
      << camera_node(calibration.geometry.camera, calibration.quality.camera);
  out << YAML::Key << "lights" << YAML::Value
      << lights_node(calibration.geometry, calibration.quality, white_scale);
  out << YAML::Key << "white_reflectance" << YAML::Value
      << flow_list(calibration.white_reflectance);
  if (!calibration.response.empty()) {
    out << YAML::Key << "response" << YAML::Value << response_node(calibration.response);
  }
  if (!(calibration.certificate == WhiteCertificate{})) {
    out << YAML::Key << "white_certificate" << YAML::Value
        << certificate_node(calibration.certificate);
  }
  if (!calibration.stray_share.empty()) {
    out << YAML::Key << "stray_share" << YAML::Value << flow_list(calibration.stray_share);
  }
  if (!calibration.patch_f.empty()) {
    out << YAML::Key << "monitor_patch_f" << YAML::Value << flow_list(flat(calibration.patch_f));
  }
  if (calibration.colour) {
    out << YAML::Key << "colour" << YAML::Value << colour_node(*calibration.colour);
  }
  if (!calibration.white_factor.empty() || calibration.white_sigma != kUnknownWhiteSigma) {
    out << YAML::Key << "white_factor" << YAML::Value << white_factor_node(calibration);
  }
  out << YAML::EndMap;
  return out.c_str();
}

std::string with_checksum(const std::string& head_text, const std::string& checksum) {
  return head_text + kChecksumLine + '"' + checksum + "\"\n";
}

std::string without_checksum(const std::string& head) {
  return head.substr(0, head.rfind(kChecksumLine));
}

CalibrationHead parse_calibration_head(const std::string& text, const std::string& name) {
  const YamlNode root = YamlNode::load_text(text, name);
  check_schema(root);
  CalibrationHead head;
  Calibration& calibration = head.calibration;
  calibration.created = root.text("created");
  calibration.station_hash = root.text("station_hash");
  const YamlNode sensor = root.at("sensor");
  calibration.sensor = read_sensor_format(sensor, "black_level_dn");
  sensor.finish();
  calibration.noise = read_noise(root.at("noise"));
  calibration.geometry.camera = read_camera(root.at("camera"), calibration.quality.camera);
  read_lights(root.at("lights"), head);
  const std::vector<double> white =
      root.numbers("white_reflectance", 3, {.least = 0, .most = 1.1, .open = true});
  std::copy(white.begin(), white.end(), calibration.white_reflectance.begin());
  read_optional(root, calibration);
  head.checksum = root.text("checksum");
  root.finish();
  return head;
}

}  // namespace brdfgate
