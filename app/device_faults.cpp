#include "app/device_faults.hpp"

#include "hal/camera.hpp"
#include "hal/lights.hpp"

namespace brdfgate {

DeviceFault fault_of(const DeviceError& error) {
  if (dynamic_cast<const LightsError*>(&error) != nullptr) return {ErrorCode::lights, "lights"};
  const auto* camera = dynamic_cast<const CameraError*>(&error);
  if (camera == nullptr) return {ErrorCode::camera, "device"};
  switch (camera->fault()) {
    case CameraFault::absent:
      return {ErrorCode::camera_absent, "camera absent"};
    case CameraFault::no_frame:
      return {ErrorCode::camera, "camera"};
    case CameraFault::not_applied:
      return {ErrorCode::camera_settings, "camera settings"};
    case CameraFault::out_of_memory:
      return {ErrorCode::camera_memory, "camera memory"};
    case CameraFault::implausible:
      return {ErrorCode::camera_frames, "camera frames"};
  }
  return {ErrorCode::camera, "camera"};
}

}  // namespace brdfgate
