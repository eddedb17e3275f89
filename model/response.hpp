// The response of a camera with a tone curve, per colour channel, and brackets merged with it. The
// linear sensor's chain (merge_bracket) does not pass here.
#pragma once

#include <vector>

#include "model/frame.hpp"
#include "model/tone_curve.hpp"

namespace brdfgate {

/// Per channel (R, G, B, or one for a mono sensor), X in DN of a linear camera with the same black
/// level and full well: exp(log_x) is full_well_dn - black_level_dn at full_well_dn. Figures are
/// rounded to 1e-6, as a calibration file keeps them.
using Response = std::vector<ToneCurve>;

/// From `role: ptc` captures: one steady scene under one light at many exposures; the light with
/// most of them is used, one frame of each. Counts within `margin` (a share of the range from black
/// level to full well) of either end are taken as clipped. Throws InputError as recover_tone_curve
/// does, and for under three exposures.
Response recover_response(const std::vector<Capture>& sweep, double margin = 0.02);

/// As merge_bracket, in units of the response's X per second: every colour plane merged with its
/// curve (merge_toned), the two greens averaged, a cell masked as its worst channel is. Throws
/// InputError where the response is not of this sensor.
Radiance merge_bracket(const SensorFormat& sensor, const Response& response,
                       const std::vector<RawFrame>& frames);

}  // namespace brdfgate
