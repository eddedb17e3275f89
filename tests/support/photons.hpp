// A sensor's counts from known radiance: Poisson electrons, Gaussian read noise, rounding,
// clipping. Independent of the product's simulator.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "model/frame.hpp"

namespace brdfgate::test {

/// The default station's sensor.
struct BenchSensor {
  SensorFormat sensor{1456, 1088, 10, Mosaic::rggb, 60, 1023};
  SensorNoise noise{0.0963, 0.3};
};

/// One exposure of a radiance image in DN/s (CV_32FC1, one value per sensor pixel).
inline RawFrame expose_once(const BenchSensor& bench, const cv::Mat& radiance, double exposure_s,
                            std::mt19937& random, double gain = 1) {
  RawFrame frame;
  frame.exposure_s = exposure_s;
  frame.gain = gain;
  frame.counts.create(radiance.size(), CV_16UC1);
  std::normal_distribution<double> normal;
  const double top = std::min(bench.sensor.full_well_dn, std::pow(2.0, bench.sensor.bits) - 1);
  for (int y = 0; y < radiance.rows; ++y) {
    for (int x = 0; x < radiance.cols; ++x) {
      const double mean_e = radiance.at<float>(y, x) * exposure_s / bench.noise.gain_dn_per_e;
      // Beyond 1000 electrons a rounded normal: its skewness (3 %) no longer matters here.
      const double electrons =
          mean_e < 1000
              ? static_cast<double>(std::poisson_distribution<int>(std::max(mean_e, 1e-12))(random))
              : std::round(mean_e + std::sqrt(mean_e) * normal(random));
      const double dn = gain * (bench.noise.gain_dn_per_e * electrons +
                                bench.noise.read_noise_dn * normal(random));
      const double count = std::round(bench.sensor.black_level_dn + dn);
      frame.counts.at<std::uint16_t>(y, x) =
          static_cast<std::uint16_t>(std::clamp(count, 0.0, top));
    }
  }
  return frame;
}

inline std::vector<RawFrame> expose(const BenchSensor& bench, const cv::Mat& radiance,
                                    const std::vector<double>& exposures_s, unsigned seed,
                                    LightIndex light = kNoLight) {
  std::mt19937 random(seed);
  std::vector<RawFrame> frames;
  for (const double t : exposures_s) {
    frames.push_back(expose_once(bench, radiance, t, random));
    frames.back().light = light;
  }
  return frames;
}

}  // namespace brdfgate::test
