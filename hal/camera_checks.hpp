// What every real camera does alike: requests checked, timestamps converted, refusals worded.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "hal/camera.hpp"
#include "hal/camera_settings.hpp"
#include "hal/frame_matcher.hpp"

namespace brdfgate {

/// Gain codes are coarse: what is this near to the asked gain is that gain.
inline constexpr double kGainTolerance = 0.02;

std::int64_t to_ns(double seconds);
std::string ms_text(double seconds);
std::string gain_text(double gain);

/// Throws CameraFault::not_applied for an exposure or gain that is no number over zero.
void check_requests(const std::vector<ExposureRequest>& bracket, const std::string& device);

/// The exposure of a frame where it is fixed. Throws CameraFault::not_applied for a request of
/// another one, unless the settings accept it. Precondition: the settings have one.
double fixed_exposure_s(const ExposureRequest& request, const CameraDeviceSettings& settings);

/// Throws CameraFault::no_frame for a timestamp that cannot be of the monotonic clock: far in
/// the future, or older than a frame can be.
void check_stamp(std::int64_t stamp_ns, std::int64_t now_ns, double exposure_s,
                 const std::string& device);

/// Start of exposure of the first row. `point` is not TimestampPoint::driver.
std::int64_t begun_ns(TimestampPoint point, std::int64_t stamp_ns, double exposure_s,
                      double readout_s);

/// Frames of one wait that did not count, for messages.
struct PassedFrames {
  int early = 0;
  int unknown = 0;
  int repeated = 0;
  int damaged = 0;
  int other = 0;  ///< with another exposure or gain than those missing

  void count(FrameFate fate);
  int sum() const { return early + unknown + repeated + damaged + other; }
  std::string text() const;
};

}  // namespace brdfgate
