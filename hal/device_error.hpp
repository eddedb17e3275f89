// The one kind of failure of hal/.
#pragma once

#include <stdexcept>
#include <string>

namespace brdfgate {

/// A device failed; names the device and the call.
class DeviceError : public std::runtime_error {
 public:
  DeviceError(const std::string& device, const std::string& call, const std::string& what)
      : std::runtime_error(device + ": " + call + ": " + what) {}
};

}  // namespace brdfgate
