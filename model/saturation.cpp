#include "model/saturation.hpp"

#include <algorithm>
#include <cmath>

namespace brdfgate {
namespace {

/// Ordered dither (Bayer 1973): 0..63 over 8 x 8 cells, neighbours far apart in rank.
int dither_rank(int u, int v) {
  int rank = 0;
  for (int bit = 0; bit < 3; ++bit) {
    const int x = (u >> bit) & 1;
    const int y = (v >> bit) & 1;
    rank = rank * 4 + 2 * (x ^ y) + y;
  }
  return rank;
}

}  // namespace

SaturationRule::SaturationRule(const SensorFormat& sensor, const SensorNoise& noise, double gain,
                               bool spread) {
  const double range = sensor.full_well_dn - sensor.black_level_dn;
  const double dn_per_e = noise.gain_dn_per_e * gain;
  const double read = noise.read_noise_dn * gain;
  // EMVA 1288: shot noise, read noise, quantisation.
  const double sigma = std::sqrt(dn_per_e * range + read * read + 1.0 / 12.0);
  // Where three sigmas are a large part of the range, half of it must stay usable.
  cut_dn_ = sensor.full_well_dn - std::min(3 * sigma, range / 2);
  // sigma^2 / (W signal) = dn_per_e / W.
  span_dn_ = spread ? std::min(dn_per_e / kTruncationBias, range / 4) : 0;
}

int SaturationRule::first_saturated_dn(int u, int v) const {
  constexpr int kRanks = kDitherPeriod * kDitherPeriod;
  const double share = (dither_rank(u, v) + 0.5) / kRanks;
  return static_cast<int>(std::lround(cut_dn_ - share * span_dn_));
}

}  // namespace brdfgate
