// A robot's way over chosen directions: a camera on a sphere around a flat sample and a fixed arc
// of lamps (thesis, Appendix G), to measure a reference BRDF.
//
// Robot frame R: z along the sample's normal, azimuth 0 along +x. Isotropy lets the lamps stay on
// their arc: only the azimuth between lamp and camera counts, and its sign does not.
#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "model/directions.hpp"

namespace brdfgate {

/// Angles in radians, lengths in metres.
struct Goniometer {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< x0, y0, z0: the sample's centre in R
  double camera_radius = 0;                          ///< r; Appendix G: 350 mm
  double arc_azimuth = 0;                            ///< of the lamps in R; Appendix G: 90 deg
  double lamp_step = 0;     ///< lamps at 0, step, 2 step ... from the normal; Appendix G: 7.5 deg
  double max_theta = 0;     ///< of camera and lamp from the normal; Appendix G: 82.5 deg
  double clearance = 0;     ///< least angle between camera and lamp: the camera casts a shadow
  double longest_move = 0;  ///< along the sphere; longer ones get stops on the way
};

/// One stop of the camera; by itself (no direction to measure) where it only passes.
struct PathStop {
  int direction = -1;      ///< index of the direction measured here; -1: on the way only
  int lamp = -1;           ///< number on the arc, 0 at the normal
  HalfDiff angles;         ///< what is measured: that of the lamp and the camera as they stand
  double theta = 0;        ///< camera, from the normal
  double phi = 0;          ///< camera, azimuth in R
  Eigen::Vector3d p_R;     ///< camera in R, App. G eq. 1-3
  double pitch = 0;        ///< beta = pi/2 + theta, App. G eq. 4
  double yaw = 0;          ///< gamma = phi, App. G eq. 5
  Eigen::Quaterniond q_R;  ///< Rz(yaw) Ry(pitch): the tool's x axis looks at the sample
};

struct GoniometerPath {
  std::vector<PathStop> stops;
  struct Missed {
    int direction;
    std::string reason;
  };
  std::vector<Missed> missed;  ///< directions that this goniometer cannot measure
  double length = 0;           ///< of the camera's way from the zenith, radians on the sphere
};

/// Appendix G eq. 1-5 for a camera at a polar angle and azimuth.
PathStop camera_stop(const Goniometer& goniometer, double theta, double phi);

/// Gives each direction the nearest lamp (either of its two directions can be the lamp's, by
/// reciprocity) and turns the camera so that theta_h stays exactly what was asked and theta_d gives
/// way: reflectance changes fastest along theta_h. Orders the stops by nearest neighbour and
/// 2-opt from the zenith; moves are great arcs above the sample.
/// Throws InputError for an unusable goniometer, no directions, one below the horizon, and when
/// none can be measured.
GoniometerPath plan_path(const Goniometer& goniometer, const std::vector<HalfDiff>& directions);

}  // namespace brdfgate
