// What the gate says of itself to function code 43/14.
#pragma once

#include "hal/modbus/pdu.hpp"

namespace brdfgate {

inline DeviceIdentification device_identification() {
  DeviceIdentification device;
  device.vendor_name = "brdfgate";
  device.product_code = "brdfgate";
  device.major_minor_revision = BRDFGATE_VERSION;
  device.product_name = "brdfgate inline quality gate";
  device.user_application_name = "brdfgated";
  return device;
}

}  // namespace brdfgate
