// How a part lies: a small tilt and height are nuisance parameters, told from the highlight
// (method.md section 5).
//
// A part that is turned by half a degree shows the camera other angles of its BRDF than the taught
// pose would, and its highlight in another place. The reconstruction has to know, or it takes a
// badly seated part for another material.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "model/basis.hpp"
#include "model/pose.hpp"
#include "model/reflectance.hpp"

namespace brdfgate {

/// Reflectance of one cluster at points spread over the image.
struct PoseSamples {
  std::vector<Sightline> lines;
  /// lines x channels, 1/sr, finite, not negative: what the taught pose would make of the light
  /// received. A part in another pose receives more or less; the fit allows for it.
  Eigen::MatrixXd f;
};

/// How well the fixture seats parts: standard deviations; 0 holds a parameter at zero.
struct PosePrior {
  double tilt_sigma = 0;      ///< rad, about each axis
  double height_sigma_m = 0;  ///< m
};

struct PoseEstimate {
  PartPose pose;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of tilt_x, tilt_y (rad), height (m)
};

/// The pose and weights that explain all channels together best, by penalised least squares of the
/// mapped values (ridge for the weights, the prior for the pose), weights eliminated (variable
/// projection, Golub and Pereyra 1973), Levenberg's steps from the best of a few starts: as taught,
/// where the brightest samples would be the mirror direction, and around. The leading weights do.
/// Where nothing tells the pose, it stays at the prior's mean and the covariance is the prior's.
/// The covariance is the posterior's with an error per value that the residuals tell (as in
/// chi-square per degree of freedom), grown because they are not independent.
/// Throws InputError where samples are empty or of different sizes, or a prior is negative.
PoseEstimate estimate_pose(const Basis& basis, const PoseSamples& samples, const PosePrior& prior);

/// A cluster's good cells in square tiles of the image, small enough for a highlight under light 1,
/// four times as large elsewhere: mean reflectance at mean positions. Tiles less than half full
/// are left out.
PoseSamples pose_samples(const std::vector<Reflectance>& r, const StationGeometry& geometry,
                         const CellGeometry& cells, const cv::Mat& in_cluster);

}  // namespace brdfgate
