// A chart of patches with known colours: what a camera's RGB is calibrated with.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "model/colour.hpp"

namespace brdfgate {

struct ChartPatch {
  std::string name;
  Eigen::Array3d xyz = Eigen::Array3d::Zero();  ///< D65, 2 degrees, Y = 1 for the perfect diffuser
};

/// Patches row by row from the corner that the image shows top left: a row runs along world +y, the
/// next lies at higher x (nearer to the camera). The grid's centre lies at the world's origin.
struct ColourChart {
  std::string name;
  std::string illuminant = "D65";  ///< of the figures it was given with
  int columns = 0;
  int rows = 0;
  double pitch_m = 0;               ///< from centre to centre
  double patch_m = 0;               ///< side of a patch
  std::vector<ChartPatch> patches;  ///< columns x rows

  Eigen::Vector2d centre_m(std::size_t patch) const;
  /// The patch at a point of the chart's plane, patches.size() beside all of them.
  std::size_t patch_at(const Eigen::Vector2d& p_m) const;
};

/// The classic chart of 24 patches (McCamy, Marcus, Davidson 1976) in its small format, with the
/// L*a*b* values that its maker published for charts until 2014 (D50, 2 degrees), adapted to D65.
const ColourChart& classic_chart();

/// XYZ under D50 to D65 and back by the linear Bradford transform (ISO 15076-1 annex E).
Eigen::Array3d d50_to_d65(const Eigen::Array3d& xyz);
/// L*a*b* relative to the white of D50 (ISO 15076-1: 0.9642, 1, 0.8249), 2 degrees, to XYZ.
Eigen::Array3d lab_d50_to_xyz(const Lab& lab);

}  // namespace brdfgate
