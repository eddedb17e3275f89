#include <cmath>

#include "camera_contract.hpp"
#include "catch.hpp"
#include "hal/v4l2/v4l2_camera.hpp"
#include "support/fake_v4l2.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using namespace std::chrono_literals;

namespace {

constexpr auto kPatience = 1000ms;

CameraDeviceSettings settings_of(const FakeSensor& sensor) {
  CameraDeviceSettings settings;
  settings.device = "/dev/video0";
  settings.pixel_format = sensor.format;
  settings.control_delay_frames = sensor.latency_frames;
  settings.readout_s = sensor.readout_s;
  settings.gain_law = GainLaw{GainLaw::Kind::linear, 16};
  return settings;
}

SensorFormat format_of(const FakeSensor& sensor) {
  return {.width = sensor.width,
          .height = sensor.height,
          .bits = sensor.format->bits,
          .mosaic = sensor.format->mosaic,
          .black_level_dn = static_cast<double>(sensor.black),
          .full_well_dn = std::ldexp(1.0, sensor.format->bits) - 1};
}

/// A driver, and a camera on it.
struct Bench {
  explicit Bench(const FakeSensor& s = {}) : Bench(s, settings_of(s)) {}
  Bench(const FakeSensor& s, CameraDeviceSettings settings) : sensor(s), driver(s) {
    settings.note = [this](const std::string& text) { notes.push_back(text); };
    camera = make_v4l2_camera(settings, format_of(s), driver);
  }

  RawFrame take(double exposure_s, double gain = 1) {
    camera->arm({{exposure_s, gain}});
    return camera->next_frame(kPatience);
  }
  /// What the frame's pixels say of its exposure.
  double seen_exposure_s(const RawFrame& frame) const {
    return (cv::mean(frame.counts)[0] - sensor.black) / sensor.counts_per_s / frame.gain;
  }
  int held() const { return driver.open_descriptors + driver.mappings + driver.allocations; }

  FakeSensor sensor;
  FakeV4l2 driver;
  std::vector<std::string> notes;
  std::unique_ptr<Camera> camera;
};

CameraUnderTest contract_of(const std::shared_ptr<Bench>& bench) {
  CameraUnderTest t{bench, bench->camera.get()};
  t.unplug = [b = bench.get()] { b->driver.unplug(); };
  t.replug = [b = bench.get()] { b->driver.present = true; };
  t.held = [b = bench.get()] { return b->held(); };
  return t;
}

/// The error's text and kind.
template <typename Call>
std::pair<CameraFault, std::string> camera_error(const Call& call) {
  try {
    call();
  } catch (const CameraError& error) {
    return {error.fault(), error.what()};
  }
  return {CameraFault::implausible, "nothing was thrown"};
}

/// The frame numbers at which a fault strikes.
std::function<FakeFault(std::uint32_t)> faults(std::map<std::uint32_t, FakeFault::Kind> at) {
  return [at = std::move(at)](std::uint32_t frame) {
    const auto it = at.find(frame);
    return FakeFault{it == at.end() ? FakeFault::none : it->second};
  };
}

}  // namespace

TEST_CASE("The V4L2 camera keeps the camera's contract") {
  SECTION("with a UVC camera's controls") {
    check_camera_contract([] { return contract_of(std::make_shared<Bench>()); });
  }
  SECTION("with a fixed exposure") {
    check_camera_contract([] {
      const FakeSensor sensor;
      CameraDeviceSettings settings = settings_of(sensor);
      settings.fixed_exposure_s = 0.005;
      settings.gain_law.reset();
      const auto bench = std::make_shared<Bench>(sensor, settings);
      bench->driver.video_controls.clear();
      CameraUnderTest t = contract_of(bench);
      t.exposures_s = {0.005, 0.005, 0.005};
      return t;
    });
  }
}

TEST_CASE("A frame has the exposure it reports, however late the sensor applies it") {
  FakeSensor sensor;
  sensor.latency_frames = GENERATE(0, 1, 2, 5, 8);
  sensor.stamp_flags = GENERATE(V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_EOF,
                                V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE);
  CAPTURE(sensor.latency_frames, sensor.stamp_flags);
  Bench bench(sensor);
  for (int turn = 0; turn < 4; ++turn) {
    bench.camera->arm({{0.0004, 1}, {0.005, 1}, {0.05, 1}, {0.005, 4}});
    for (const double asked : {0.0004, 0.005, 0.05, 0.005}) {
      const RawFrame frame = bench.camera->next_frame(2000ms);
      CHECK(frame.exposure_s == Approx(asked));
      CHECK(bench.seen_exposure_s(frame) == Approx(asked).margin(1e-4));
    }
  }
}

