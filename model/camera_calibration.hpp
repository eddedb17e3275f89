// Where the camera is and how it images, from pictures of the board (Zhang 2000, by way of OpenCV).
#pragma once

#include <string>
#include <vector>

#include "model/board.hpp"
#include "model/geometry.hpp"

namespace brdfgate {

struct CameraFit {
  PinholeCamera camera;     ///< pose in W: the first view's board lies on the inspected plane
  bool intrinsics = false;  ///< focal length, centre and distortion were fitted, not nominal
  double rms_px = 0;        ///< reprojection error, sensor pixels: root of mean |error|^2
  std::vector<double> view_rms_px;
  std::vector<std::vector<Eigen::Vector2d>> errors_px;  ///< per view and corner: seen - fitted
  double focal_sigma_px = 0;                            ///< 0 where nominal
  Eigen::Vector2d centre_sigma_px = Eigen::Vector2d::Zero();
  Eigen::Vector3d position_sigma_m = Eigen::Vector3d::Zero();  ///< of the camera, in W
  double rotation_sigma = 0;                                   ///< worst axis, radians
};

/// Fits to the views; view 0 defines W (board frame = W: flat in the nest, centred). From
/// kLeastViews views with different tilts also focal length, centre and distortion; from fewer the
/// pose alone, with `nominal`'s intrinsics. Throws InputError, naming the view: a reprojection
/// error over kWorstRms px, a first view tilted by over kMostTilt against `nominal` (the board does
/// not lie in the nest), views too alike to tell the focal length.
inline constexpr std::size_t kLeastViews = 5;
inline constexpr double kWorstRms = 1.0;     ///< sensor pixels
inline constexpr double kMostTilt = 0.0873;  ///< 5 degrees
CameraFit fit_camera(const std::vector<BoardView>& views, const SensorFormat& sensor,
                     const PinholeCamera& nominal, const std::vector<std::string>& names,
                     double worst_rms = kWorstRms);

}  // namespace brdfgate
