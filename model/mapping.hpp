// The log-relative mapping that makes BRDFs linear (thesis, contribution C.IV, eq. 1 and 2).
#pragma once

#include <algorithm>
#include <cmath>

#include "model/directions.hpp"

namespace brdfgate {

/// Epsilon of C.IV eq. 1: keeps the logarithm finite and small values from counting noise; 1/sr.
inline constexpr double kMappingEpsilon = 0.001;

/// Cosine weight of C.IV eq. 2: w = max(cos_i cos_o, epsilon). The product, not the maximum of the
/// two cosines that C.VI describes.
inline double cosine_weight(const Cosines& c) {
  return std::max(c.i * c.o, kMappingEpsilon);
}

/// x = ln((f w + e) / (f_ref w + e)); f, f_ref in 1/sr, not negative.
inline double to_mapped(double f, double f_ref, double weight) {
  return std::log((f * weight + kMappingEpsilon) / (f_ref * weight + kMappingEpsilon));
}

/// Inverse of to_mapped, held at 0 from below (x may be any real number).
inline double from_mapped(double x, double f_ref, double weight) {
  return std::max(0.0,
                  (std::exp(x) * (f_ref * weight + kMappingEpsilon) - kMappingEpsilon) / weight);
}

}  // namespace brdfgate
