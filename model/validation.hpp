// How well a basis reconstructs materials it has not seen: the fixed-camera rig of the literature,
// without sensor, noise or bins.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "model/basis.hpp"
#include "model/brdf.hpp"
#include "model/estimator.hpp"
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

/// Distance of a reconstruction from its truth, in mapped units.
struct ReconstructionError {
  double mapped_rms = 0;                ///< mean over channels
  std::array<double, 3> per_channel{};  ///< RMS over the cells
  std::size_t cells = 0;                ///< that counted
};

/// RMS over the cells of a grid of MERL axes whose cosines both exceed 0.02 of mapped prediction
/// less mapped truth. Truth is evaluated at the cells' centres; the prediction is mu + Q c as it
/// is, not held at f = 0 from below, so with f_ref cancelled this is the error of the linear model
/// itself. Mono weights stand for all three channels. Throws InputError where the weights are not
/// the basis' or not finite. compare() (model/reconstruction.hpp) is the same for two tables on all
/// MERL cells.
ReconstructionError reconstruction_error(const Brdf& truth, const Basis& basis,
                                         const Weights& weights, const BasisGrid& grid = {});

/// A seeded partition of n materials into folds whose sizes differ by one at most: the fold of
/// each. Throws InputError unless 2 <= folds <= materials.
std::vector<int> assign_folds(int materials, int folds, std::uint64_t seed);

/// Mean, median and 90th percentile (linear between ranks). Zero where there are no values.
struct ErrorSummary {
  double mean = 0;
  double median = 0;
  double p90 = 0;
};
ErrorSummary summarise(std::vector<double> errors);

}  // namespace brdfgate
