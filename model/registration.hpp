// Where a part lies against its taught pose: shift and rotation in the plane.
//
// The taught part is kept as a small image of the plane: which material lies where, and how light 2
// shows it against the bare nest. A part is laid over it by Gauss and Newton's steps on the
// difference of the two images (Lucas and Kanade 1981), coarse to fine, with Huber's weights so
// that a missing print or a stain does not pull. Outline and prints tell the pose; perspective is
// gone before, because every cell's place on the plane is calibrated. OpenCV's findTransformECC
// does the same for whole images; it cannot leave out what one of the two did not see.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "model/geometry.hpp"
#include "model/reflectance.hpp"
#include "model/regions.hpp"

namespace brdfgate {

/// A rigid motion of the plane, p = R(rotation) p_taught + shift about the world's origin: small
/// departures of a part from its taught pose.
struct PlanarPose {
  Eigen::Vector2d shift_m = Eigen::Vector2d::Zero();
  double rotation = 0;  ///< rad, counter-clockwise seen against z

  /// Where a point of the world lay on the taught part.
  Eigen::Vector2d to_taught(const Eigen::Vector2d& p_W) const;
};

/// The taught part on a square grid of the plane centred on the world's origin; row 0 at the lowest
/// y, column 0 at the lowest x.
struct TaughtLayout {
  double pitch_m = 0;
  cv::Mat label;  ///< CV_8UC1: cluster, kUnknown or kNotPart
  cv::Mat look;   ///< CV_32FC1: see plane_look()
  cv::Mat seen;   ///< CV_8UC1: 255 where the inspected cells reach
  PlanarPose
      taught;  ///< mean pose of the taught parts against this image: a part's is told from it

  bool empty() const { return label.empty(); }
};

/// Step of the layouts' grid, m, or more where cells lie wider apart (the default camera's see
/// 0.11 to 0.2 mm).
inline constexpr double kLayoutPitch = 0.0005;

/// A taught part's layout, `taught` at zero. Throws InputError where images differ in size.
TaughtLayout make_layout(const std::vector<Reflectance>& r, const CellGeometry& cells,
                         const Regions& regions);

struct Registration {
  PlanarPose pose;       ///< against the layout's own image
  double agreement = 0;  ///< share of the layout's variance that the part explains there, at most 1
};

/// A part that agrees less is not where it could be found, or another one.
inline constexpr double kLeastAgreement = 0.5;

/// The part's pose; within 7 mm and 7 degrees it is found to half a cell's step or
/// better. What nothing
/// tells (a plain part larger than the view) stays at zero.
/// @param not_part  CV_8UC1, 255 where the fixture shows
/// Throws InputError for an empty layout or images of different sizes.
Registration register_part(const TaughtLayout& layout, const std::vector<Reflectance>& r,
                           const CellGeometry& cells, const cv::Mat& not_part);

/// The taught label of every cell under a part in this pose (CV_8UC1); kNotPart off the layout.
cv::Mat expected_labels(const TaughtLayout& layout, const PlanarPose& pose,
                        const CellGeometry& cells);

}  // namespace brdfgate
