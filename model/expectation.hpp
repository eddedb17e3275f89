// What a taught material is expected to show in every bin of one light.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "model/geometry.hpp"
#include "model/regions.hpp"

namespace brdfgate {

/// Row-major so that a bin's channels lie together.
using ExpectedLog = Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// ln(f + kLogFloor) per bin and channel. A bin of `light` without an expectation (the taught parts
/// did not reach it) takes that of the nearest bin that has one, by theta_h, theta_d and the arc
/// sin(theta_h) phi_d; bins of other lights stay NaN, and so does everything where the material
/// has no expectation at all.
/// Throws InputError when rows are not bins or columns not channels.
ExpectedLog expected_log(const TaughtAppearance& taught, const BinMap& bins, int light,
                         int channels);

}  // namespace brdfgate