TEST_CASE("A delay figure that is too small mixes exposures up: the check can tell") {
  FakeSensor sensor;
  CameraDeviceSettings settings = settings_of(sensor);
  settings.control_delay_frames = 1;  // the sensor's is 2
  Bench bench(sensor, settings);
  bench.take(0.0004);
  CHECK(bench.seen_exposure_s(bench.take(0.003)) == Approx(0.0004).margin(1e-4));
}

TEST_CASE("The timestamp is the start of exposure, whatever instant the driver marks") {
  struct Case {
    TimestampPoint told;
    std::uint32_t flags;
    double back_of_end_s;  ///< of 5 ms exposure and 4 ms readout
  };
  const std::uint32_t eof = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_EOF;
  const std::uint32_t soe = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  const auto c = GENERATE_COPY(values<Case>({{TimestampPoint::driver, eof, 0.009},
                                             {TimestampPoint::driver, soe, 0},
                                             {TimestampPoint::start_of_exposure, eof, 0},
                                             {TimestampPoint::start_of_readout, eof, 0.005},
                                             {TimestampPoint::end_of_frame, soe, 0.009}}));
  FakeSensor sensor;
  sensor.stamp_flags = c.flags;
  CameraDeviceSettings settings = settings_of(sensor);
  settings.timestamp = c.told;
  Bench bench(sensor, settings);
  const RawFrame frame = bench.take(0.005);
  // The frame just taken is the last one that the sensor finished.
  const bool stamped_start = (c.flags & V4L2_BUF_FLAG_TSTAMP_SRC_SOE) != 0;
  const double stamp_s =
      1e-9 * static_cast<double>(bench.driver.time_ns()) - (stamped_start ? 0.009 : 0);
  CHECK(1e-9 * static_cast<double>(frame.timestamp_ns) ==
        Approx(stamp_s - c.back_of_end_s).margin(1e-4).epsilon(0));
}

TEST_CASE("Timestamps of another clock are refused by name") {
  FakeSensor sensor;
  SECTION("said so by the driver") {
    sensor.stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN;
  }
  SECTION("a wall clock under a monotonic flag") {
    sensor.stamp_offset_ns = 1'700'000'000'000'000'000;
  }
  SECTION("a clock that was put back by a year") {
    sensor.stamp_offset_ns = -31'557'600'000'000'000;
  }
  Bench bench(sensor);
  const auto [fault, text] = camera_error([&] { bench.take(0.005); });
  CHECK(fault == CameraFault::no_frame);
  CHECK(contains(text, "clock"));
}

TEST_CASE("Every raw format arrives as the sensor's counts, with and without row padding") {
  for (const RawFormat& format : raw_formats()) {
    for (const std::size_t padding : {0U, 7U}) {
      FakeSensor sensor;
      sensor.format = &format;
      sensor.padding = padding;
      sensor.noise = 0;
      CAPTURE(format.name, padding);
      Bench bench(sensor);
      const RawFrame frame = bench.take(0.005);
      CHECK(cv::countNonZero(frame.counts != 110) == 0);
    }
  }
}

TEST_CASE("A sensor on its own node counts exposure in lines") {
  FakeSensor sensor;
  CameraDeviceSettings settings = settings_of(sensor);
  settings.subdevice = "/dev/v4l-subdev0";
  Bench bench(sensor, settings);
  bench.driver.video_controls.clear();
  bench.driver.sensor_controls = {{V4L2_CID_EXPOSURE, {1, 1000, 1, 100}},
                                  {V4L2_CID_VBLANK, {20, 4000, 1, 1004}},
                                  {V4L2_CID_ANALOGUE_GAIN, {16, 256, 1, 16}},
                                  {V4L2_CID_HBLANK, {184, 184, 1, 184}}};
  bench.driver.pixel_rate = 200 * 50'000;  // 200 pixels a line of 20 us
  bench.driver.exposure_unit_s = 20e-6;

  SECTION("the line time is read from pixel rate and blanking") {
    const RawFrame frame = bench.take(0.005011);
    CHECK(frame.exposure_s == Approx(0.00502));
    CHECK(bench.seen_exposure_s(frame) == Approx(frame.exposure_s).margin(1e-4));
  }
  SECTION("blanking grows with the exposure and shrinks again") {
    bench.driver.sensor_controls[V4L2_CID_EXPOSURE].most = 4000;
    bench.driver.sensor_controls[V4L2_CID_VBLANK].value = 3996;  // a margin of 8 lines
    CHECK(bench.take(0.04).exposure_s == Approx(0.04));
    CHECK(bench.driver.sensor_controls[V4L2_CID_VBLANK].value == 2000 + 8 - 12);
    CHECK(bench.take(0.0002).exposure_s == Approx(0.0002));
    CHECK(bench.driver.sensor_controls[V4L2_CID_VBLANK].value == 20);
  }
  SECTION("without any line time the control is refused by name") {
    bench.driver.pixel_rate = 0;
    const auto [fault, text] = camera_error([&] { bench.take(0.005); });
    CHECK(fault == CameraFault::not_applied);
    CHECK(contains(text, "camera.device.line_time_us"));
  }
}

