#include "app/open_camera.hpp"

#include "app/fault_log.hpp"
#include "hal/libcamera/request_camera.hpp"
#ifdef BRDFGATE_LIBCAMERA
#include "hal/libcamera/libcamera_device.hpp"
#endif
#include "hal/v4l2/v4l2_camera.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

CameraDeviceSettings logged(const CameraConfig& config) {
  CameraDeviceSettings device = config.device;
  const auto log = std::make_shared<FaultLog>();
  device.note = [log](const std::string& text) { log->report("camera frames", text); };
  return device;
}

}  // namespace

std::unique_ptr<Camera> open_camera(const CameraConfig& config) {
  switch (config.backend) {
    case CameraBackend::v4l2:
      return make_v4l2_camera(logged(config), config.sensor);
    case CameraBackend::libcamera:
#ifdef BRDFGATE_LIBCAMERA
      return make_request_camera(logged(config), config.sensor,
                                 [device = config.device, sensor = config.sensor] {
                                   return open_libcamera(device, sensor);
                                 });
#else
      throw InputError("camera.backend", "libcamera: these programs were built without it", "v4l2");
#endif
    case CameraBackend::simulated:
      break;
  }
  throw InputError("camera.backend", "a simulated camera is part of its bench",
                   "v4l2 or libcamera");
}

}  // namespace brdfgate
