// The capture sequence with cameras that fail, and the codes of their faults.
#include "app/device_faults.hpp"
#include "app/station.hpp"
#include "catch.hpp"
#include "hal/v4l2/v4l2_camera.hpp"
#include "support/fake_v4l2.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

/// Two lights that the made-up sensor sees, on its clock.
class FakeLights final : public Lights {
 public:
  FakeLights(FakeV4l2& driver, std::int64_t settle_ns) : driver_(driver), settle_ns_(settle_ns) {
    change(kNoLight);
  }
  int count() const override { return 2; }
  void on(LightIndex light) override { change(light); }
  void all_off() noexcept override { change(kNoLight); }
  void verify() override {}
  std::int64_t switched_at_ns() const override { return switched_ns_; }
  std::int64_t settled_at_ns() const override { return switched_ns_ + settle_ns_; }
  LightIndex burning() const { return burning_; }

 private:
  void change(LightIndex light) {
    if (light == burning_) return;
    burning_ = light;
    switched_ns_ = driver_.time_ns();
    // Light 2 is half as bright as light 1.
    driver_.light(light == kNoLight ? 0 : 1.0 / light);
  }

  FakeV4l2& driver_;
  std::int64_t settle_ns_;
  std::int64_t switched_ns_ = 0;
  LightIndex burning_ = -1;
};

/// The station's capture on a V4L2 camera whose driver is made up.
class FakeStation final : public Station {
 public:
  explicit FakeStation(const FakeSensor& sensor = {}, std::int64_t settle_ns = 0)
      : Station(LightsMode::steady), driver(sensor), lights_(driver, settle_ns) {
    CameraDeviceSettings settings;
    settings.device = "/dev/video0";
    settings.pixel_format = sensor.format;
    settings.control_delay_frames = 2;
    settings.readout_s = sensor.readout_s;
    const SensorFormat format{.width = sensor.width,
                              .height = sensor.height,
                              .bits = 10,
                              .black_level_dn = static_cast<double>(sensor.black),
                              .full_well_dn = 1023};
    camera_ = make_v4l2_camera(settings, format, driver);
  }
  Camera& camera() override { return *camera_; }
  Lights& lights() override { return lights_; }
  bool simulated() const override { return false; }
  void check() override { camera_->probe(); }
  void next_part(std::uint32_t) override { check(); }
  LightIndex burning() const { return lights_.burning(); }

  FakeV4l2 driver;

 private:
  FakeLights lights_;
  std::unique_ptr<Camera> camera_;
};

/// Sixteen by twelve pixels are few for a comparison of pixels: a larger sensor.
FakeSensor sensor() {
  FakeSensor s;
  s.width = 64;
  s.height = 48;
  s.counts_per_s = 4e4;
  return s;
}

CameraConfig brackets() {
  CameraConfig config;
  config.bracket_ms = {1, 4, 16};
  config.ambient_ms = {16};
  config.frame_timeout_ms = 1000;
  return config;
}

/// The code of the fault that taking a part ends with; the lights must be off then.
ErrorCode code_of_taking(FakeStation& station) {
  ErrorCode code = ErrorCode::none;
  try {
    station.next_part(1);
    capture_part(station, brackets());
  } catch (const DeviceError& error) {
    code = fault_of(error).code;
  }
  CHECK(station.burning() == kNoLight);
  return code;
}

}  // namespace

TEST_CASE("Every frame of a part shows its own light alone, whenever the lights are switched") {
  for (int phase = 0; phase < 12; ++phase) {
    CAPTURE(phase);
    FakeStation station(sensor(), 3'000'000);
    station.camera().arm({{.exposure_s = 0.016}});
    station.driver.pass_time(1e-3 * phase);
    const Capture capture = capture_part(station, brackets());
    REQUIRE(capture.frames.size() == 7);
    for (const RawFrame& frame : capture.frames) {
      CAPTURE(frame.light, frame.exposure_s);
      const double level = frame.light == kNoLight ? 0 : 1.0 / frame.light;
      CHECK(cv::mean(frame.counts)[0] - 60 == Approx(4e4 * frame.exposure_s * level).margin(4));
    }
  }
}