TEST_CASE("What cannot be applied is refused by name") {
  struct Case {
    ExposureRequest asked;
    std::string text;
  };
  const auto c = GENERATE(values<Case>({
      {{0.00003, 1}, "0.03 ms cannot be applied; the driver has 0.1 ms to 60 ms"},
      {{0.07, 1}, "70 ms cannot be applied"},
      {{0.005, 0.5}, "a gain of 0.5 cannot be applied; the driver has 1 to 16"},
      {{0.005, 20}, "a gain of 20 cannot be applied"},
  }));
  Bench bench;
  const auto [fault, text] = camera_error([&] { bench.camera->arm({c.asked}); });
  CHECK(fault == CameraFault::not_applied);
  CHECK(contains(text, c.text));
  CHECK(bench.take(0.005).exposure_s == Approx(0.005));
}

TEST_CASE("Without exposure control the exposure is fixed, or the file says so") {
  const FakeSensor sensor;
  CameraDeviceSettings settings = settings_of(sensor);
  settings.gain_law.reset();
  SECTION("a missing control is an error that says what helps") {
    Bench bench(sensor, settings);
    bench.driver.video_controls.clear();
    const auto [fault, text] = camera_error([&] { bench.take(0.005); });
    CHECK(fault == CameraFault::not_applied);
    CHECK(contains(text, "camera.device.fixed_exposure_ms"));
  }
  settings.fixed_exposure_s = 0.005;
  SECTION("another exposure is an error") {
    Bench bench(sensor, settings);
    bench.driver.video_controls.clear();
    CHECK(contains(camera_error([&] { bench.take(0.02); }).second, "fixed at 5 ms"));
  }
  SECTION("unless the file accepts it: then the frame reports what it had") {
    settings.accept_fixed_exposure = true;
    Bench bench(sensor, settings);
    bench.driver.video_controls.clear();
    bench.camera->arm({{0.001, 1}, {0.02, 1}});
    for (int i = 0; i < 2; ++i)
      CHECK(bench.camera->next_frame(kPatience).exposure_s == Approx(0.005));
  }
}

TEST_CASE("A control that the driver does not keep is an error") {
  Bench bench;
  bench.driver.video_controls[V4L2_CID_EXPOSURE_ABSOLUTE].step = 1;
  bench.take(0.005);
  bench.driver.video_controls[V4L2_CID_EXPOSURE_ABSOLUTE].most = 80;  // behind the camera's back
  const auto [fault, text] = camera_error([&] { bench.take(0.05); });
  CHECK(fault == CameraFault::not_applied);
  CHECK(contains(text, "was set to 500 and reads 80"));
}

TEST_CASE("Automatic exposure is switched off") {
  Bench bench;
  bench.take(0.005);
  CHECK(bench.driver.video_controls[V4L2_CID_EXPOSURE_AUTO].value == V4L2_EXPOSURE_MANUAL);
}

TEST_CASE("Frames that are lost, truncated, damaged or come twice are taken again, and told of") {
  const auto kind =
      GENERATE(FakeFault::dropped, FakeFault::truncated, FakeFault::damaged, FakeFault::repeated);
  CAPTURE(kind);
  Bench bench;
  bench.driver.fault = faults({{3, kind}, {6, kind}, {7, kind}, {9, kind}});
  bench.camera->arm({{0.001, 1}, {0.005, 1}, {0.02, 1}});
  for (const double asked : {0.001, 0.005, 0.02}) {
    const RawFrame frame = bench.camera->next_frame(kPatience);
    CHECK(bench.seen_exposure_s(frame) == Approx(asked).margin(2e-4));
  }
  REQUIRE(bench.notes.size() == 1);
  CHECK(contains(bench.notes.front(), "taken again"));
}

