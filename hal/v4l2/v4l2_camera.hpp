// A camera behind V4L2: UVC cameras, and sensors on CSI-2 whose driver gives raw frames.
//
// The stream runs on between brackets (starting a UVC camera takes longer than a bracket), so
// frames of before are always there and never counted. A V4L2 driver does not say which exposure a
// frame had: each exposure of a bracket is set, and the first frame taken for which the new setting
// is certain (ControlDelay). An exposure with the settings of the one before costs one frame,
// another one control_delay_frames + 1 to 2.
#pragma once

#include <memory>

#include "hal/camera.hpp"
#include "hal/camera_settings.hpp"
#include "hal/v4l2/v4l2_system.hpp"

namespace brdfgate {

/// `sensor` as configured; the device must give exactly this. Opens nothing: a camera that is away
/// at the start is an error of probe() and arm(), and is taken into use when it is there. Any fault
/// closes the device; the next probe() or arm() opens it anew.
std::unique_ptr<Camera> make_v4l2_camera(const CameraDeviceSettings& settings,
                                         const SensorFormat& sensor,
                                         V4l2System& system = linux_v4l2());

}  // namespace brdfgate
