#include "config/camera_yaml.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "config/sensor_yaml.hpp"

namespace brdfgate {
namespace {

/// Nobody waits longer for a setting; libcamera's own tables end at 3, UVC cameras at about 8.
constexpr int kMostDelayFrames = 16;

const std::vector<std::string> kTimestampPoints{"driver", "start_of_exposure", "start_of_readout",
                                                "end_of_frame"};
const std::vector<std::string> kGainLaws{"linear", "decibel", "reciprocal"};
const std::array<const char*, 3> kGainScales{"code_at_1", "db_per_step", "full_code"};

std::vector<std::string> format_names() {
  std::vector<std::string> names;
  for (const RawFormat& format : raw_formats())
    names.emplace_back(format.name);
  return names;
}

const RawFormat* read_pixel_format(const YamlNode& node) {
  if (const RawFormat* format = find_raw_format(node.text("pixel_format"))) return format;
  return &raw_formats()[node.choice("pixel_format", format_names())];  // the error lists them
}

void check_pixel_format(const YamlNode& node, const CameraConfig& camera) {
  const RawFormat& format = *camera.device.pixel_format;
  if (format.mosaic != camera.sensor.mosaic) {
    node.fail_at("pixel_format",
                 std::string(format.name) + " is " + mosaic_name(format.mosaic) +
                     " and camera.sensor.mosaic " + mosaic_name(camera.sensor.mosaic),
                 "the same mosaic");
  }
  const int bits = format.bits - camera.device.shift_right;
  if (bits != camera.sensor.bits) {
    node.fail_at("pixel_format",
                 std::string(format.name) + " holds " + std::to_string(bits) +
                     " bits and camera.sensor.bits is " + std::to_string(camera.sensor.bits),
                 "the same bits (shift_right drops those below a count)");
  }
}

GainLaw read_gain_law(const YamlNode& node) {
  GainLaw law;
  law.kind = static_cast<GainLaw::Kind>(node.choice("law", kGainLaws));
  law.scale = node.number(kGainScales.at(static_cast<std::size_t>(law.kind)), {0, 1e6, true});
  node.finish();
  return law;
}

/// A camera whose exposure is fixed takes no other, unless told to.
void check_fixed_exposure(const YamlNode& camera_node, const CameraConfig& camera) {
  const CameraDeviceSettings& device = camera.device;
  if (!device.fixed_exposure_s || device.accept_fixed_exposure) return;
  const double fixed_ms = 1e3 * *device.fixed_exposure_s;
  const auto check = [&](const char* key, const std::vector<double>& exposures_ms) {
    for (const double ms : exposures_ms) {
      if (std::abs(ms - fixed_ms) <= 1e-9 * fixed_ms) continue;
      camera_node.fail_at(key,
                          number_text(ms) + " ms, but the camera's exposure is fixed at " +
                              number_text(fixed_ms) + " ms",
                          "[" + number_text(fixed_ms) + "], or device.accept_fixed_exposure: true");
    }
  };
  check("bracket_ms", camera.bracket_ms);
  check("ambient_ms", camera.ambient_ms);
}

void read_v4l2(const YamlNode& node, CameraDeviceSettings& device) {
  device.device = node.text("path");
  if (device.device.empty()) node.fail_at("path", "empty", "a video node: /dev/video0");
  device.subdevice = node.text_or("subdevice", "");
  // Nothing is certain of a camera before this was measured: no default where it matters.
  if (device.fixed_exposure_s) {
    device.control_delay_frames = node.integer_or("control_delay_frames", 0, 0, kMostDelayFrames);
  } else {
    device.control_delay_frames = node.integer("control_delay_frames", 0, kMostDelayFrames);
  }
  if (node.has("gain")) device.gain_law = read_gain_law(node.at("gain"));
  device.line_time_s = node.number_or("line_time_us", 0, {0, 1000}) / 1e6;
}

void read_libcamera(const YamlNode& node, CameraDeviceSettings& device) {
  device.device = node.text_or("id", "");
  // An exposure counts when it is right within one line, which libcamera does not tell.
  device.line_time_s = node.number("line_time_us", {0, 1000, true}) / 1e6;
}

}  // namespace

const std::vector<std::string>& camera_backend_names() {
  static const std::vector<std::string> names{"simulated", "v4l2", "libcamera"};
  return names;
}

void read_camera_device(const YamlNode& camera_node, CameraConfig& camera) {
  const YamlNode node = camera_node.at("device");
  CameraDeviceSettings& device = camera.device;
  device.pixel_format = read_pixel_format(node);
  device.shift_right = node.integer_or("shift_right", 0, 0, 8);
  check_pixel_format(node, camera);
  if (node.has("fixed_exposure_ms")) {
    device.fixed_exposure_s = node.number("fixed_exposure_ms", {0, 60000, true}) / 1e3;
    device.accept_fixed_exposure = node.boolean_or("accept_fixed_exposure", false);
  }
  if (camera.backend == CameraBackend::v4l2) {
    read_v4l2(node, device);
  } else {
    read_libcamera(node, device);
  }
  device.frame_interval_s = node.number_or("frame_interval_ms", 0, {0, 60000}) / 1e3;
  device.readout_s = node.number_or("readout_ms", 0, {0, 1000}) / 1e3;
  if (node.has("timestamp")) {
    device.timestamp = static_cast<TimestampPoint>(node.choice("timestamp", kTimestampPoints));
  }
  device.buffers = node.integer_or("buffers", device.buffers, 2, 32);
  node.finish();
  check_fixed_exposure(camera_node, camera);
}

namespace {

/// Fifteen digits: a conversion's rounding does not show.
std::string rounded(double value) {
  std::array<char, 40> text{};
  const auto end =
      std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general, 15)
          .ptr;
  return {text.data(), end};
}

void put(YAML::Emitter& out, const char* key, const std::string& value) {
  out << YAML::Key << key << YAML::Value << value;
}

void put_v4l2(YAML::Emitter& out, const CameraDeviceSettings& device) {
  put(out, "path", device.device);
  if (!device.subdevice.empty()) put(out, "subdevice", device.subdevice);
  put(out, "control_delay_frames", std::to_string(device.control_delay_frames));
  if (device.gain_law) {
    const auto kind = static_cast<std::size_t>(device.gain_law->kind);
    out << YAML::Key << "gain" << YAML::Value << YAML::BeginMap;
    put(out, "law", kGainLaws.at(kind));
    put(out, kGainScales.at(kind), number_text(device.gain_law->scale));
    out << YAML::EndMap;
  }
}

}  // namespace

void put_camera_device(YAML::Emitter& out, const CameraConfig& camera) {
  const CameraDeviceSettings& device = camera.device;
  out << YAML::Key << "device" << YAML::Value << YAML::BeginMap;
  put(out, "pixel_format", std::string(device.pixel_format->name));
  put(out, "shift_right", std::to_string(device.shift_right));
  if (camera.backend == CameraBackend::v4l2) {
    put_v4l2(out, device);
  } else if (!device.device.empty()) {
    put(out, "id", device.device);
  }
  if (device.fixed_exposure_s) {
    put(out, "fixed_exposure_ms", rounded(*device.fixed_exposure_s * 1e3));
    put(out, "accept_fixed_exposure", device.accept_fixed_exposure ? "true" : "false");
  }
  put(out, "frame_interval_ms", rounded(device.frame_interval_s * 1e3));
  put(out, "line_time_us", rounded(device.line_time_s * 1e6));
  put(out, "readout_ms", rounded(device.readout_s * 1e3));
  put(out, "timestamp", kTimestampPoints.at(static_cast<std::size_t>(device.timestamp)));
  put(out, "buffers", std::to_string(device.buffers));
  out << YAML::EndMap;
}

}  // namespace brdfgate
