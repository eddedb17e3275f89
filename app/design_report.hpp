// What `brdfgate design` prints: tables, and JSON of the schema brdfgate.design/1.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "model/design_layouts.hpp"
#include "model/goniometer_path.hpp"

namespace brdfgate {

/// What every design has, wherever its directions come from.
struct DesignSummary {
  std::string kind;  ///< points, spheres, camera or rig
  std::string basis;
  DesignGoal goal;
  DesignScore score;
  double unmeasured = 0;      ///< expected error of knowing nothing: the mean material
  std::vector<double> costs;  ///< of the search's starts; empty: positions were given
  unsigned seed = 1;
  int components = 0;
  double eta = 0;
};

nlohmann::json to_json(const DesignSummary& summary);
void print(const DesignSummary& summary);

nlohmann::json to_json(const std::vector<HalfDiff>& points);
void print(const std::vector<HalfDiff>& points);

nlohmann::json to_json(const std::vector<CameraLight>& images, const NearField& view);
void print(const std::vector<CameraLight>& images, const NearField& view);

nlohmann::json to_json(const GoniometerPath& path);
void print(const GoniometerPath& path);
/// One line per stop, for the robot's program.
std::string path_csv(const GoniometerPath& path);

/// Half/difference angles at the centre of an image.
HalfDiff centre_of(const CameraLight& image);

}  // namespace brdfgate
