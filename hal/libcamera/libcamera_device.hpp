// libcamera itself behind the seam; only in programs that were built with it.
#pragma once

#include "hal/camera_settings.hpp"
#include "hal/libcamera/request_device.hpp"
#include "model/frame.hpp"

namespace brdfgate {

/// Opens the camera `settings.device` (its id; empty: the only one) with one uncompressed raw
/// stream of exactly the sensor's format. Throws CameraError.
std::unique_ptr<RequestDevice> open_libcamera(const CameraDeviceSettings& settings,
                                              const SensorFormat& sensor);

}  // namespace brdfgate
