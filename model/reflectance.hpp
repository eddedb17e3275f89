// Radiance to reflectance against the white reference (thesis App. H eq. 18-22, with the erratum:
// the cosine ratio is cos_i_ref / cos_i_mat).
#pragma once

#include <vector>

#include "model/calibration.hpp"
#include "model/radiance.hpp"

namespace brdfgate {

/// BRDF value per cell under one light, 1/sr. Same layout as Radiance.
struct Reflectance {
  cv::Mat value;     ///< CV_32FC1 or CV_32FC3, 1/sr
  cv::Mat variance;  ///< same type; photon noise of part and reference
  cv::Mat mask;      ///< CV_8UC1 of MaskBit
};

/// Where a part's surface lies: through (0, 0, height), tilted about x, then y (R = Ry Rx,
/// radians).
struct PartPlane {
  double height_m = 0;
  Eigen::Vector2d tilt = Eigen::Vector2d::Zero();

  bool in_reference_plane() const { return height_m == 0 && tilt.isZero(0); }
  Eigen::Vector3d normal_W() const;
};

/// f = rho_ref / pi * X_mat / X_ref for a part in the reference's plane; with `height_m` other than
/// 0 the cosine and distance ratios of App. H eq. 20 for a plane that much above the reference's.
/// Throws InputError where sizes or channels differ from the calibration's.
std::vector<Reflectance> to_reflectance(const RadianceSet& radiance, const Calibration& calibration,
                                        double height_m = 0);
/// The same for a part whose plane is known: eq. 20 with the part's own normal and distance.
/// @param lamps  per light and channel: its light now over the calibration's, f is divided by it
///               (model/lamp_monitor.hpp); empty: as calibrated
std::vector<Reflectance> to_reflectance(const RadianceSet& radiance, const Calibration& calibration,
                                        const PartPlane& plane,
                                        const std::vector<Eigen::Array3d>& lamps = {});

/// Ambient light as a share of the white reference's signal under light 2, colours summed: median
/// over every second row and column of `cells` (CV_8UC1).
/// @param reflectance  per channel, of what lies in those cells under all-round light (a Lambertian
///                     surface's albedo); mono: the first
/// Throws InputError: sizes that differ, no light 2, no usable cell, a reflectance not positive.
double ambient_share(const Radiance& ambient, const Calibration& calibration, const cv::Mat& cells,
                     const Eigen::Array3d& reflectance);

}  // namespace brdfgate
