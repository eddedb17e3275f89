// The station file's section camera.device: a real camera behind V4L2 or libcamera.
#pragma once

#include "config/station_config.hpp"
#include "config/yaml_reader.hpp"

namespace brdfgate {

/// In the order of CameraBackend.
const std::vector<std::string>& camera_backend_names();

/// Reads `device` of a camera section into `camera`, whose backend, sensor and brackets are there
/// already, and checks them against each other. Ranges: line_time_us 0..1000 (libcamera: needed,
/// over 0), readout_ms 0..1000, control_delay_frames 0..16, frame_interval_ms 0..60000,
/// buffers 2..32, shift_right 0..8, fixed_exposure_ms and the gain's scale over 0. The pixel
/// format's mosaic and bits are the sensor's.
void read_camera_device(const YamlNode& camera_node, CameraConfig& camera);

/// The way back.
void put_camera_device(YAML::Emitter& out, const CameraConfig& camera);

}  // namespace brdfgate
