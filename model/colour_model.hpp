// What is kept of a camera's colour calibration.
#pragma once

#include <Eigen/Core>
#include <string>

namespace brdfgate {

/// A matrix, or a root-polynomial of the second degree (Finlayson, Mackiewicz, Hurlbert 2015): like
/// the matrix it does not depend on the light's level.
enum class ColourModel { matrix, root_polynomial };

/// Camera RGB of a reflectance (a white is 1, 1, 1) to XYZ, D65, 2 degrees, Y = 1 for white.
struct CameraColour {
  ColourModel model = ColourModel::matrix;
  Eigen::MatrixXd to_xyz = Eigen::MatrixXd::Identity(3, 3);  ///< 3 x 3, or 3 x 6
  std::string chart;                                         ///< its name
  std::string illuminant;  ///< of the chart's figures, before adaptation to D65
  double de00_mean = 0;    ///< CIEDE2000 over the chart's patches
  double de00_max = 0;

  Eigen::Array3d xyz(const Eigen::Array3d& rgb) const;
  Eigen::Matrix3d xyz_slope(const Eigen::Array3d& rgb) const;  ///< its derivatives, one row a value
};

/// r, g, b, and for the root-polynomial sqrt(rg), sqrt(gb), sqrt(rb); negative channels count as 0
/// under the roots.
Eigen::VectorXd colour_terms(ColourModel model, const Eigen::Array3d& rgb);

}  // namespace brdfgate
