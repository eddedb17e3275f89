// Where camera and lights are, and what each pixel of the inspected plane sees.
//
// World frame W: origin at the centre of the inspected plane, z its normal, x toward the camera's
// ground projection; metres. Camera frame C: z forward, x right, y down (OpenCV's).
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <vector>

#include "model/directions.hpp"
#include "model/frame.hpp"

namespace brdfgate {

/// Radial and tangential distortion of a lens (Brown 1966, in OpenCV's order and sign), on image
/// coordinates divided by the focal length.
struct LensDistortion {
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;

  bool none() const { return *this == LensDistortion{}; }
  /// From where an ideal pinhole would image a point to where the lens does.
  Eigen::Vector2d apply(const Eigen::Vector2d& ideal) const;
  /// The way back, by Newton's method; exact to 1e-12 where the distortion is below a few percent.
  Eigen::Vector2d remove(const Eigen::Vector2d& distorted) const;
  bool operator==(const LensDistortion&) const = default;
};

/// Pinhole with square pixels and a distorting lens; pixel coordinates with (0, 0) at the centre of
/// the first pixel.
struct PinholeCamera {
  double focal_px = 0;
  Eigen::Vector2d centre_px = Eigen::Vector2d::Zero();
  LensDistortion distortion;
  Eigen::Isometry3d X_WC = Eigen::Isometry3d::Identity();  ///< pose of the camera in the world

  Eigen::Vector3d position() const { return X_WC.translation(); }
  /// Unit ray through a pixel, in W.
  Eigen::Vector3d ray_W(const Eigen::Vector2d& pixel) const;
  /// Pixel of a world point in front of the camera.
  Eigen::Vector2d project(const Eigen::Vector3d& p_W) const;
};

struct StationGeometry {
  PinholeCamera camera;
  std::vector<Eigen::Vector3d> lights_W;  ///< emitter centres; [0] is light 1, [1] light 2
};

/// Nominal rig: camera at `camera_deg` from the normal toward +x at distance `camera_m` from the
/// origin, looking at it, image right along +y; a light by polar angle and azimuth from +x.
/// `fov_deg` is the full angle of the disc inscribed in the image (thesis, C.VI Fig. 4).
struct NominalRig {
  double camera_deg = 55;
  double camera_m = 0.18;
  double fov_deg = 25;
  struct Light {
    double theta_deg = 0;
    double phi_deg = 0;
    double distance_m = 0;
  };
  std::vector<Light> lights;
};
StationGeometry make_geometry(const NominalRig& rig, const SensorFormat& sensor);

/// Pixel coordinates of a cell's centre: a 2x2 mosaic cell's lies between its pixels.
Eigen::Vector2d cell_centre_px(const SensorFormat& sensor, int u, int v);

/// Per cell of the measured image (Bayer: per 2x2 cell, at its centre), for points of the plane z =
/// 0.
struct CellGeometry {
  cv::Mat position_m;           ///< CV_32FC2, x and y on the plane
  std::vector<cv::Mat> angles;  ///< per light CV_32FC3: theta_h, theta_d, phi_d
  std::vector<cv::Mat> cos_i;   ///< per light CV_32FC1
  cv::Mat cos_o;                ///< CV_32FC1
  /// Inside the rectangle roi (metres, centred on the origin) and above all horizons: CV_8UC1, 255.
  cv::Mat inside;
};
CellGeometry cell_geometry(const StationGeometry& geometry, const SensorFormat& sensor,
                           cv::Size2d roi_m);

/// A cut across one angle, or a leaf: a bin.
struct BinNode {
  int axis = -1;   ///< 0 theta_h in MERL cells, 1 theta_d, 2 phi_d (rad); -1: a leaf
  float edge = 0;  ///< below it the next node, else node `other`
  int other = -1;  ///< number of a node
  int bin = -1;    ///< of a leaf
};

/// The station's fixed bins: theta_h cells of the MERL axis near the peak, coarser elsewhere, a few
/// degrees of theta_d and phi_d. Computed once per calibration.
struct BinMap {
  std::vector<cv::Mat>
      id;  ///< per light CV_32SC1: bin of each cell, -1 outside the inspected region
  std::vector<int> light;                   ///< per bin: 1 or 2
  std::vector<HalfDiff> mean_angles;        ///< per bin: mean over all its cells
  std::vector<std::vector<BinNode>> trees;  ///< per light, the root first
  int bins() const { return static_cast<int>(light.size()); }
  /// The bin that these angles (theta_h, theta_d, phi_d) under a light (from 0) belong to.
  int find(std::size_t from_light, const cv::Vec3f& angles) const;
};
BinMap make_bin_map(const CellGeometry& cells);

/// Everything per cell that is fixed while the calibration is.
struct StationMap {
  CellGeometry cells;
  BinMap bins;
};

}  // namespace brdfgate
