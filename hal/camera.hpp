// A camera that takes brackets.
#pragma once

#include <chrono>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "hal/device_error.hpp"
#include "model/frame.hpp"

namespace brdfgate {

/// What went wrong with a camera; each has its error code on the PLC.
enum class CameraFault {
  absent,         ///< not there, not ours, or not what the configuration says
  no_frame,       ///< no usable frame in time: late, dropped, truncated, frozen
  not_applied,    ///< an exposure or gain that the camera cannot or does not apply
  out_of_memory,  ///< no memory for its buffers
  implausible,    ///< frames whose pixels contradict each other
};

class CameraError : public DeviceError {
 public:
  CameraError(CameraFault fault, const std::string& device, const std::string& call,
              const std::string& what)
      : DeviceError(device, call, what), fault_(fault) {}
  CameraFault fault() const { return fault_; }

 private:
  CameraFault fault_;
};

/// One exposure of a bracket, as asked for.
struct ExposureRequest {
  double exposure_s = 0;
  double gain = 1;
};

/// What a camera can be asked for.
struct CameraCapabilities {
  bool exposure = true;  ///< false: one fixed exposure, which every frame reports
  bool gain = true;      ///< false: gain 1 only
};

class Camera {
 public:
  Camera() = default;
  Camera(const Camera&) = delete;
  Camera& operator=(const Camera&) = delete;
  virtual ~Camera() = default;

  /// The raw format in force. Throws DeviceError.
  virtual SensorFormat format() const = 0;
  virtual CameraCapabilities capabilities() const = 0;
  /// Throws DeviceError when the camera cannot be used now. A camera that was away and is back is
  /// taken into use again. Cheap while nothing is wrong; not during a bracket.
  virtual void probe() = 0;
  /// Queues the exposures of one bracket, to be delivered in this order; drops what was armed
  /// before. Only frames whose exposure began after this call, and not before `not_before_ns` on
  /// the clock of the frames' timestamps, count. Throws DeviceError, also for an exposure or gain
  /// that the camera cannot apply.
  virtual void arm(const std::vector<ExposureRequest>& bracket, std::int64_t not_before_ns) = 0;
  void arm(const std::vector<ExposureRequest>& bracket) {
    arm(bracket, std::numeric_limits<std::int64_t>::min());
  }
  /// The next frame of the armed bracket, with exposure and gain as applied; `light` is left at
  /// kNoLight for the caller, who knows what he switched. Throws DeviceError when `timeout` passes,
  /// when nothing is armed, or when the device is gone; then nothing is armed any more.
  virtual RawFrame next_frame(std::chrono::milliseconds timeout) = 0;
  /// Stops the capture; what is still armed is dropped. Safe to call at any time.
  virtual void stop() noexcept = 0;
};

}  // namespace brdfgate
