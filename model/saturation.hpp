// From which count on a sample of a bracket counts as saturated.
//
// A cut at one fixed count truncates: where the mean lies on the cut, only the samples that noise
// made low pass, and the merged radiance is too low by 0.4 sigma (0.4 % at 10,000 electrons) over a
// whole surface. So the cut of every exposure but the shortest is spread from cell to cell over a
// span W by an ordered dither: by Stein's lemma an average over cells is then low by no more than
// sigma^2 / W, and each cell's variance stays that of the samples it used.
#pragma once

#include "model/frame.hpp"

namespace brdfgate {

/// Bias that an average over cells may take from leaving out saturated samples.
inline constexpr double kTruncationBias = 0.001;

/// Cells of one period of the dither pattern, in each direction.
inline constexpr int kDitherPeriod = 8;

/// First saturated count of one exposure.
class SaturationRule {
 public:
  /// `spread`: a shorter exposure exists to fall back on.
  SaturationRule(const SensorFormat& sensor, const SensorNoise& noise, double gain, bool spread);

  /// For the cell in column u, row v; black level included.
  int first_saturated_dn(int u, int v) const;

 private:
  double cut_dn_;   ///< three sigmas below full well
  double span_dn_;  ///< W; 0 where the cut is the same everywhere
};

}  // namespace brdfgate
