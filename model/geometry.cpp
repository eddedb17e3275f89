#include "model/geometry.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "model/error.hpp"

namespace brdfgate {
namespace {

double radians(double degrees) {
  return degrees * std::numbers::pi / 180.0;
}

/// Unit vector in W at a polar angle from +z and an azimuth from +x.
Eigen::Vector3d unit_vector(double theta, double phi) {
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

void check(const NominalRig& rig, const SensorFormat& sensor) {
  if (!(rig.fov_deg > 0 && rig.fov_deg < 180)) {
    throw InputError("rig.field_of_view_deg", std::to_string(rig.fov_deg), "between 0 and 180");
  }
  if (!(rig.camera_m > 0)) {
    throw InputError("rig.camera", "distance " + std::to_string(rig.camera_m) + " m", "over 0");
  }
  if (!(std::abs(rig.camera_deg) < 90)) {
    throw InputError("rig.camera", "polar angle " + std::to_string(rig.camera_deg) + " deg",
                     "under 90");
  }
  if (sensor.width < 2 || sensor.height < 2) {
    throw InputError("sensor", std::to_string(sensor.width) + " x " + std::to_string(sensor.height),
                     "at least 2 x 2 pixels");
  }
}

/// Camera axes in W: right = +y, down and forward in the x-z plane.
Eigen::Isometry3d camera_pose(double theta, double distance) {
  const double s = std::sin(theta);
  const double c = std::cos(theta);
  Eigen::Matrix3d R_WC;
  R_WC.col(0) = Eigen::Vector3d::UnitY();
  R_WC.col(1) = Eigen::Vector3d(c, 0, -s);
  R_WC.col(2) = Eigen::Vector3d(-s, 0, -c);
  Eigen::Isometry3d X_WC = Eigen::Isometry3d::Identity();
  X_WC.linear() = R_WC;
  X_WC.translation() = distance * Eigen::Vector3d(s, 0, c);
  return X_WC;
}

CellGeometry allocate(cv::Size size, std::size_t lights) {
  CellGeometry cells;
  cells.position_m.create(size, CV_32FC2);
  cells.cos_o.create(size, CV_32FC1);
  cells.inside.create(size, CV_8UC1);
  for (std::size_t l = 0; l < lights; ++l) {
    cells.angles.emplace_back(size, CV_32FC3);
    cells.cos_i.emplace_back(size, CV_32FC1);
  }
  return cells;
}

/// Angles of one point under every light; true when all lights and the camera are above its
/// horizon.
bool set_angles(CellGeometry& cells, const StationGeometry& geometry, const cv::Point& at,
                const Eigen::Vector3d& p_W) {
  const Eigen::Vector3d wo = (geometry.camera.position() - p_W).normalized();
  cells.cos_o.at<float>(at) = static_cast<float>(wo.z());
  bool above = wo.z() > 0;
  for (std::size_t l = 0; l < geometry.lights_W.size(); ++l) {
    const Eigen::Vector3d wi = (geometry.lights_W[l] - p_W).normalized();
    const HalfDiff a = to_half_diff({wi, wo});
    cells.angles[l].at<cv::Vec3f>(at) = cv::Vec3f(
        static_cast<float>(a.theta_h), static_cast<float>(a.theta_d), static_cast<float>(a.phi_d));
    cells.cos_i[l].at<float>(at) = static_cast<float>(wi.z());
    above = above && wi.z() > 0;
  }
  return above;
}

void set_empty(CellGeometry& cells, const cv::Point& at) {
  cells.position_m.at<cv::Vec2f>(at) = cv::Vec2f(0, 0);
  cells.cos_o.at<float>(at) = 0;
  cells.inside.at<unsigned char>(at) = 0;
  for (std::size_t l = 0; l < cells.angles.size(); ++l) {
    cells.angles[l].at<cv::Vec3f>(at) = cv::Vec3f(0, 0, 0);
    cells.cos_i[l].at<float>(at) = 0;
  }
}

}  // namespace

Eigen::Vector2d LensDistortion::apply(const Eigen::Vector2d& ideal) const {
  const double x = ideal.x(), y = ideal.y();
  const double r2 = ideal.squaredNorm();
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  return {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
          y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
}

Eigen::Vector2d LensDistortion::remove(const Eigen::Vector2d& distorted) const {
  constexpr int kMostSteps = 10;
  constexpr double kCloseEnough = 1e-13;
  Eigen::Vector2d ideal = distorted;
  for (int step = 0; step < kMostSteps; ++step) {
    const Eigen::Vector2d miss = apply(ideal) - distorted;
    if (miss.squaredNorm() < kCloseEnough * kCloseEnough) break;
    const double x = ideal.x(), y = ideal.y();
    const double r2 = ideal.squaredNorm();
    const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
    const double slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));  // d radial / d r2, doubled
    Eigen::Matrix2d J;
    J(0, 0) = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x;
    J(0, 1) = J(1, 0) = slope * x * y + 2 * p1 * x + 2 * p2 * y;
    J(1, 1) = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x;
    ideal -= J.inverse() * miss;
  }
  return ideal;
}

Eigen::Vector3d PinholeCamera::ray_W(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d offset = pixel - centre_px;
  if (distortion.none()) {
    return X_WC.linear() * Eigen::Vector3d(offset.x(), offset.y(), focal_px).normalized();
  }
  const Eigen::Vector2d ideal = distortion.remove(offset / focal_px);
  return X_WC.linear() * Eigen::Vector3d(ideal.x(), ideal.y(), 1).normalized();
}

Eigen::Vector2d PinholeCamera::project(const Eigen::Vector3d& p_W) const {
  const Eigen::Vector3d p_C = X_WC.inverse() * p_W;
  if (distortion.none()) return focal_px / p_C.z() * p_C.head<2>() + centre_px;
  return focal_px * distortion.apply(p_C.head<2>() / p_C.z()) + centre_px;
}

StationGeometry make_geometry(const NominalRig& rig, const SensorFormat& sensor) {
  check(rig, sensor);
  StationGeometry geometry;
  PinholeCamera& camera = geometry.camera;
  camera.focal_px =
      std::min(sensor.width, sensor.height) / 2.0 / std::tan(radians(rig.fov_deg) / 2.0);
  camera.centre_px = Eigen::Vector2d(sensor.width - 1, sensor.height - 1) / 2.0;
  camera.X_WC = camera_pose(radians(rig.camera_deg), rig.camera_m);
  for (const NominalRig::Light& light : rig.lights) {
    geometry.lights_W.push_back(light.distance_m *
                                unit_vector(radians(light.theta_deg), radians(light.phi_deg)));
  }
  return geometry;
}

Eigen::Vector2d cell_centre_px(const SensorFormat& sensor, int u, int v) {
  if (sensor.mosaic == Mosaic::mono) return {u, v};
  return {2.0 * u + 0.5, 2.0 * v + 0.5};
}

CellGeometry cell_geometry(const StationGeometry& geometry, const SensorFormat& sensor,
                           cv::Size2d roi_m) {
  const cv::Size size = sensor.cells();
  CellGeometry cells = allocate(size, geometry.lights_W.size());
  const Eigen::Vector3d eye = geometry.camera.position();
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      const cv::Point at(u, v);
      const Eigen::Vector3d ray = geometry.camera.ray_W(cell_centre_px(sensor, u, v));
      if (!(ray.z() * eye.z() < 0)) {  // looks past the horizon of the plane
        set_empty(cells, at);
        continue;
      }
      Eigen::Vector3d p_W = eye - eye.z() / ray.z() * ray;
      p_W.z() = 0;
      const bool above = set_angles(cells, geometry, at, p_W);
      const bool in_roi =
          std::abs(p_W.x()) <= roi_m.width / 2 && std::abs(p_W.y()) <= roi_m.height / 2;
      cells.position_m.at<cv::Vec2f>(at) =
          cv::Vec2f(static_cast<float>(p_W.x()), static_cast<float>(p_W.y()));
      cells.inside.at<unsigned char>(at) = above && in_roi ? 255 : 0;
    }
  }
  return cells;
}

}  // namespace brdfgate
