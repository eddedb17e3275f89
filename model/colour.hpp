// Colour readings: CIE L*a*b* (CIE 15) and CIEDE2000 (CIE 142; Sharma, Wu, Dalal 2005).
#pragma once

#include <Eigen/Core>

namespace brdfgate {

/// L*, a*, b* for D65, 2 degree observer.
using Lab = Eigen::Array3d;

/// Linear sRGB (IEC 61966-2-1, white = 1, 1, 1) to XYZ with Y = 1 for white.
Eigen::Array3d linear_srgb_to_xyz(const Eigen::Array3d& rgb);
Eigen::Array3d xyz_to_linear_srgb(const Eigen::Array3d& xyz);
/// XYZ relative to the D65 white of linear_srgb_to_xyz.
Lab xyz_to_lab(const Eigen::Array3d& xyz);
Eigen::Array3d lab_to_xyz(const Lab& lab);
/// d(L*, a*, b*) / d(X, Y, Z) at a colour, by central differences.
Eigen::Matrix3d lab_slope(const Eigen::Array3d& xyz);
/// Derivatives of linear_srgb_to_xyz.
const Eigen::Matrix3d& linear_srgb_xyz_matrix();
inline Lab linear_srgb_to_lab(const Eigen::Array3d& rgb) {
  return xyz_to_lab(linear_srgb_to_xyz(rgb));
}
/// CIEDE2000 colour difference with kL = kC = kH = 1.
double delta_e00(const Lab& a, const Lab& b);
/// Turns a*b* by an angle, lightness and chroma kept; out-of-gamut negatives held at 0.
Eigen::Array3d rotate_hue(const Eigen::Array3d& linear_srgb, double hue_deg);

}  // namespace brdfgate
