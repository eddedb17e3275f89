// merge_bracket's definition pixel by pixel in double precision: slow and plain.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "model/radiance.hpp"
#include "model/saturation.hpp"

namespace brdfgate::test {

struct MergedPixel {
  double value = 0;
  double variance = 0;
  bool clipped = false;
};

inline MergedPixel merge_pixel_oracle(const SensorFormat& sensor, const SensorNoise& noise,
                                      const std::vector<RawFrame>& frames, int x, int y) {
  const int side = sensor.mosaic == Mosaic::mono ? 1 : 2;
  const auto t = [](const RawFrame& f) { return f.exposure_s * f.gain; };
  const auto shortest = *std::min_element(
      frames.begin(), frames.end(), [&](const auto& a, const auto& b) { return t(a) < t(b); });
  struct Sample {
    double z, t, gain;
  };
  std::vector<Sample> samples;
  MergedPixel out;
  for (const RawFrame& f : frames) {
    const bool is_shortest = t(f) <= 1.01 * t(shortest);
    const SaturationRule rule(sensor, noise, f.gain, !is_shortest);
    const int count = f.counts.at<std::uint16_t>(y, x);
    const bool saturated = count >= rule.first_saturated_dn(x / side, y / side);
    if (t(f) == t(shortest)) out.clipped = saturated;
    if (!saturated || t(f) == t(shortest)) {
      samples.push_back({count - sensor.black_level_dn, t(f), f.gain});
    }
  }
  double total = 0, time = 0;
  for (const Sample& s : samples) {
    total += s.z / s.gain;
    time += s.t / s.gain;
  }
  out.value = total / time;
  for (int step = 0; step < 3; ++step) {
    double wx = 0, w = 0;
    for (const Sample& s : samples) {
      const double shot = noise.gain_dn_per_e * s.gain * s.t * std::max(out.value, 0.0);
      const double read = noise.read_noise_dn * s.gain;
      const double weight = s.t * s.t / (shot + read * read + 1.0 / 12.0);
      wx += weight * s.z / s.t;
      w += weight;
    }
    out.value = wx / w;
    out.variance = 1 / w;
  }
  return out;
}

/// One cell of the measured image: `pattern` names the 2x2 cell's colours row by row ("rggb"), or
/// is "m". Mono: [0] only.
inline std::array<MergedPixel, 3> merge_cell_oracle(const SensorFormat& sensor,
                                                    const SensorNoise& noise,
                                                    const std::vector<RawFrame>& frames,
                                                    const std::string& pattern, int u, int v) {
  if (pattern == "m") return {merge_pixel_oracle(sensor, noise, frames, u, v), {}, {}};
  std::array<MergedPixel, 3> sum{};
  std::array<int, 3> count{};
  for (int i = 0; i < 4; ++i) {
    const std::size_t c = std::string("rgb").find(pattern[static_cast<std::size_t>(i)]);
    const auto p = merge_pixel_oracle(sensor, noise, frames, 2 * u + i % 2, 2 * v + i / 2);
    sum[c].value += p.value;
    sum[c].variance += p.variance;
    sum[c].clipped |= p.clipped;
    ++count[c];
  }
  for (std::size_t c = 0; c < 3; ++c) {
    sum[c].value /= count[c];
    sum[c].variance /= count[c] * count[c];
  }
  return sum;
}

}  // namespace brdfgate::test
