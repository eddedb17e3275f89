// Exposure brackets to radiance with variance (method.md section 2; maximum-likelihood weights of a
// linear sensor).
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "model/frame.hpp"

namespace brdfgate {

/// Bits of a mask; 0 means good. A cell's worst colour channel decides.
enum MaskBit : unsigned char {
  kClipped = 1,     ///< saturated even in the shortest exposure
  kNoiseFloor = 2,  ///< merged signal-to-noise ratio under 1 (EMVA 1288's threshold)
  kInvalid = 4,     ///< no white reference or no geometry here
};

/// Scene radiance in DN/s at analogue gain 1 (proportional to W m^-2 sr^-1 within one channel).
/// One pixel per mosaic cell.
struct Radiance {
  cv::Mat value;     ///< CV_32FC1 or CV_32FC3 (R, G, B order)
  cv::Mat variance;  ///< same type, of value
  cv::Mat mask;      ///< CV_8UC1 of MaskBit
};

/// Merges the frames of one bracket (one light, any number of exposures, at least one).
/// x = sum w_j z_j / t_j / sum w_j with w_j = t_j^2 / (g t_j x + s_r^2 + 1/12), x iterated three
/// times; saturated samples (from three sigmas below full well, see model/saturation.hpp) are left
/// out. z_j is black-level corrected, t_j is exposure times gain. Variance 1 / sum w_j. Never NaN;
/// masked cells keep a finite bound. Throws InputError: no frame, mixed sizes or type, exposure or
/// gain not positive.
Radiance merge_bracket(const SensorFormat& sensor, const SensorNoise& noise,
                       const std::vector<RawFrame>& frames);

/// lit - ambient, variances added; may come out negative by noise. Masks are joined except for
/// the ambient's noise floor (an ambient of nothing is good).
Radiance subtract_ambient(const Radiance& lit, const Radiance& ambient);

/// Splits a capture by light and merges: [0] ambient, [1] light 1, [2] light 2, ambient subtracted
/// from the lights. Throws InputError naming what is missing: the ambient frame or a light's
/// bracket.
struct RadianceSet {
  Radiance ambient;
  std::vector<Radiance> lights;  ///< [0] is light 1
};
RadianceSet to_radiance(const Capture& capture, const SensorNoise& noise, int lights);

/// The same with another way to merge one bracket.
using BracketMerge = std::function<Radiance(const std::vector<RawFrame>&)>;
RadianceSet to_radiance(const Capture& capture, int lights, const BracketMerge& merge);

}  // namespace brdfgate
