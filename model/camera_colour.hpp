// A camera's RGB to CIE XYZ, found from a chart.
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "model/brdf.hpp"
#include "model/calibration.hpp"
#include "model/colour_chart.hpp"
#include "model/colour_model.hpp"
#include "model/reflectance.hpp"

namespace brdfgate {

/// Camera RGB of every patch: pi f under light 2 (no highlight), the mean over the cells of the
/// patch's inner half each way. Throws InputError naming the patch: out of view, masked, or not
/// uniform (RMS over 10 % beyond noise: the chart lies otherwise than it should).
std::vector<Eigen::Array3d> chart_rgb(const std::vector<Reflectance>& f,
                                      const Calibration& calibration, const ColourChart& chart);

/// Fits the colour model to a chart: least squares of the differences in L*a*b*, linearised at the
/// patches' known colours (so that a dark patch counts as much as people see of it), which is one
/// linear problem. Throws InputError: numbers of patches that differ, fewer patches than terms, or
/// a mean residual over 5 CIEDE2000 (naming the worst patch: wrong chart, or turned).
CameraColour fit_camera_colour(const std::vector<Eigen::Array3d>& rgb, const ColourChart& chart,
                               ColourModel model);

/// CIEDE2000 of every patch.
std::vector<double> chart_residuals(const CameraColour& colour,
                                    const std::vector<Eigen::Array3d>& rgb,
                                    const ColourChart& chart);

/// A BRDF of camera channels as one of linear sRGB, D65, 2 degrees, which all readings of colour
/// and luminance take.
BrdfPtr in_linear_srgb(const BrdfPtr& camera, const CameraColour& colour);

}  // namespace brdfgate
