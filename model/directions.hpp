// Directions on a surface and their half/difference angles (Rusinkiewicz 1998, "A New Change of
// Variables for Efficient BRDF Representation").
#pragma once

#include <Eigen/Core>

namespace brdfgate {

/// Isotropic Rusinkiewicz angles in radians. theta_h, theta_d in [0, pi/2]; phi_d folded by
/// reciprocity to [0, pi). phi_h is dropped (isotropy). At theta_h = 0 or theta_d = 0 phi_d is
/// undefined and any value is as good as another.
struct HalfDiff {
  double theta_h = 0;
  double theta_d = 0;
  double phi_d = 0;
};

/// Unit vectors in the surface's frame (z = normal): wi to the light, wo to the camera.
struct DirectionPair {
  Eigen::Vector3d wi;
  Eigen::Vector3d wo;
};

/// Angles of two unit vectors. Neither need be above the horizon; wi = -wo is the caller's error.
HalfDiff to_half_diff(const DirectionPair& directions);

/// A pair with these angles, half vector at phi_h = 0. Either direction may lie below the horizon.
DirectionPair to_directions(const HalfDiff& angles);

/// Cosines of incidence and observation, without building the vectors.
struct Cosines {
  double i = 0;
  double o = 0;
  bool above_horizon(double least = 0) const { return i > least && o > least; }
};
Cosines cosines(const HalfDiff& angles);

}  // namespace brdfgate