TEST_CASE("A stream of nothing but bad frames ends in time and says what came") {
  struct Case {
    FakeFault::Kind kind;
    std::string text;
  };
  const auto c = GENERATE(values<Case>({{FakeFault::dropped, "no frame came"},
                                        {FakeFault::truncated, "truncated or damaged"},
                                        {FakeFault::damaged, "truncated or damaged"},
                                        {FakeFault::repeated, "that came twice"}}));
  Bench bench;
  bench.take(0.005);
  bench.driver.fault = [&](std::uint32_t) { return FakeFault{c.kind}; };
  const std::int64_t before = bench.driver.time_ns();
  const auto [fault, text] = camera_error([&] { bench.take(0.001); });
  CHECK(fault == CameraFault::no_frame);
  CHECK(contains(text, c.text));
  CHECK(static_cast<double>(bench.driver.time_ns() - before) == Approx(1e9).epsilon(0.05));
  bench.driver.fault = faults({});
  CHECK(bench.take(0.001).exposure_s == Approx(0.001));
}

TEST_CASE("A late frame is an error, and not taken for the next bracket's") {
  Bench bench;
  bench.take(0.005);
  const std::uint32_t now = bench.driver.frames_made();
  bench.driver.fault = [now](std::uint32_t frame) {
    return frame == now + 3 ? FakeFault{FakeFault::late, 3} : FakeFault{};
  };
  CHECK(camera_error([&] { bench.take(0.02); }).first == CameraFault::no_frame);
  CHECK(bench.seen_exposure_s(bench.take(0.001)) == Approx(0.001).margin(2e-4));
}

TEST_CASE("Stale frames of an idle stream are not counted") {
  Bench bench;
  bench.take(0.005);
  bench.driver.pass_time(5);
  const std::int64_t armed = bench.driver.time_ns();
  CHECK(bench.take(0.005).timestamp_ns >= armed);
}

TEST_CASE("A camera that cannot be had is absent, with the reason, and is taken when it comes") {
  struct Case {
    std::function<void(FakeV4l2&)> away;
    std::function<void(FakeV4l2&)> back;
    CameraFault fault;
    std::string text;
  };
  const std::vector<Case> cases{
      {[](FakeV4l2& d) { d.present = false; }, [](FakeV4l2& d) { d.present = true; },
       CameraFault::absent, "is the camera plugged in"},
      {[](FakeV4l2& d) { d.busy = true; }, [](FakeV4l2& d) { d.busy = false; }, CameraFault::absent,
       "another program uses the camera"},
      {[](FakeV4l2& d) { d.capabilities = V4L2_CAP_VIDEO_OUTPUT; },
       [](FakeV4l2& d) { d.capabilities = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING; },
       CameraFault::absent, "captures no video"},
      {[](FakeV4l2& d) { d.out_of_memory = true; }, [](FakeV4l2& d) { d.out_of_memory = false; },
       CameraFault::out_of_memory, "REQBUFS"},
  };
  for (const Case& c : cases) {
    CAPTURE(c.text);
    Bench bench;
    c.away(bench.driver);
    for (int turn = 0; turn < 3; ++turn) {
      const auto [fault, text] = camera_error([&] { bench.take(0.005); });
      CHECK(fault == c.fault);
      CHECK(contains(text, c.text));
      CHECK(contains(text, "/dev/video0"));
      CHECK(bench.held() == 0);
    }
    c.back(bench.driver);
    bench.camera->probe();
    CHECK(bench.take(0.005).exposure_s == Approx(0.005));
  }
}

TEST_CASE("A camera that gives another format is refused with both") {
  const FakeSensor sensor;
  FakeV4l2 driver(sensor);
  SensorFormat other = format_of(sensor);
  other.width = 32;
  const auto camera = make_v4l2_camera(settings_of(sensor), other, driver);
  const auto [fault, text] = camera_error([&] { camera->probe(); });
  CHECK(fault == CameraFault::absent);
  CHECK(contains(text, "gives 16 x 12 'Y10 ' for 32 x 12 'Y10 '"));
}

TEST_CASE(
    "Unplugged at any frame of a bracket: an error, nothing held, and back without a restart") {
  for (std::uint32_t at = 0; at < 12; ++at) {
    CAPTURE(at);
    Bench bench;
    bench.driver.at_frame = [&](std::uint32_t frame) {
      if (frame == at) bench.driver.unplug();
    };
    if (at == 0) bench.driver.unplug();
    const auto [fault, text] = camera_error([&] {
      bench.camera->arm({{0.001, 1}, {0.005, 1}, {0.02, 1}});
      for (int i = 0; i < 3; ++i)
        bench.camera->next_frame(kPatience);
    });
    CHECK(fault == CameraFault::absent);
    CHECK(bench.held() == 0);
    bench.driver.at_frame = [](std::uint32_t) {};
    bench.driver.present = true;
    CHECK(bench.seen_exposure_s(bench.take(0.005)) == Approx(0.005).margin(2e-4));
  }
}
