// The camera that a station file names.
#pragma once

#include <memory>

#include "config/station_config.hpp"
#include "hal/camera.hpp"

namespace brdfgate {

/// A real one: backend v4l2 or libcamera. Opens no device (see make_v4l2_camera). Drops and waits
/// are logged once per class with their count. Throws InputError for a backend that these programs
/// were built without, and for a simulated one, which belongs to its bench.
std::unique_ptr<Camera> open_camera(const CameraConfig& config);

}  // namespace brdfgate
