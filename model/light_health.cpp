#include "model/light_health.hpp"

#include <algorithm>
#include <cstdio>
#include <limits>
#include <opencv2/core.hpp>

namespace brdfgate {
namespace {

/// Of white: the nest gives a hundred times more, even around a black part.
constexpr double kDark = 0.002;
/// Of white: frames without light that are so bright while a light makes no difference show that
/// light, not the hall.
constexpr double kBright = 0.05;
/// A frame with a larger share of clipped pixels says too little of its mean.
constexpr double kMostClipped = 0.05;

double clipped_share(const RawFrame& frame, double full_well_dn) {
  return double(cv::countNonZero(frame.counts >= full_well_dn)) / double(frame.counts.total());
}

/// DN/s at gain 1, of the longest exposure that does not clip, else of the shortest.
double level_under(const Capture& capture, LightIndex light, double black_level_dn) {
  std::vector<const RawFrame*> frames;
  for (const RawFrame& frame : capture.frames) {
    if (frame.light == light) frames.push_back(&frame);
  }
  const auto time = [](const RawFrame& frame) { return frame.exposure_s * frame.gain; };
  std::sort(frames.begin(), frames.end(),
            [&](const RawFrame* a, const RawFrame* b) { return time(*a) > time(*b); });
  for (const RawFrame* frame : frames) {
    const bool last = frame == frames.back();
    if (!last && clipped_share(*frame, capture.sensor.full_well_dn) > kMostClipped) continue;
    return (cv::mean(frame->counts)[0] - black_level_dn) / time(*frame);
  }
  return std::numeric_limits<double>::quiet_NaN();  // no such frame: to_radiance() complains of it
}

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f %%", 100 * share);
  return text;
}

}  // namespace

std::vector<double> white_levels(const Calibration& calibration) {
  std::vector<double> levels;
  for (const Radiance& white : calibration.white) {
    const cv::Scalar mean = cv::mean(white.value, (white.mask & kInvalid) == 0);
    // A mosaic has two green pixels in a cell.
    levels.push_back(white.value.channels() == 1 ? mean[0] : (mean[0] + 2 * mean[1] + mean[2]) / 4);
  }
  return levels;
}

std::vector<LightSight> see_lights(const Capture& capture, double black_level_dn,
                                   const std::vector<double>& levels) {
  const double ambient = level_under(capture, kNoLight, black_level_dn);
  std::vector<LightSight> lights;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const double lit = level_under(capture, static_cast<LightIndex>(i) + 1, black_level_dn);
    lights.push_back({(lit - ambient) / levels[i], ambient / levels[i]});
  }
  return lights;
}

std::string light_fault(const std::vector<LightSight>& lights) {
  for (std::size_t i = 0; i < lights.size(); ++i) {
    if (!(lights[i].gives < kDark)) continue;
    const std::string light = "light " + std::to_string(i + 1);
    if (lights[i].without >= kBright) {
      return light + " stays on: frames without light have " + percent(lights[i].without) +
             " of white, and no more with it";
    }
    return light + " stays dark: it adds " + percent(std::max(lights[i].gives, 0.0)) + " of white";
  }
  return {};
}

}  // namespace brdfgate
