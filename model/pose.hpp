// A part's departure from the taught pose, and what a point of the image sees of a part that lies
// so.
#pragma once

#include <Eigen/Core>

#include "model/directions.hpp"
#include "model/geometry.hpp"

namespace brdfgate {

/// Departure from the taught pose: turned about x, then y, through the world's origin, right-handed
/// (R = Ry Rx), and lifted along z.
struct PartPose {
  double tilt_x = 0;    ///< rad
  double tilt_y = 0;    ///< rad
  double height_m = 0;  ///< m

  Eigen::Matrix3d rotation() const;
  bool none() const { return tilt_x == 0 && tilt_y == 0 && height_m == 0; }
};

/// What one point of the image sees under one light, however the part lies.
struct Sightline {
  Eigen::Vector3d eye_W;    ///< the camera's centre, m
  Eigen::Vector3d point_W;  ///< where the ray through the image point meets the plane z = 0, m
  Eigen::Vector4d light_W;  ///< homogeneous: (position in m, 1), or (direction, 0)

  /// Angles on the part's surface. Directions below its horizon give angles below it.
  HalfDiff angles(const PartPose& pose) const;
  /// Irradiance there, up to a factor that no pose changes: cos_i / d^2 (cos_i for a direction).
  double irradiance(const PartPose& pose) const;

 private:
  Eigen::Vector3d point_on_part(const PartPose& pose, const Eigen::Vector3d& normal) const;
};

/// Camera and lights in the frame of a part that lies so: what cell_geometry() then gives are
/// positions and angles on the part.
StationGeometry in_part_frame(const StationGeometry& geometry, const PartPose& pose);

}  // namespace brdfgate
