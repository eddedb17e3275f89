#include "model/pose.hpp"

#include <Eigen/Geometry>

namespace brdfgate {

Eigen::Matrix3d PartPose::rotation() const {
  return (Eigen::AngleAxisd(tilt_y, Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(tilt_x, Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

Eigen::Vector3d Sightline::point_on_part(const PartPose& pose,
                                         const Eigen::Vector3d& normal) const {
  const Eigen::Vector3d ray = point_W - eye_W;
  // The part's plane runs through (0, 0, height).
  const double lift = pose.height_m * normal.z() - normal.dot(eye_W);
  return eye_W + ray * (lift / normal.dot(ray));
}

HalfDiff Sightline::angles(const PartPose& pose) const {
  const Eigen::Matrix3d R = pose.rotation();
  const Eigen::Vector3d p = point_on_part(pose, R.col(2));
  const Eigen::Vector3d to_light = light_W.head<3>() - light_W[3] * p;
  return to_half_diff(
      {(R.transpose() * to_light).normalized(), (R.transpose() * (eye_W - p)).normalized()});
}

double Sightline::irradiance(const PartPose& pose) const {
  const Eigen::Vector3d normal = pose.rotation().col(2);
  const Eigen::Vector3d to_light = light_W.head<3>() - light_W[3] * point_on_part(pose, normal);
  const double distance = to_light.norm();
  const double cosine = normal.dot(to_light) / distance;
  return light_W[3] == 0 ? cosine : cosine / (distance * distance);
}

StationGeometry in_part_frame(const StationGeometry& geometry, const PartPose& pose) {
  Eigen::Isometry3d X_WP = Eigen::Isometry3d::Identity();
  X_WP.linear() = pose.rotation();
  X_WP.translation() = Eigen::Vector3d(0, 0, pose.height_m);
  const Eigen::Isometry3d X_PW = X_WP.inverse();
  StationGeometry out = geometry;
  out.camera.X_WC = X_PW * geometry.camera.X_WC;
  for (Eigen::Vector3d& light : out.lights_W)
    light = X_PW * light;
  return out;
}

}  // namespace brdfgate
