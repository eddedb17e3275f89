// What a camera delivers: sensor counts with the settings that were applied, not those asked for.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace brdfgate {

/// Colour filter over the sensor, named by the 2x2 cell read row by row; mono has none.
enum class Mosaic { mono, rggb, bggr, grbg, gbrg };

/// The light that burned during an exposure: 0 none, 1 the light at the mirror direction (it shows
/// the highlight), 2 the light that shows the diffuse reflectance.
using LightIndex = int;
inline constexpr LightIndex kNoLight = 0;

/// The sensor's raw format. Counts are digital numbers (DN), black level included.
struct SensorFormat {
  int width = 0;   ///< pixels
  int height = 0;  ///< pixels
  int bits = 0;    ///< of the analogue-to-digital converter: 8..16
  Mosaic mosaic = Mosaic::mono;
  double black_level_dn = 0;  ///< mean count of a pixel that saw nothing
  double full_well_dn = 0;    ///< count from which a pixel is clipped, black level included

  /// Colour channels of a measurement: 3 with a mosaic, 1 without.
  int channels() const { return mosaic == Mosaic::mono ? 1 : 3; }
  /// Size of the measured image: one 2x2 mosaic cell is one pixel (no demosaic interpolation).
  cv::Size cells() const {
    const int side = mosaic == Mosaic::mono ? 1 : 2;
    return {width / side, height / side};
  }
  bool operator==(const SensorFormat&) const = default;
};

/// The linear sensor's noise: var(z) = gain_dn_per_e * signal + read_noise_dn^2 + 1/12 (EMVA 1288).
struct SensorNoise {
  double gain_dn_per_e = 0;  ///< DN per electron at analogue gain 1
  double read_noise_dn = 0;  ///< standard deviation of a dark count at analogue gain 1
};

/// One exposure. `counts` is CV_16UC1, height x width, mosaic kept.
struct RawFrame {
  cv::Mat counts;
  LightIndex light = kNoLight;
  double exposure_s = 0;          ///< as applied
  double gain = 1;                ///< analogue gain as applied, linear
  std::int64_t timestamp_ns = 0;  ///< start of exposure, the camera's steady clock
};

/// Everything captured of one part: brackets under each light and at least one frame without light.
struct Capture {
  SensorFormat sensor;
  std::vector<RawFrame> frames;
};

}  // namespace brdfgate
