// How well a basis reconstructs materials it has not seen: the fixed-camera rig of the literature,
// without sensor, noise or bins.
#pragma once

#include <vector>

#include "model/brdf.hpp"
#include "model/samples.hpp"

namespace brdfgate {

/// Near-field camera and two directional lights (thesis, C.VI section 8): camera 55 degrees from
/// the normal, lights at the mirror direction and at 20 degrees on the camera's side, a disc of the
/// plane seen under 25 degrees sampled on an n x n lattice.
struct ValidationRig {
  double camera_deg = 55;
  double light_deg[2] = {
      55, 20};  ///< from the normal; the first opposite the camera, the second on its side
  double fov_deg = 25;
  int lattice = 15;  ///< 149 of 15 x 15 points lie on the disc: 298 rows
};

/// Exact values of a BRDF at the rig's directions: one bin each, no variance. Light after light.
/// @pre lattice >= 2
BinnedSamples observe_exactly(const Brdf& brdf, const ValidationRig& rig = {});

}  // namespace brdfgate