TEST_CASE("A camera's fault while a part is taken has its code, darkness, and an end") {
  struct Case {
    const char* name;
    std::function<void(FakeStation&)> breaks;
    std::function<void(FakeStation&)> mends;
    ErrorCode code;
  };
  const auto at_frame = [](FakeFault::Kind kind, bool once) {
    return [kind, once](FakeStation& s) {
      s.driver.fault = [kind, once](std::uint32_t frame) {
        return FakeFault{(once ? frame == 16 : frame >= 16) ? kind : FakeFault::none};
      };
    };
  };
  const auto no_fault = [](FakeStation& s) {
    s.driver.fault = [](std::uint32_t) { return FakeFault{}; };
    s.driver.at_frame = [](std::uint32_t) {};
    s.driver.present = true;
    s.driver.out_of_memory = false;
    s.driver.exposure_sticks = false;
  };
  const std::vector<Case> cases{
      {"absent", [](FakeStation& s) { s.driver.present = false; }, no_fault,
       ErrorCode::camera_absent},
      {"unplugged in mid-bracket",
       [](FakeStation& s) {
         s.driver.at_frame = [&s](std::uint32_t frame) {
           if (frame == 16) s.driver.unplug();
         };
       },
       no_fault, ErrorCode::camera_absent},
      {"no memory", [](FakeStation& s) { s.driver.out_of_memory = true; }, no_fault,
       ErrorCode::camera_memory},
      {"lost for good", at_frame(FakeFault::dropped, false), no_fault, ErrorCode::camera},
      {"truncated for good", at_frame(FakeFault::truncated, false), no_fault, ErrorCode::camera},
      {"frozen for good", at_frame(FakeFault::repeated, false), no_fault, ErrorCode::camera},
      {"exposure never applied", [](FakeStation& s) { s.driver.exposure_sticks = true; }, no_fault,
       ErrorCode::camera_frames},
      {"one frame lost", at_frame(FakeFault::dropped, true), no_fault, ErrorCode::none},
      {"one frame truncated", at_frame(FakeFault::truncated, true), no_fault, ErrorCode::none},
  };
  for (const Case& c : cases) {
    CAPTURE(c.name);
    FakeStation station(sensor());
    c.breaks(station);
    CHECK(static_cast<int>(code_of_taking(station)) == static_cast<int>(c.code));
    c.mends(station);
    CHECK(static_cast<int>(code_of_taking(station)) == 0);
  }
}

TEST_CASE(
    "A picture that goes black within a bracket is found; a whole one is the lights' matter") {
  int found = 0;
  for (std::uint32_t from = 4; from < 36; ++from) {
    FakeStation station(sensor());
    station.driver.fault = [from](std::uint32_t frame) {
      return FakeFault{frame >= from ? FakeFault::black : FakeFault::none};
    };
    const ErrorCode code = code_of_taking(station);
    CHECK((code == ErrorCode::none || code == ErrorCode::camera_frames));
    found += code == ErrorCode::camera_frames ? 1 : 0;
  }
  CHECK(found >= 8);
}

TEST_CASE("Every fault of a camera, and of the lights, has a code of its own") {
  const auto code = [](CameraFault fault) {
    return fault_of(CameraError(fault, "camera", "call", "what")).code;
  };
  CHECK(code(CameraFault::no_frame) == ErrorCode::camera);
  CHECK(code(CameraFault::absent) == ErrorCode::camera_absent);
  CHECK(code(CameraFault::not_applied) == ErrorCode::camera_settings);
  CHECK(code(CameraFault::out_of_memory) == ErrorCode::camera_memory);
  CHECK(code(CameraFault::implausible) == ErrorCode::camera_frames);
  CHECK(fault_of(LightsError("lights", "on", "what")).code == ErrorCode::lights);
  CHECK(fault_of(DeviceError("device", "call", "what")).code == ErrorCode::camera);
}
