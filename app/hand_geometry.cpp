#include "app/hand_geometry.hpp"

#include <numbers>

#include "config/yaml_reader.hpp"

namespace brdfgate {
namespace {

constexpr const char* kSchema = "brdfgate.geometry/1";
constexpr YamlRange kPlaceMm{-10000, 10000};

Eigen::Vector3d position_m(const YamlNode& node) {
  const Eigen::Vector3d p(node.numbers("position_mm", 3, kPlaceMm).data());
  if (!(p.z() > 0)) node.fail_at("position_mm", "lies under the inspected plane", "z over 0");
  return p / 1000;
}

/// Axes in W of a camera at `eye` that looks at a point of the plane, its x horizontal but for the
/// roll (clockwise as seen through the camera).
Eigen::Isometry3d looking(const Eigen::Vector3d& eye, const Eigen::Vector3d& at, double roll) {
  const Eigen::Vector3d forward = (at - eye).normalized();
  // The nominal rig's camera, toward +x of the origin, has its x axis along +y.
  Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ());
  if (right.norm() < 1e-9) right = Eigen::Vector3d::UnitY();
  right.normalize();
  Eigen::Matrix3d R_WC;
  R_WC << right, forward.cross(right), forward;
  Eigen::Isometry3d X_WC = Eigen::Isometry3d::Identity();
  X_WC.linear() = R_WC * Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  X_WC.translation() = eye;
  return X_WC;
}

PinholeCamera read_camera(const YamlNode& node, PinholeCamera camera) {
  const Eigen::Vector3d eye = position_m(node);
  Eigen::Vector3d at = Eigen::Vector3d::Zero();
  if (node.has("look_at_mm")) {
    at.head<2>() = Eigen::Vector2d(node.numbers("look_at_mm", 2, kPlaceMm).data()) / 1000;
  }
  const double roll = node.number_or("roll_deg", 0, {-180, 180}) * std::numbers::pi / 180;
  camera.X_WC = looking(eye, at, roll);
  camera.focal_px = node.number_or("focal_px", camera.focal_px, {.least = 0, .open = true});
  if (node.has("centre_px"))
    camera.centre_px = Eigen::Vector2d(node.numbers("centre_px", 2).data());
  if (node.has("distortion")) {
    const std::vector<double> d = node.numbers("distortion", 5, {-1, 1});
    camera.distortion = {d[0], d[1], d[2], d[3], d[4]};
  }
  node.finish();
  return camera;
}

std::vector<std::optional<Eigen::Vector3d>> read_lights(const YamlNode& list, std::size_t lights) {
  std::vector<std::optional<Eigen::Vector3d>> out;
  for (const YamlNode& node : list.items()) {
    out.push_back(node.has("position_mm") ? std::optional(position_m(node)) : std::nullopt);
    node.finish();
  }
  if (out.size() != lights) {
    list.fail(std::to_string(out.size()) + " lights",
              std::to_string(lights) + ", an empty entry {} for one that is to be fitted");
  }
  return out;
}

}  // namespace

GeometryByHand read_hand_geometry(const std::filesystem::path& file,
                                  const StationGeometry& nominal) {
  const YamlNode root = YamlNode::load_file(file);
  root.choice("schema", {kSchema});
  GeometryByHand out;
  out.sigma_m = root.number("sigma_mm", {0, 1000, true}) / 1000;
  if (root.has("camera")) out.camera = read_camera(root.at("camera"), nominal.camera);
  if (root.has("lights")) out.lights_W = read_lights(root.at("lights"), nominal.lights_W.size());
  root.finish();
  return out;
}

}  // namespace brdfgate
