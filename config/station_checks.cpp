#include "config/station_checks.hpp"

#include <cmath>

namespace brdfgate {
namespace {

bool in_image(const PinholeCamera& camera, const SensorFormat& sensor, const Eigen::Vector3d& p_W) {
  const Eigen::Vector3d p_C = camera.X_WC.inverse() * p_W;
  if (p_C.z() <= 0) return false;
  const Eigen::Vector2d pixel = camera.project(p_W);
  return pixel.x() >= -0.5 && pixel.x() <= sensor.width - 0.5 && pixel.y() >= -0.5 &&
         pixel.y() <= sensor.height - 0.5;
}

/// All four edges' middles of the region shrunk by `scale`.
bool sees_edges(const StationConfig& config, double scale) {
  const double x = scale * config.inspection.region_mm[0] / 2000;
  const double y = scale * config.inspection.region_mm[1] / 2000;
  for (const Eigen::Vector3d& p_W : {Eigen::Vector3d(x, 0, 0), Eigen::Vector3d(-x, 0, 0),
                                     Eigen::Vector3d(0, y, 0), Eigen::Vector3d(0, -y, 0)}) {
    if (!in_image(config.simulator.geometry.camera, config.camera.sensor, p_W)) return false;
  }
  return true;
}

std::string size_text(double x_mm, double y_mm) {
  return number_text(std::floor(x_mm * 10) / 10) + " x " + number_text(std::floor(y_mm * 10) / 10) +
         " mm";
}

/// Where a mirror in the plane shows the light to the camera, mm: the line from the camera to the
/// light's image below the plane.
Eigen::Vector2d highlight_mm(const Eigen::Vector3d& camera_W, const Eigen::Vector3d& light_W) {
  const double t = camera_W.z() / (camera_W.z() + light_W.z());
  return 1000 * (camera_W + t * (light_W - camera_W)).head<2>();
}

}  // namespace

void check_region(const StationConfig& config, const YamlNode& region_mm) {
  if (sees_edges(config, 1)) return;
  double scale = 0.99;
  while (scale > 0.01 && !sees_edges(config, scale))
    scale -= 0.01;
  const auto& size = config.inspection.region_mm;
  region_mm.fail(size_text(size[0], size[1]) + " reaches beyond the camera's view",
                 "at most about " + size_text(scale * size[0], scale * size[1]) +
                     ", or another rig.camera or rig.field_of_view_deg");
}

void check_highlights(const StationConfig& config, const std::vector<YamlNode>& lights) {
  const StationGeometry& geometry = config.simulator.geometry;
  const auto& size = config.inspection.region_mm;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    const Eigen::Vector2d at = highlight_mm(geometry.camera.position(), geometry.lights_W[i]);
    const bool inside = std::abs(at.x()) <= size[0] / 2 && std::abs(at.y()) <= size[1] / 2;
    if (inside == (i == 0)) continue;
    const std::string where = "its highlight on a flat part is at (" +
                              number_text(std::round(at.x() * 10) / 10) + ", " +
                              number_text(std::round(at.y() * 10) / 10) + ") mm";
    lights[i].fail(where, i == 0 ? "the mirror light: a highlight inside inspection.region_mm"
                                 : "the diffuse light: a highlight outside inspection.region_mm");
  }
}

void check_monitor(const StationConfig& config, const YamlNode& monitor) {
  const MonitorPatch& patch = *config.inspection.monitor;
  const auto& region = config.inspection.region_mm;
  const Eigen::Array2d half = 500 * patch.size_m.array();  // mm
  const Eigen::Array2d gap =
      (1000 * patch.at_m.array()).abs() - half - Eigen::Array2d(region[0], region[1]) / 2;
  if (!(gap.maxCoeff() >= 0)) {
    monitor.fail_at("at_mm", "the patch reaches into the inspected region",
                    "a place beside inspection.region_mm, where no part covers it");
  }
  for (const double x : {-0.5, 0.5}) {
    for (const double y : {-0.5, 0.5}) {
      const Eigen::Vector2d corner =
          patch.at_m + Eigen::Vector2d(x * patch.size_m.x(), y * patch.size_m.y());
      if (in_image(config.simulator.geometry.camera, config.camera.sensor,
                   {corner.x(), corner.y(), 0})) {
        continue;
      }
      monitor.fail_at("at_mm",
                      "its corner at (" + number_text(1000 * corner.x()) + ", " +
                          number_text(1000 * corner.y()) + ") mm lies beyond the camera's view",
                      "a patch that the camera sees whole");
    }
  }
}

}  // namespace brdfgate
