// What lies under the simulated camera (cli.md, "Scene file"). Plain data; config/ reads it from
// YAML.
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "model/analytic.hpp"
#include "model/board.hpp"

namespace brdfgate {

enum class SceneTarget { part, white, board, mirror, black, chart };
enum class DefectKind { stain, scratch, dull, dust };

/// Offset from the taught pose, in the scene file's units.
struct ScenePose {
  std::array<double, 2> shift_mm{};
  double rotation_deg = 0;
  std::array<double, 2> tilt_deg{};  ///< about x, then y, through the part's centre: R = Ry Rx
  double height_mm = 0;
};

struct SceneMaterial {
  std::string name;
  BrdfPtr brdf;
};

struct SceneChange {
  std::string material;
  BrdfChange change;
};

struct SceneDefect {
  DefectKind kind = DefectKind::stain;
  std::array<double, 2> at_mm{};
  double size_mm = 1;  ///< diameter; length for a scratch
  double strength = 0.5;
};

struct Scene {
  SceneTarget target = SceneTarget::part;
  BoardKind board = BoardKind::checker;  ///< what is printed on the board
  double sag_mm = 0;  ///< white target: how far the plate bends along x over 90 mm, its ends lower
  bool lights_on = true;
  std::array<double, 2> part_size_mm{80, 80};
  bool present = true;
  bool face_front = true;
  Rgb back_albedo = Rgb::Constant(0.3);
  ScenePose pose;
  ScenePose jitter;                      ///< uniform half-widths, drawn per part
  std::vector<SceneMaterial> materials;  ///< the first is the body
  cv::Mat regions;  ///< CV_8UC1 index into materials, row 0 at +y; empty: the first everywhere
  struct {
    double albedo = 0, gloss = 0, roughness = 0;  ///< relative standard deviations, drawn per part
  } variation;
  std::vector<SceneChange> changes;
  std::vector<SceneDefect> defects;
  struct {
    std::array<double, 2> drift{};  ///< relative change of each light's intensity
    double ambient = 0;             ///< share of the white reference's signal under light 2
  } light;
  struct {
    bool noise = true;
    double defocus_px = 0;  ///< standard deviation of the blur, sensor pixels
  } sensor;
};

}  // namespace brdfgate
