// The simulated image sensor: from electrons per second to counts.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "hal/sim/sim_station.hpp"

namespace brdfgate {

/// A linear sensor (EMVA 1288): electrons = rate * exposure + dark current, Poisson noise; count =
/// black level + gain * (gain_dn_per_e * electrons + read noise), rounded, clipped at full well and
/// at the ADC's end. The read noise is referred to the sensor's input: it grows with the analogue
/// gain. With a gamma the share x of the range over black becomes ((x + e)^(1 / gamma) - e^(1 /
/// gamma)) / ((1 + e)^(1 / gamma) - e^(1 / gamma)), e = 0.01, before rounding. Poisson counts over
/// 50 are drawn from the normal law of the same mean and variance. No fixed pattern: every pixel
/// has the same black level, gain and dark current.
class SimSensor {
 public:
  /// Keeps a reference to the settings.
  explicit SimSensor(const SimBenchSettings& settings) : settings_(settings) {}

  /// The exposure that the sensor makes of the one asked for: whole lines, at least one.
  double applied_exposure_s(double asked_s) const;
  /// Time to read one frame, after the exposure.
  double readout_s() const;

  struct Exposure {
    double exposure_s = 0;  ///< as applied
    double gain = 1;        ///< linear
    bool noise = true;
    std::uint64_t noise_seed = 0;  ///< equal seeds give equal noise
  };
  /// CV_16UC1 of the size of `rate_e_s`, which is CV_32FC1 in electrons per second, not negative.
  cv::Mat expose(const cv::Mat& rate_e_s, const Exposure& exposure) const;

 private:
  const SimBenchSettings& settings_;
};

}  // namespace brdfgate
