// Light 2's reflectance as smoothed logarithms: what regions are told apart by.
#pragma once

#include <opencv2/core.hpp>

#include "model/mapping.hpp"
#include "model/reflectance.hpp"

namespace brdfgate {

/// ln(f + e) instead of ln f wherever regions and defects compare reflectances: values under e
/// count noise, as in the mapping of C.IV eq. 1. 1/sr.
inline constexpr double kLogFloor = kMappingEpsilon;

/// Mean over the 3 x 3 used cells around each used cell, then ln(f + kLogFloor); means under 0 are
/// held at 0 (pure noise). Cells that are not used are 0.
struct LogImage {
  cv::Mat value;     ///< CV_32F, channels of the reflectance
  cv::Mat variance;  ///< same type, of value, from the propagated pixel noise
};
/// @param use CV_8UC1, 255 where a cell takes part; cells masked kInvalid never do
LogImage smoothed_log(const Reflectance& r, const cv::Mat& use);

/// Light 2's reflectance, or the only light's. Throws InputError when there is none, when there are
/// more than three channels, or when images differ in size or type.
const Reflectance& diffuse_light(const std::vector<Reflectance>& r);

}  // namespace brdfgate
