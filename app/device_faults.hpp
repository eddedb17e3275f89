// What a failed device is to the PLC and to the log.
#pragma once

#include <string>

#include "app/plc/plc_bits.hpp"
#include "hal/device_error.hpp"

namespace brdfgate {

struct DeviceFault {
  ErrorCode code = ErrorCode::camera;
  std::string fault_class;  ///< for the log
};

DeviceFault fault_of(const DeviceError& error);

}  // namespace brdfgate
