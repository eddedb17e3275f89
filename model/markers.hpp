// Square fiducial markers (ArUco, dictionary 4X4_50): drawn and found. The only file that knows
// which OpenCV module they live in (contrib's aruco in 4.6, objdetect from 4.7).
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

namespace brdfgate {

inline constexpr int kMarkerCells = 6;  ///< 4 x 4 bits and a black border of one cell
inline constexpr int kMarkerIds = 50;

/// CV_8UC1 of kMarkerCells * pixels_per_cell a side; 0 black, 255 white; row 0 is the marker's top.
/// Precondition: 0 <= id < kMarkerIds.
cv::Mat draw_marker(int id, int pixels_per_cell);

struct FoundMarker {
  int id = 0;
  std::array<cv::Point2f, 4> corners;  ///< clockwise in the image, from the marker's top left
};
/// In a CV_8UC1 image, by id; a marker seen twice is given twice.
std::vector<FoundMarker> find_markers(const cv::Mat& image);

}  // namespace brdfgate
