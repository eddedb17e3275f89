// Photon-transfer sweep: gain, full well and linearity of a sensor (EMVA Standard 1288) from frames
// of one steady light at many exposures.
#pragma once

#include <vector>

#include "model/frame.hpp"

namespace brdfgate {

/// One exposure of the sweep: two equal frames or more.
struct SweepPoint {
  double exposure_s = 0;    ///< times gain
  double mean_dn = 0;       ///< over black
  double variance_dn2 = 0;  ///< temporal, of one count; quantisation included
};

struct PhotonTransfer {
  std::vector<SweepPoint> points;  ///< rising exposure
  double gain_dn_per_e = 0;        ///< slope of variance against mean, up to 70 % of saturation
  double read_noise_dn = 0;        ///< root of its intercept, quantisation taken off; 0 where under
  /// Count, black level included, that no well-lit pixel exceeds: the mean of frames whose variance
  /// has collapsed, less three of their pixels' standard deviations; where the sweep has none, the
  /// greatest variance's mean (EMVA 1288's saturation).
  double full_well_dn = 0;
  double saturation_e = 0;  ///< electrons there
  /// Worst deviation of the mean from proportionality to exposure between 5 and 95 % of saturation,
  /// in percent of the mean (EMVA 1288's linearity error), after a fit of relative residuals.
  double linearity_percent = 0;
  /// A tone curve, or exposures that are not what they say: deviation over kLinearLimit.
  bool linear() const { return linearity_percent < kLinearLimit; }
  static constexpr double kLinearLimit = 2;
};

/// From `role: ptc` captures: equal frames (same light, exposure and gain) are paired within and
/// across captures; the image's middle (a quarter of each side; of a mosaic its greens) is used.
/// Dark frames are left out. `black_level_dn` as measured. Throws InputError: under 5 exposures in
/// pairs, none reaching 50 % of the format's full well, signals that do not rise.
PhotonTransfer photon_transfer(const std::vector<Capture>& sweep, double black_level_dn);

}  // namespace brdfgate
