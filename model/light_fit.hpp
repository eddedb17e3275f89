// Where the lights are, from how their light falls off over the white reference, and from the
// highlight on a mirror-like gauge.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "model/geometry.hpp"
#include "model/radiance.hpp"

namespace brdfgate {

/// The white reference as merged, lying at `height_m` over the inspected plane: a plate at a second
/// height tells distance from vignetting, which one height tells apart only by their shapes.
struct WhiteView {
  double height_m = 0;
  std::vector<Radiance> lights;  ///< ambient subtracted; [0] light 1
};

/// A mirror-like gauge's highlight: there the half vector is the plane's normal.
struct Highlight {
  std::size_t light = 0;  ///< [0] is light 1
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();
  double normal_sigma = 0;  ///< of the half vector there, radians
};

/// The peak of a gauge under one light, by a parabola through the logarithm of the cells above half
/// of it; nothing where the brightest cells are clipped, at the image's border, or less than 10
/// times the median (no highlight in view).
std::optional<Highlight> find_highlight(const Radiance& gauge, std::size_t light,
                                        const PinholeCamera& camera, const SensorFormat& sensor);

/// Weak knowledge that keeps the fit from wandering where the falloff says nothing.
struct LightPriors {
  double position = 0.2;    ///< sigma of a light's place, share of its distance
  double aim_m = 0.02;      ///< sigma of the point of the plane it is aimed at (the centre)
  double emission = 0.3;    ///< sigma of the exponent of cos_e around 1 (Lambertian)
  double vignetting = 0.5;  ///< sigma of the coefficients of r^2 and r^4
  double plate = 0.001;     ///< unevenness of the plate from block to block, relative
};

struct FittedLight {
  Eigen::Vector3d position_W = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< m^2, scaled by the residuals
  Eigen::Vector2d aim_m = Eigen::Vector2d::Zero();       ///< where on the plane it points
  double rms = 0;                                        ///< of ln(seen / fitted) over the blocks
  bool from_highlight = false;
  /// Root of the covariance's trace over the distance: the figure to quote.
  double relative_sigma() const;
};

struct LightFit {
  std::vector<FittedLight> lights;
  double emission = 1;  ///< exponent of cos_e, shared
  Eigen::Vector2d vignetting =
      Eigen::Vector2d::Zero();  ///< of r^2, r^4, r over the corner's radius
  /// Per light CV_32FC1 by block of the flat plate: ln(seen / fitted), NaN where none was used.
  std::vector<cv::Mat> residuals;
};

struct LightFitInput {
  SensorFormat sensor;
  StationGeometry geometry;  ///< the camera as fitted, the lights as configured
  cv::Size2d plate_m;        ///< the part of the plane that the plate is sure to cover
  std::vector<WhiteView> whites;
  std::vector<Highlight> highlights;
  LightPriors priors{};
};

/// Least squares (Huber's loss) of ln X = a_l + ln cos_i - 2 ln d + m ln cos_e + ln V(r^2), V the
/// lens's even polynomial, on block means. Throws InputError naming light and cause: no white at
/// height 0, too few cells, a shadow or dirt (blocks darker than the fit), a plate that is bent or
/// uneven (rms over 1 %, or a light found over 15 % of its distance from where it is configured).
LightFit fit_lights(const LightFitInput& input);

}  // namespace brdfgate
