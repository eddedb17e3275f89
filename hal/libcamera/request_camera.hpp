// A camera behind libcamera. The bracket is queued ahead as requests with their own exposure, gain
// and frame duration. A sensor applies them some frames later, so a request's buffer says nothing
// about its settings: a frame counts for the exposure and gain that its metadata report, within one
// line of what was asked. What comes out of schedule is taken where it fits, what is missing is
// asked for again.
#pragma once

#include <memory>

#include "hal/camera.hpp"
#include "hal/camera_settings.hpp"
#include "hal/libcamera/request_device.hpp"

namespace brdfgate {

/// `open` is called by the first probe() or arm(), and again after a fault. Precondition: the
/// settings have a line time.
std::unique_ptr<Camera> make_request_camera(const CameraDeviceSettings& settings,
                                            const SensorFormat& sensor, OpenRequestDevice open);

}  // namespace brdfgate
