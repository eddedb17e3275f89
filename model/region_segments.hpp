// Pieces of a part without an edge inside: where a mixture of materials begins.
#pragma once

#include "model/log_image.hpp"

namespace brdfgate {

/// Connected pieces of `core` (CV_8UC1) within which ln f runs on without a step. A step is a
/// change of more than half the least distance of two materials over a few cells, beyond noise; a
/// highlight's flank is far flatter than that.
/// @return CV_32SC1: 1.. by falling area, 0 where there is an edge, no part, or a piece of under
///         `least_cells`
cv::Mat smooth_segments(const LogImage& image, const cv::Mat& core, int least_cells);

}  // namespace brdfgate
