// Haze and multi-angle colour from a BRDF, and whether the rig looked there.
#pragma once

#include <array>

#include "model/brdf.hpp"
#include "model/colour.hpp"
#include "model/samples.hpp"

namespace brdfgate {

/// Aspecular angles of ASTM E2194 and DIN 6175-2, degrees: lit at 45 degrees, seen in the plane of
/// incidence so far from the mirror direction, toward the normal.
inline constexpr std::array<double, 5> kAspecularDeg{15, 25, 45, 75, 110};

/// Directions of one of them.
DirectionPair aspecular_directions(double aspecular_deg);

/// Haze as ASTM D4039: gloss at 60 degrees less gloss at 20, gloss units. Defined for non-metals of
/// over 70 GU at 60 degrees; NaN below. (Whether a surface is metallic is for the reader to know.)
double haze_gu(const std::array<double, 3>& gloss_gu_20_60_85);

/// Colour and level at the aspecular angles.
struct AspecularReadings {
  std::array<Lab, 5> lab;
  /// Flop index of Alman (1987): 2.69 (L*15 - L*110)^1.11 / L*45^0.86; 0 where the surface does not
  /// get darker away from the mirror direction, NaN for L*45 = 0.
  double flop_index = 0;
};
AspecularReadings aspecular_readings(const Brdf& brdf);
/// The index itself, from L* at those angles.
double flop_index(double l15, double l45, double l110);

/// Whether the rig looked there: one of the bins lies within kMeasuredReach (the arc between half
/// vectors and the difference of theta_d, each). Otherwise the value is extrapolated by the basis.
inline constexpr double kMeasuredReach = 0.0873;  ///< rad, 5 degrees
bool is_measured(const BinnedSamples& samples, const HalfDiff& directions);

}  // namespace brdfgate
