// The white reference's own radiance factor: no white is Lambertian at 55 degrees in the mirror
// direction (method.md section 2.7).
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "model/calibration.hpp"

namespace brdfgate {

/// Per light: theta_h (radians, the angle between the half vector and the plate's normal) and the
/// radiance over that of a Lambertian plate of the certified reflectance; rising theta_h.
struct WhiteFactorTable {
  std::string name;
  std::vector<std::vector<std::pair<double, double>>> lights;
  double sigma = 0.005;  ///< relative standard uncertainty of its figures

  /// Linear between its figures, held beyond them.
  double factor(std::size_t light, double theta_h) const;
};

/// Turns the white radiances into those of a Lambertian plate, with the angles of `geometry`, and
/// notes the table's name and sigma. `undo`: the way back. Throws InputError: another number of
/// lights, a factor not over 0, angles that do not rise.
void apply_white_factor(const WhiteFactorTable& table, const StationGeometry& geometry,
                        Calibration& calibration, bool undo = false);

}  // namespace brdfgate
