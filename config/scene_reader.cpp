#include "config/scene_reader.hpp"

#include <algorithm>
#include <cmath>

#include "config/material_reader.hpp"
#include "config/png_file.hpp"
#include "config/yaml_reader.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

constexpr YamlRange kShiftMm{-1000, 1000};
constexpr YamlRange kTurnDeg{-180, 180};
constexpr YamlRange kTiltDeg{-45, 45};
constexpr YamlRange kHeightMm{-50, 50};
constexpr YamlRange kShare{0, 1};

std::array<double, 2> pair_or(const YamlNode& node, std::string_view key,
                              std::array<double, 2> fallback, YamlRange range) {
  if (!node.has(key)) return fallback;
  const std::vector<double> values = node.numbers(key, 2, range);
  return {values[0], values[1]};
}

void read_part(const YamlNode& node, Scene& scene) {
  scene.part_size_mm = pair_or(node, "size_mm", scene.part_size_mm, {0, 10000, true});
  scene.present = node.boolean_or("present", scene.present);
  if (node.has("face")) scene.face_front = node.choice("face", {"front", "back"}) == 0;
  if (node.has("back")) {
    const YamlNode back = node.at("back");
    scene.back_albedo = read_rgb(back, "lambert", kShare);
    back.finish();
  }
  node.finish();
}

ScenePose read_pose(const YamlNode& node) {
  ScenePose pose;
  pose.shift_mm = pair_or(node, "shift_mm", pose.shift_mm, kShiftMm);
  pose.rotation_deg = node.number_or("rotation_deg", pose.rotation_deg, kTurnDeg);
  pose.tilt_deg = pair_or(node, "tilt_deg", pose.tilt_deg, kTiltDeg);
  pose.height_mm = node.number_or("height_mm", pose.height_mm, kHeightMm);
  node.finish();
  return pose;
}

/// Half-widths: one figure serves both directions.
ScenePose read_jitter(const YamlNode& node) {
  const double shift = node.number_or("shift_mm", 0, {0, kShiftMm.most});
  const double tilt = node.number_or("tilt_deg", 0, {0, kTiltDeg.most});
  ScenePose jitter;
  jitter.shift_mm = {shift, shift};
  jitter.rotation_deg = node.number_or("rotation_deg", 0, {0, kTurnDeg.most});
  jitter.tilt_deg = {tilt, tilt};
  jitter.height_mm = node.number_or("height_mm", 0, {0, kHeightMm.most});
  node.finish();
  return jitter;
}

/// An index without a material names its pixel: the mask's painter has to find it.
void check_indices(const cv::Mat& regions, std::size_t materials, const fs::path& file) {
  double most = 0;
  cv::Point at;
  cv::minMaxLoc(regions, nullptr, &most, nullptr, &at);
  if (static_cast<std::size_t>(most) < materials) return;
  throw InputError(file.string(),
                   "index " + std::to_string(static_cast<int>(most)) + " in column " +
                       std::to_string(at.x) + ", row " + std::to_string(at.y),
                   "below the number of materials, " + std::to_string(materials));
}

cv::Mat read_regions(const YamlNode& node, const fs::path& folder, std::size_t materials) {
  const std::string name = node.as_text();
  if (name.empty()) node.fail("empty", "an 8-bit PNG file");
  const fs::path file = (folder / name).lexically_normal();
  try {
    PngExpectation expected;
    expected.max_side = 8192;
    cv::Mat regions = read_gray_png(file, expected);
    check_indices(regions, materials, file);
    return regions;
  } catch (const InputError& error) {
    node.fail(error.what());
  }
}

void read_variation(const YamlNode& node, Scene& scene) {
  scene.variation.albedo = node.number_or("albedo", 0, kShare);
  scene.variation.gloss = node.number_or("gloss", 0, kShare);
  scene.variation.roughness = node.number_or("roughness", 0, kShare);
  node.finish();
}

