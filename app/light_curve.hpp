// How the lights rise, seen by the camera: what lights.settle_ms has to be.
#pragma once

#include <vector>

#include "app/station.hpp"

namespace brdfgate {

/// One frame after switching on.
struct LightCurvePoint {
  double after_s = 0;  ///< start of its exposure, from switching on
  double level = 0;    ///< mean over its exposure, of the steady level
};

struct LightCurve {
  LightIndex light = kNoLight;
  double exposure_s = 0;   ///< of the frames
  double contrast_dn = 0;  ///< steady level over the level without light, mean of the frame
  bool seen = false;       ///< the light changes anything at all
  std::vector<LightCurvePoint> points;  ///< by rising time
  /// From here on every frame keeps within kSettled of the steady level; the first frame's time
  /// where they all do, infinite where the last one does not. How finely it tells depends on the
  /// camera's frame rate: the switching is repeated at other instants of a frame.
  double settled_s = 0;
};

inline constexpr double kSettled = 0.01;

/// Precondition: something lies under the camera (Station::next_part). Lights are off afterwards.
/// Throws DeviceError.
LightCurve measure_light_curve(Station& station, const CameraConfig& config, LightIndex light);

}  // namespace brdfgate
