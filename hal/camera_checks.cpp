#include "hal/camera_checks.hpp"

#include <array>
#include <cmath>
#include <cstdio>

namespace brdfgate {
namespace {

/// Frames of a stream that stood idle are this old at most before they are thrown away.
constexpr double kOldestStampS = 10;
/// Some drivers stamp by their frames' schedule and round it: vivid up to half a frame ahead.
constexpr double kNewestStampS = 0.5;

}  // namespace

std::int64_t to_ns(double seconds) {
  return std::llround(1e9 * seconds);
}

std::string ms_text(double seconds) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.6g ms", 1e3 * seconds);
  return text.data();
}

std::string gain_text(double gain) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.4g", gain);
  return text.data();
}

void check_requests(const std::vector<ExposureRequest>& bracket, const std::string& device) {
  for (const ExposureRequest& request : bracket) {
    if (!std::isfinite(request.exposure_s) || request.exposure_s <= 0) {
      throw CameraError(CameraFault::not_applied, device, "arm", "the exposure must be over 0 s");
    }
    if (!std::isfinite(request.gain) || request.gain <= 0) {
      throw CameraError(CameraFault::not_applied, device, "arm", "the gain must be over 0");
    }
  }
}

double fixed_exposure_s(const ExposureRequest& request, const CameraDeviceSettings& settings) {
  const double fixed = *settings.fixed_exposure_s;
  const bool asked_for = std::abs(request.exposure_s - fixed) <= settings.line_time_s + 1e-9;
  if (asked_for || settings.accept_fixed_exposure) return fixed;
  throw CameraError(CameraFault::not_applied, settings.device, "arm",
                    "an exposure of " + ms_text(request.exposure_s) +
                        " cannot be applied; it is fixed at " + ms_text(fixed) +
                        " (camera.device.accept_fixed_exposure: true takes frames with that one)");
}

void check_stamp(std::int64_t stamp_ns, std::int64_t now_ns, double exposure_s,
                 const std::string& device) {
  const std::int64_t age = now_ns - stamp_ns;
  if (age >= -to_ns(kNewestStampS) && age <= to_ns(kOldestStampS + exposure_s)) return;
  throw CameraError(
      CameraFault::no_frame, device, "timestamp",
      std::to_string(age / 1'000'000) + " ms behind the monotonic clock; it is of another clock");
}

std::int64_t begun_ns(TimestampPoint point, std::int64_t stamp_ns, double exposure_s,
                      double readout_s) {
  switch (point) {
    case TimestampPoint::driver:
    case TimestampPoint::start_of_exposure:
      return stamp_ns;
    case TimestampPoint::start_of_readout:
      return stamp_ns - to_ns(exposure_s);
    case TimestampPoint::end_of_frame:
      return stamp_ns - to_ns(exposure_s + readout_s);
  }
  return stamp_ns;
}

void PassedFrames::count(FrameFate fate) {
  switch (fate) {
    case FrameFate::early:
      ++early;
      break;
    case FrameFate::repeated:
      ++repeated;
      break;
    case FrameFate::unknown:
      ++unknown;
      break;
    case FrameFate::unwanted:
      ++other;
      break;
    case FrameFate::taken:
      break;
  }
}

std::string PassedFrames::text() const {
  std::string out;
  const auto add = [&out](int frames, const char* what) {
    if (frames > 0) out += (out.empty() ? "" : ", ") + std::to_string(frames) + " " + what;
  };
  add(early, "begun too early");
  add(unknown, "with settings unknown");
  add(repeated, "that came twice");
  add(damaged, "truncated or damaged");
  add(other, "with another exposure or gain");
  return out.empty() ? "no frame came" : "frames came: " + out;
}

}  // namespace brdfgate
