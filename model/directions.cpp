#include "model/directions.hpp"

#include <cmath>
#include <numbers>

namespace brdfgate {
namespace {

/// Folds an azimuth to [0, pi): swapping the directions turns phi_d by pi.
double fold(double phi) {
  double folded = std::fmod(phi, std::numbers::pi);
  if (folded < 0) folded += std::numbers::pi;
  return folded < std::numbers::pi ? folded : 0.0;
}

}  // namespace

HalfDiff to_half_diff(const DirectionPair& directions) {
  const Eigen::Vector3d sum = directions.wi + directions.wo;
  const Eigen::Vector3d h = sum.normalized();
  const double sin_h = std::hypot(h.x(), h.y());
  // The azimuth of h; at the pole any will do.
  const double cos_phi = sin_h > 0 ? h.x() / sin_h : 1.0;
  const double sin_phi = sin_h > 0 ? h.y() / sin_h : 0.0;
  // wi with h turned to the pole (Rusinkiewicz 1998, section 3: rot_y(-theta_h) rot_z(-phi_h) wi).
  const Eigen::Vector3d& wi = directions.wi;
  const double x = cos_phi * wi.x() + sin_phi * wi.y();
  const double y = cos_phi * wi.y() - sin_phi * wi.x();
  HalfDiff angles;
  angles.theta_h = std::atan2(sin_h, h.z());
  // Half the angle between two unit vectors; exact where acos(wi . h) loses half its digits.
  angles.theta_d = std::atan2((directions.wi - directions.wo).norm(), sum.norm());
  angles.phi_d = fold(std::atan2(y, x * h.z() - wi.z() * sin_h));
  return angles;
}

DirectionPair to_directions(const HalfDiff& angles) {
  const double sh = std::sin(angles.theta_h);
  const double ch = std::cos(angles.theta_h);
  const double sd = std::sin(angles.theta_d);
  const Eigen::Vector3d d(sd * std::cos(angles.phi_d), sd * std::sin(angles.phi_d),
                          std::cos(angles.theta_d));
  // wo is wi mirrored at h, so its tangential part changes sign.
  const Eigen::Vector3d along = d.z() * Eigen::Vector3d(sh, 0, ch);
  const Eigen::Vector3d across(ch * d.x(), d.y(), -sh * d.x());
  return {along + across, along - across};
}

Cosines cosines(const HalfDiff& angles) {
  const double along = std::cos(angles.theta_h) * std::cos(angles.theta_d);
  const double across =
      std::sin(angles.theta_h) * std::sin(angles.theta_d) * std::cos(angles.phi_d);
  return {along - across, along + across};
}

}  // namespace brdfgate
