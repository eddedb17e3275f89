// Do the lights do what they are told? The frames with and without them tell.
#pragma once

#include <string>
#include <vector>

#include "model/calibration.hpp"
#include "model/frame.hpp"

namespace brdfgate {

/// The white reference's mean radiance under each light, DN/s at gain 1 and averaged over the
/// mosaic: what light_health() measures by. [0] is light 1.
std::vector<double> white_levels(const Calibration& calibration);

/// One light, in shares of the white reference's mean under it.
struct LightSight {
  double gives = 0;    ///< with it less without it
  double without = 0;  ///< in the frames without light
};
/// Means over whole frames, the longest exposure that does not clip: with a million pixels they
/// tell a thousandth of white from nothing, and the nest around a part is never that black. Uses
/// raw frames, so that it needs no part. NaN where the capture lacks the frames. Precondition:
/// `levels` over 0.
std::vector<LightSight> see_lights(const Capture& capture, double black_level_dn,
                                   const std::vector<double>& levels);

/// The first light that makes no difference, in words; empty when all work. A light that is told to
/// burn and to be dark and looks the same both times either stays dark or, where the frames without
/// light are bright, stays on.
std::string light_fault(const std::vector<LightSight>& lights);

}  // namespace brdfgate
