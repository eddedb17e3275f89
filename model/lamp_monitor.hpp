// Lamps drift: what a white patch in view tells of each, part by part.
//
// The patch is lit as the part is, so the ratio of what it shows now to what it would show in the
// calibration's light is the lamp's; dividing reflectance by it leaves the part's own.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "model/calibration.hpp"
#include "model/monitor_patch.hpp"

namespace brdfgate {

/// One lamp's light now over that of the calibration.
struct LampLevel {
  Eigen::Array3d ratio = Eigen::Array3d::Ones();  ///< per channel; mono: the first
  int channels = 3;
  bool known = false;  ///< false: the patch is covered, dirty, clipped or out of view; ratio 1

  /// Mean over the channels less 1; NaN where not known.
  double drift() const;
};

/// The cells that see the patch, its outermost millimetre (a quarter of its width, where that is
/// less) left out: the image of an edge is a mixture.
std::vector<cv::Point> patch_cells(const StationGeometry& geometry, const SensorFormat& sensor,
                                   const MonitorPatch& patch);

/// What the patch reflects, 1/sr, per light: the calibration's measured figures, else its maker's
/// (albedo / pi: a Lambertian patch).
std::vector<Eigen::Array3d> patch_reflectance(const MonitorPatch& patch,
                                              const Calibration& calibration);

/// Per light: the mean over the cells of X / X_ref rho_ref / pi over the patch's reflectance, of
/// those within a tenth of their median.
/// Not known where fewer than 50 or half of the cells can be used, or where over a tenth of those
/// departs from the median by more than a tenth (something lies on the patch).
/// @param expected  per light, as patch_reflectance() says
/// Throws InputError where lights or sizes are not the calibration's.
std::vector<LampLevel> lamp_levels(const std::vector<Radiance>& lights,
                                   const Calibration& calibration,
                                   const std::vector<cv::Point>& cells,
                                   const std::vector<Eigen::Array3d>& expected);

/// The patch's own reflectance per light and channel, 1/sr, from a capture of the open nest taken
/// with the white references: what patch_reflectance() then returns. Throws InputError where the
/// patch cannot be seen, naming the light.
std::vector<Eigen::Array3d> measure_patch(const std::vector<Radiance>& lights,
                                          const Calibration& calibration,
                                          const MonitorPatch& patch);

}  // namespace brdfgate
