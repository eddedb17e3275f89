// A small white patch in view beside the part: how it is configured.
#pragma once

#include <Eigen/Core>

namespace brdfgate {

/// Lies in the inspected plane (z = 0 of the white reference), outside the inspected region, where
/// no part covers it.
struct MonitorPatch {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();         ///< centre, world x and y
  Eigen::Vector2d size_m = Eigen::Vector2d::Zero();       ///< along x and y
  Eigen::Array3d albedo = Eigen::Array3d::Constant(0.9);  ///< per channel, as its maker says
  double max_drift = 0.05;  ///< of a lamp, relative; beyond: not judged
};

}  // namespace brdfgate
