// The station file's real cameras.
#include "catch.hpp"
#include "config/station_config.hpp"
#include "support/input_error.hpp"
#include "support/mutate.hpp"
#include "support/shipped.hpp"
#include "support/station_text.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::place_of;
using brdfgate::test::replaced;
using brdfgate::test::TempDir;

namespace {

/// From the key `from` up to the key `to`, cut out.
std::string without(std::string text, const std::string& from, const std::string& to) {
  const auto begin = text.find(from);
  return text.erase(begin, text.find(to, begin) - begin);
}

std::string hardware(const std::string& backend, const std::string& device) {
  std::string text = brdfgate::test::kStationText;
  text = without(text, "simulator:\n", "inspection:\n");
  text = without(text, "  scenes:", "\nrig:");
  text += "lights: {chip: gpiochip0, lines: [LED1, LED2]}\n";
  return replaced(text, "  backend: simulated\n", "  backend: " + backend + "\n" + device);
}

const std::string kV4l2 = R"(  device:
    path: /dev/v4l/by-id/camera
    pixel_format: pRAA
    subdevice: /dev/v4l-subdev0
    control_delay_frames: 3
    gain: {law: decibel, db_per_step: 0.1}
    line_time_us: 14.8
    readout_ms: 16.1
    timestamp: start_of_readout
    buffers: 6
    frame_interval_ms: 33
)";

StationConfig read(const TempDir& dir, const std::string& text) {
  return read_station_config(dir.write("station.yaml", text));
}

}  // namespace

TEST_CASE("A V4L2 camera is read with its units turned to SI, and survives its own print") {
  const TempDir dir;
  const StationConfig config = read(dir, hardware("v4l2", kV4l2));
  CHECK(config.camera.backend == CameraBackend::v4l2);
  const CameraDeviceSettings& device = config.camera.device;
  CHECK(device.device == "/dev/v4l/by-id/camera");
  CHECK(device.subdevice == "/dev/v4l-subdev0");
  CHECK(device.pixel_format->name == "SRGGB10P");
  CHECK(device.control_delay_frames == 3);
  CHECK(device.line_time_s == Approx(14.8e-6));
  CHECK(device.readout_s == Approx(16.1e-3));
  CHECK(device.timestamp == TimestampPoint::start_of_readout);
  CHECK(device.buffers == 6);
  CHECK(device.frame_interval_s == Approx(0.033));
  REQUIRE(device.gain_law);
  CHECK(device.gain_law->gain_of(device.gain_law->code_of(2)) == Approx(2));
  CHECK(to_yaml(read(dir, to_yaml(config))) == to_yaml(config));
}

TEST_CASE("A libcamera camera needs only its format and line time") {
  const TempDir dir;
  const std::string text =
      hardware("libcamera", "  device: {pixel_format: SRGGB10_CSI2P, line_time_us: 14.8}\n");
  CHECK(contains(input_error([&] { read(dir, replaced(text, ", line_time_us: 14.8", "")); }),
                 "(camera.device.line_time_us): missing"));
  const StationConfig config = read(dir, text);
  CHECK(config.camera.backend == CameraBackend::libcamera);
  CHECK(config.camera.device.device.empty());
  CHECK(to_yaml(read(dir, to_yaml(config))) == to_yaml(config));
}

TEST_CASE("A fixed exposure is the bracket's, or accepted by name") {
  const TempDir dir;
  const std::string fixed =
      "  device: {path: /dev/video0, pixel_format: SRGGB10, fixed_exposure_ms: 5}\n";
  const std::string text = hardware("v4l2", fixed);
  const std::string error = input_error([&] { read(dir, text); });
  CHECK(
      contains(error, "(camera.bracket_ms): 0.03 ms, but the camera's exposure is fixed at 5 ms"));
  CHECK(contains(error, "accept_fixed_exposure: true"));
  const std::string one =
      replaced(replaced(text, "bracket_ms: [0.03, 0.4, 5, 60]", "bracket_ms: [5]"),
               "ambient_ms: [5, 60]", "ambient_ms: [5]");
  CHECK(read(dir, one).camera.device.fixed_exposure_s == Approx(0.005));
  const std::string accepted =
      replaced(text, "fixed_exposure_ms: 5}", "fixed_exposure_ms: 5, accept_fixed_exposure: true}");
  const StationConfig config = read(dir, accepted);
  CHECK(config.camera.device.accept_fixed_exposure);
  CHECK(to_yaml(read(dir, to_yaml(config))) == to_yaml(config));
}

TEST_CASE("Every rule of a real camera complains at its place with its path") {
  struct Bad {
    std::string from, to, value, path, what;
  };
  const auto bad = GENERATE(values<Bad>({
      {"pRAA", "pRXX", "pRXX", "camera.device.pixel_format", "one of"},
      {"pRAA", "SBGGR10P", "SBGGR10P", "camera.device.pixel_format",
       "SBGGR10P is bggr and camera.sensor.mosaic rggb"},
      {"pRAA", "SRGGB12P", "SRGGB12P", "camera.device.pixel_format",
       "holds 12 bits and camera.sensor.bits is 10"},
      {"path: /dev/v4l/by-id/camera", "path: ''", "''", "camera.device.path", "empty"},
      {"control_delay_frames: 3", "control_delay_frames: 17", "17",
       "camera.device.control_delay_frames", "0..16"},
      {"law: decibel", "law: exponential", "exponential", "camera.device.gain.law", "one of"},
      {"db_per_step: 0.1", "db_per_step: 0", "0}", "camera.device.gain.db_per_step", "above 0"},
      {"db_per_step: 0.1", "code_at_1: 16", "{law", "camera.device.gain.db_per_step", "missing"},
      {"line_time_us: 14.8", "line_time_us: -1", "-1", "camera.device.line_time_us", "0..1000"},
      {"timestamp: start_of_readout", "timestamp: sometime", "sometime", "camera.device.timestamp",
       "one of"},
      {"buffers: 6", "buffers: 1", "1\n", "camera.device.buffers", "2..32"},
      {"buffers: 6", "buffer: 6", "buffer: 6", "camera.device.buffer", "unknown key"},
      {"  gain: 1\n", "  gain: 1\n  seed: 1\n", "seed: 1", "camera.seed", "unknown key"},
      {"inspection:\n", "simulator: {}\ninspection:\n", "{}", "simulator", "not simulated"},
  }));
  const TempDir dir;
  const std::string text = replaced(hardware("v4l2", kV4l2), bad.from, bad.to);
  CAPTURE(bad.to);
  const std::string error = input_error([&] { read(dir, text); });
  CHECK(contains(error, "(" + bad.path + ")"));
  CHECK(contains(error, bad.what));
}

TEST_CASE("How long a setting takes to apply has no default where exposures change") {
  const TempDir dir;
  const std::string error = input_error(
      [&] { read(dir, replaced(hardware("v4l2", kV4l2), "    control_delay_frames: 3\n", "")); });
  CHECK(contains(error, "(camera.device.control_delay_frames): missing"));
}

TEST_CASE("The shipped examples of real stations load and survive their own print") {
  const auto example = GENERATE(as<std::string>{}, "station-v4l2.yaml", "station-pi.yaml");
  CAPTURE(example);
  const StationConfig config = read_station_config(brdfgate::test::shipped_file(example));
  CHECK(config.camera.backend != CameraBackend::simulated);
  const TempDir dir;
  CHECK(to_yaml(read(dir, to_yaml(config))) == to_yaml(config));
}
