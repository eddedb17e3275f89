#include "app/light_curve.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

namespace brdfgate {
namespace {

/// Frames after each switching, and switchings, each a part of a frame later than the last.
constexpr int kFrames = 32;
constexpr int kSwitchings = 5;
constexpr double kNever = std::numeric_limits<double>::infinity();
/// Under it a light is not told from noise, DN in the frame's mean.
constexpr double kLeastContrastDn = 0.5;
constexpr double kMostClipped = 0.05;
/// How long lights may take at most to be called steady, beside the configured settle time.
constexpr std::int64_t kSurelySteadyNs = 500'000'000;

class Observer {
 public:
  Observer(Station& station, const CameraConfig& config) : station_(station), config_(config) {}

  std::vector<RawFrame> take(double exposure_s, int frames, std::int64_t not_before_ns) {
    const std::vector<ExposureRequest> bracket(static_cast<std::size_t>(frames),
                                               {exposure_s, config_.gain});
    station_.camera().arm(bracket, not_before_ns);
    std::vector<RawFrame> taken;
    for (int i = 0; i < frames; ++i) {
      taken.push_back(station_.camera().next_frame(
          std::chrono::milliseconds(static_cast<long>(config_.frame_timeout_ms))));
    }
    return taken;
  }

  RawFrame steady(LightIndex light, double exposure_s) {
    light == kNoLight ? station_.lights().all_off() : station_.lights().on(light);
    return take(exposure_s, 1, station_.lights().settled_at_ns() + kSurelySteadyNs).front();
  }

  /// The longest exposure of the bracket that does not clip: the finest level.
  double choose_exposure_s(LightIndex light) {
    const double full = station_.camera().format().full_well_dn;
    for (auto ms = config_.bracket_ms.rbegin(); ms != config_.bracket_ms.rend(); ++ms) {
      const RawFrame frame = steady(light, *ms * 1e-3);
      const double clipped =
          double(cv::countNonZero(frame.counts >= full)) / double(frame.counts.total());
      if (clipped <= kMostClipped) return *ms * 1e-3;
    }
    return config_.bracket_ms.front() * 1e-3;
  }

  /// Frames from switching on, from `phase` of a frame later on.
  std::vector<RawFrame> rise(LightIndex light, double exposure_s, double phase) {
    const RawFrame dark = steady(kNoLight, exposure_s);
    const auto [first, second] = [&] {
      const auto frames = take(exposure_s, 2, dark.timestamp_ns);
      return std::pair{frames[0].timestamp_ns, frames[1].timestamp_ns};
    }();
    station_.lights().on(light);
    const auto wait_ns = static_cast<std::int64_t>(phase * static_cast<double>(second - first));
    return take(exposure_s, kFrames, station_.lights().switched_at_ns() + wait_ns);
  }

 private:
  Station& station_;
  const CameraConfig& config_;
};

double mean_of(const RawFrame& frame) {
  return cv::mean(frame.counts)[0];
}

}  // namespace

LightCurve measure_light_curve(Station& station, const CameraConfig& config, LightIndex light) {
  const LightsOffAtExit off(station.lights());
  Observer observer(station, config);
  LightCurve curve;
  curve.light = light;
  curve.exposure_s = observer.choose_exposure_s(light);
  const double lit = mean_of(observer.steady(light, curve.exposure_s));
  const double dark = mean_of(observer.steady(kNoLight, curve.exposure_s));
  curve.contrast_dn = lit - dark;
  curve.seen = curve.contrast_dn > kLeastContrastDn;
  if (!curve.seen) return curve;
  for (int i = 0; i < kSwitchings; ++i) {
    const auto frames = observer.rise(light, curve.exposure_s, double(i) / kSwitchings);
    for (const RawFrame& frame : frames) {
      const double after =
          1e-9 * static_cast<double>(frame.timestamp_ns - station.lights().switched_at_ns());
      curve.points.push_back({after, (mean_of(frame) - dark) / curve.contrast_dn});
    }
    station.lights().verify();
    station.lights().all_off();
  }
  std::sort(curve.points.begin(), curve.points.end(),
            [](const auto& a, const auto& b) { return a.after_s < b.after_s; });
  curve.settled_s = curve.points.front().after_s;
  for (std::size_t i = 0; i < curve.points.size(); ++i) {
    if (std::abs(curve.points[i].level - 1) <= kSettled) continue;
    curve.settled_s = i + 1 < curve.points.size() ? curve.points[i + 1].after_s : kNever;
  }
  return curve;
}

}  // namespace brdfgate
