// A registered part's pose in its own plane, told from how the taught plane shows it and from its
// tilt.
#pragma once

#include <Eigen/Core>

#include "model/pose.hpp"
#include "model/registration.hpp"

namespace brdfgate {

/// What a camera at a slant shows of a part that lies tilted by t is sheared by about t tan(theta)
/// towards the camera, and a rigid motion laid over that turns by half of it: at 55 degrees a tilt
/// of 0.3 degrees reads as a rotation of 0.2. Each place of the layout's part is seen, as
/// registered, at a point of the taught plane; the line of sight through that meets the part's own
/// plane. The pose is the rigid motion of least squares from the layout to those points (Kabsch
/// 1976, in the plane).
/// @param seen   of register_part(), against the layout's own image
/// @param lie    the part's tilt and height; none: `seen` itself
/// @param eye_W  the camera's centre, m, above the plane
PlanarPose without_tilt(const TaughtLayout& layout, const PlanarPose& seen, const PartPose& lie,
                        const Eigen::Vector3d& eye_W);

}  // namespace brdfgate
