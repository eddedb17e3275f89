// One part's samples on the bins of the taught pose.
#pragma once

#include <vector>

#include "model/basis.hpp"
#include "model/estimator.hpp"
#include "model/samples.hpp"

namespace brdfgate {

/// Bins that a cluster is always described in, whatever a single part shows of them.
struct BinFrame {
  std::vector<int> id;               ///< of the station's bins
  std::vector<int> light;            ///< per bin
  std::vector<HalfDiff> directions;  ///< per bin, above the horizon
};

/// A frame of the samples' own bins.
BinFrame frame_of(const BinnedSamples& samples);

/// The samples as they would be at the frame's directions: to each mapped value is added what the
/// reconstruction `w` says changes on the way; what it does not explain stays. For steps within a
/// bin. Bins that the part did not show are filled with the reconstruction; others are left out.
/// Relative variances are kept. An estimator that has to be trained for its directions is then
/// trained once per cluster.
/// Throws InputError for an empty frame, and as ridge() does.
BinnedSamples onto_frame(const Basis& basis, const BinnedSamples& samples, const Weights& w,
                         const BinFrame& frame);

}  // namespace brdfgate
