#include "model/markers.hpp"

#include <algorithm>
#include <opencv2/core/version.hpp>

#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
#include <opencv2/aruco.hpp>
#else
#include <opencv2/objdetect/aruco_detector.hpp>
#endif

namespace brdfgate {
namespace {

using Corners = std::vector<std::vector<cv::Point2f>>;

#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR < 7
cv::Ptr<cv::aruco::Dictionary> dictionary() {
  return cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50);
}
void draw(int id, int side, cv::Mat& image) {
  cv::aruco::drawMarker(dictionary(), id, side, image, 1);
}
void detect(const cv::Mat& image, Corners& corners, std::vector<int>& ids) {
  cv::aruco::detectMarkers(image, dictionary(), corners, ids);
}
#else
cv::aruco::Dictionary dictionary() {
  return cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50);
}
void draw(int id, int side, cv::Mat& image) {
  cv::aruco::generateImageMarker(dictionary(), id, side, image, 1);
}
void detect(const cv::Mat& image, Corners& corners, std::vector<int>& ids) {
  cv::aruco::ArucoDetector(dictionary()).detectMarkers(image, corners, ids);
}
#endif

}  // namespace

cv::Mat draw_marker(int id, int pixels_per_cell) {
  cv::Mat image;
  draw(id, kMarkerCells * pixels_per_cell, image);
  return image;
}

std::vector<FoundMarker> find_markers(const cv::Mat& image) {
  Corners corners;
  std::vector<int> ids;
  detect(image, corners, ids);
  std::vector<FoundMarker> found(ids.size());
  for (std::size_t i = 0; i < ids.size(); ++i) {
    found[i].id = ids[i];
    std::copy_n(corners[i].begin(), 4, found[i].corners.begin());
  }
  std::sort(found.begin(), found.end(),
            [](const FoundMarker& a, const FoundMarker& b) { return a.id < b.id; });
  return found;
}

}  // namespace brdfgate
