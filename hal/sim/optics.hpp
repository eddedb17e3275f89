// From the placed part to the light that each pixel of the sensor collects.
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <vector>

#include "hal/sim/part.hpp"
#include "hal/sim/sim_station.hpp"

namespace brdfgate {

/// Colour channel (0 R, 1 G, 2 B) of a sensor pixel; -1 on a mono sensor, which sees the mean of
/// the three.
int colour_channel(Mosaic mosaic, int row, int column);

/// Renders rates of photo-electrons per second, CV_32FC1, sensor size, mosaic kept: each pixel is
/// evaluated at its own centre and in its own colour.
///
/// A pixel's rate is K L with L = f E the radiance that leaves the seen point toward the camera,
/// E = I0 cos_e cos_i / d^2 the irradiance by the emitter, a Lambertian disc aimed at the world's
/// origin (or at settings.aim_W), and K I0 such that a 0.99 Lambertian at the origin collects half
/// of full_well_e in white_exposure_s under each light. Directions are taken in the seen surface's
/// own frame. The disc is sampled at its centre, and at seven points where it is not small against
/// the highlight.
///
/// Departures from a real bench: the natural cos^4 falloff of a lens is contained in the vignetting
/// term 1 - vignetting (r / r_corner)^2, r from the principal point; nothing casts a shadow and
/// nothing is lit by reflection; the lens distorts as settings.geometry.camera says.
class SimOptics {
 public:
  /// Keeps a reference to the settings.
  explicit SimOptics(const SimBenchSettings& settings) : settings_(settings) {}

  /// Light 1.. at its nominal intensity.
  cv::Mat render_light(const PartSurface& part, const Eigen::Isometry3d& X_WP,
                       LightIndex light) const;
  /// A uniform environment that gives a 0.99 Lambertian `share` of its signal at the centre under
  /// one light. Other surfaces reflect their own share of it (ambient_reflectance; the fixture its
  /// albedo). Precondition: part.prepare_ambient.
  cv::Mat render_ambient(const PartSurface& part, const Eigen::Isometry3d& X_WP,
                         double share) const;

  /// Electrons per second of a 0.99 Lambertian at the origin, image centre.
  double white_rate_e_s() const { return settings_.full_well_e / 2 / settings_.white_exposure_s; }

 private:
  const SimBenchSettings& settings_;
};

/// Gaussian blur of standard deviation sigma_px (sensor pixels) within each colour plane; what
/// leaves the image at its border is reflected back, so the sum stays.
void defocus(cv::Mat& image, Mosaic mosaic, double sigma_px);

}  // namespace brdfgate
