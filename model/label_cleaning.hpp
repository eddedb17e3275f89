// Turning cell-wise labels into regions: salt and pepper, mixed rims, specks.
#pragma once

#include <opencv2/core.hpp>

namespace brdfgate {

/// Side of the window that a cell's neighbours outvote it in.
inline constexpr int kMajorityWindow = 5;

/// Side of the smallest square of cells that counts as unknown. A narrower strip is a border of
/// mixed cells, or a scratch, which is a local defect and not a region.
inline constexpr int kUnknownSide = 5;

/// Every part cell takes the label that is most frequent in its window.
/// @param label CV_8UC1, clusters 0..clusters-1 or kNotPart
cv::Mat majority(const cv::Mat& label, int clusters);

/// Cells within `rim` of a cell that is not part see both: they take over the label found inside.
void relabel_rim(cv::Mat& label, int rim);

/// Labels of a part: the nearest cluster after majority and rim, and kUnknown where `far` (CV_8UC1,
/// 255 where no cluster is near) holds a square of kUnknownSide.
cv::Mat clean_labels(const cv::Mat& nearest, const cv::Mat& far, int clusters);

}  // namespace brdfgate
