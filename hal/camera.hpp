// A camera that takes brackets.
#pragma once

#include <chrono>
#include <stdexcept>
#include <string>
#include <vector>

#include "model/frame.hpp"

namespace brdfgate {

/// A device failed; names the device and the call. The one exception type of hal/.
class DeviceError : public std::runtime_error {
 public:
  DeviceError(const std::string& device, const std::string& call, const std::string& what)
      : std::runtime_error(device + ": " + call + ": " + what) {}
};

/// One exposure of a bracket, as asked for.
struct ExposureRequest {
  double exposure_s = 0;
  double gain = 1;
};

class Camera {
 public:
  Camera() = default;
  Camera(const Camera&) = delete;
  Camera& operator=(const Camera&) = delete;
  virtual ~Camera() = default;

  /// The raw format in force. Throws DeviceError.
  virtual SensorFormat format() const = 0;
  /// Queues the exposures of one bracket, to be taken in this order; drops what was armed before.
  virtual void arm(const std::vector<ExposureRequest>& bracket) = 0;
  /// The next frame of the armed bracket, with exposure and gain as applied; `light` is left at
  /// kNoLight for the caller, who knows what he switched. Throws DeviceError when `timeout` passes,
  /// when nothing is armed, or when the device is gone.
  virtual RawFrame next_frame(std::chrono::milliseconds timeout) = 0;
  /// Stops the capture; what is still armed is dropped. Safe to call at any time.
  virtual void stop() noexcept = 0;
};

}  // namespace brdfgate
