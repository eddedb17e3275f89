#include "hal/sim/sensor.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "hal/sim/random.hpp"

namespace brdfgate {
namespace {

constexpr float kToe = 0.01F;  // share of the range that keeps a tone curve's slope finite at black
constexpr float kPoissonLimit = 50;  // electrons; from here on the normal law stands in

/// 1 / k for the inversion's steps; 200 is far beyond any quantile that it can be asked for.
constexpr auto kReciprocal = [] {
  std::array<double, 200> r{};
  for (std::size_t k = 1; k < r.size(); ++k)
    r[k] = 1.0 / static_cast<double>(k);
  return r;
}();

/// Poisson variate by inversion: the smallest k whose cumulative probability exceeds u. OpenCV's
/// uniform floats include 1, which no finite k exceeds: the last float below it stands in.
float poisson(float mean, float u) {
  const double below = std::min(u, std::nextafter(1.0F, 0.0F));
  double p = std::exp(-mean);
  double cumulative = p;
  std::size_t k = 0;
  while (cumulative <= below && k + 1 < kReciprocal.size()) {
    ++k;
    p *= mean * kReciprocal[k];
    cumulative += p;
  }
  return static_cast<float>(k);
}

/// Collected electrons, given one standard normal and one uniform deviate.
float shot(float mean, float normal, float uniform) {
  if (mean < kPoissonLimit) return poisson(mean, uniform);
  return mean + std::sqrt(mean) * normal;
}

/// Deviates for one row. Seeded per row, so that the result does not depend on how rows are shared
/// among threads.
struct RowNoise {
  cv::Mat1f shot_normal, shot_uniform, read_normal;

  RowNoise(int width, std::uint64_t seed)
      : shot_normal(1, width), shot_uniform(1, width), read_normal(1, width) {
    cv::RNG rng(seed);
    rng.fill(shot_normal, cv::RNG::NORMAL, 0, 1);
    rng.fill(shot_uniform, cv::RNG::UNIFORM, 0, 1);
    rng.fill(read_normal, cv::RNG::NORMAL, 0, 1);
  }
};

}  // namespace

double SimSensor::applied_exposure_s(double asked_s) const {
  const double lines = std::round(asked_s / settings_.line_time_s);
  return std::max(1.0, lines) * settings_.line_time_s;
}

double SimSensor::readout_s() const {
  return settings_.sensor.height * settings_.line_time_s;
}

cv::Mat SimSensor::expose(const cv::Mat& rate_e_s, const Exposure& exposure) const {
  const SensorFormat& sensor = settings_.sensor;
  const auto time = static_cast<float>(exposure.exposure_s);
  const auto dark = static_cast<float>(settings_.dark_current_e_s * exposure.exposure_s);
  const auto dn_per_e = static_cast<float>(settings_.noise.gain_dn_per_e * exposure.gain);
  const auto read_dn = static_cast<float>(settings_.noise.read_noise_dn * exposure.gain);
  const auto black = static_cast<float>(sensor.black_level_dn);
  const auto top = static_cast<float>(
      std::min(std::floor(sensor.full_well_dn), std::ldexp(1.0, sensor.bits) - 1));
  const auto exponent = static_cast<float>(1 / settings_.gamma);
  const float toe = std::pow(kToe, exponent), end = std::pow(1 + kToe, exponent);
  const auto count = [&](float electrons, float read) {
    float signal = dn_per_e * electrons + read;
    if (exponent != 1) {
      const float share = std::max(signal / (top - black) + kToe, 0.0F);
      signal = (top - black) * (std::pow(share, exponent) - toe) / (end - toe);
    }
    return cv::saturate_cast<std::uint16_t>(std::clamp(black + signal, 0.0F, top));
  };
  cv::Mat counts(rate_e_s.size(), CV_16UC1);
  cv::parallel_for_(cv::Range(0, counts.rows), [&](const cv::Range& rows) {
    for (int r = rows.start; r < rows.end; ++r) {
      const float* rate = rate_e_s.ptr<float>(r);
      auto* out = counts.ptr<std::uint16_t>(r);
      if (!exposure.noise) {
        for (int c = 0; c < counts.cols; ++c)
          out[c] = count(rate[c] * time + dark, 0);
        continue;
      }
      const RowNoise noise(counts.cols,
                           derive_seed(exposure.noise_seed, static_cast<std::uint64_t>(r)));
      for (int c = 0; c < counts.cols; ++c) {
        const float mean = rate[c] * time + dark;
        const float electrons = shot(mean, noise.shot_normal(c), noise.shot_uniform(c));
        out[c] = count(electrons, read_dn * noise.read_normal(c));
      }
    }
  });
  return counts;
}

}  // namespace brdfgate