SceneChange read_change(const YamlNode& node, const Scene& scene) {
  SceneChange out;
  out.material = node.text("material");
  const bool known =
      std::any_of(scene.materials.begin(), scene.materials.end(),
                  [&](const SceneMaterial& material) { return material.name == out.material; });
  if (!known) node.fail_at("material", "no material " + shown(out.material), "one of materials");
  const bool again =
      std::any_of(scene.changes.begin(), scene.changes.end(),
                  [&](const SceneChange& change) { return change.material == out.material; });
  if (again) node.fail_at("material", shown(out.material) + " a second time", "one change each");
  out.change.albedo = node.number_or("albedo", 1, {0, 100});
  out.change.gloss = node.number_or("gloss", 1, {0, 1000});
  out.change.roughness = node.number_or("roughness", 1, {0, 100, true});
  out.change.hue_deg = node.number_or("hue_deg", 0, kTurnDeg);
  node.finish();
  return out;
}

SceneDefect read_defect(const YamlNode& node, const std::array<double, 2>& part_mm) {
  SceneDefect out;
  out.kind = static_cast<DefectKind>(node.choice("kind", {"stain", "scratch", "dull", "dust"}));
  const YamlNode at = node.at("at_mm");
  const std::vector<double> at_mm = node.numbers("at_mm", 2);
  out.at_mm = {at_mm[0], at_mm[1]};
  for (std::size_t axis = 0; axis < 2; ++axis) {
    if (std::abs(out.at_mm[axis]) > part_mm[axis] / 2) {
      at.fail(number_text(out.at_mm[axis]) + " mm lies beside the part",
              "at most " + number_text(part_mm[axis] / 2) + " mm from its centre");
    }
  }
  out.size_mm = node.number_or("size_mm", 3, {0, 1000, true});
  // Dull scales the roughness by 1 + strength, which may be more than double; a stain takes away a
  // share.
  out.strength = node.number_or("strength", 0.5, {0, out.kind == DefectKind::dull ? 10.0 : 1.0});
  node.finish();
  return out;
}

void read_surface(const YamlNode& root, const fs::path& folder, Scene& scene) {
  const bool needed = scene.target == SceneTarget::part && scene.present;
  if (needed || root.has("materials")) {
    scene.materials = read_materials(root.at("materials"), folder);
  }
  if (root.has("regions")) {
    if (scene.materials.empty()) root.fail_at("regions", "a mask without materials", "materials");
    scene.regions = read_regions(root.at("regions"), folder, scene.materials.size());
  }
  if (root.has("change")) {
    for (const YamlNode& node : root.at("change").items()) {
      scene.changes.push_back(read_change(node, scene));
    }
  }
  if (root.has("defects")) {
    for (const YamlNode& node : root.at("defects").items()) {
      scene.defects.push_back(read_defect(node, scene.part_size_mm));
    }
  }
}

void read_surroundings(const YamlNode& root, Scene& scene) {
  if (root.has("light")) {
    const YamlNode light = root.at("light");
    scene.light.drift = pair_or(light, "drift", scene.light.drift, {-1, 10});
    scene.light.ambient = light.number_or("ambient", 0, {0, 100});
    light.finish();
  }
  if (root.has("sensor")) {
    const YamlNode sensor = root.at("sensor");
    scene.sensor.noise = sensor.boolean_or("noise", true);
    scene.sensor.defocus_px = sensor.number_or("defocus_px", 0, {0, 100});
    sensor.finish();
  }
}

}  // namespace

Scene read_scene(const fs::path& file) {
  const YamlNode root = YamlNode::load_file(file);
  Scene scene;
  if (root.has("target")) {
    const std::vector<std::string> targets{"part", "white", "board", "mirror", "black", "chart"};
    scene.target = static_cast<SceneTarget>(root.choice("target", targets));
  }
  if (root.has("board")) {
    scene.board = static_cast<BoardKind>(root.choice("board", {"checker", "charuco"}));
  }
  if (root.has("reference")) {
    const YamlNode reference = root.at("reference");
    scene.sag_mm = reference.number_or("sag_mm", 0, {-10, 10});
    reference.finish();
  }
  scene.lights_on = root.boolean_or("lights_on", scene.lights_on);
  if (root.has("part")) read_part(root.at("part"), scene);
  if (root.has("pose")) scene.pose = read_pose(root.at("pose"));
  if (root.has("jitter")) scene.jitter = read_jitter(root.at("jitter"));
  if (root.has("variation")) read_variation(root.at("variation"), scene);
  read_surface(root, file.parent_path(), scene);
  read_surroundings(root, scene);
  root.finish();
  return scene;
}

}  // namespace brdfgate
