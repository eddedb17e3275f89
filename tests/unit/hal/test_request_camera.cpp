#include <cmath>

#include "camera_contract.hpp"
#include "catch.hpp"
#include "hal/libcamera/request_camera.hpp"
#include "support/fake_requests.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using namespace std::chrono_literals;

namespace {

constexpr auto kPatience = 1000ms;

/// A sensor, and a camera on it.
struct Bench {
  explicit Bench(const FakeSensor& sensor = {}) {
    world.sensor = sensor;
    settings.pixel_format = sensor.format;
    settings.line_time_s = world.line_s;
    settings.readout_s = sensor.readout_s;
    settings.note = [this](const std::string& text) { notes.push_back(text); };
    camera = make_request_camera(settings, format(),
                                 [this] { return std::make_unique<FakeRequests>(world); });
  }
  SensorFormat format() const {
    const FakeSensor& s = world.sensor;
    return {.width = s.width,
            .height = s.height,
            .bits = s.format->bits,
            .mosaic = s.format->mosaic,
            .black_level_dn = static_cast<double>(s.black),
            .full_well_dn = std::ldexp(1.0, s.format->bits) - 1};
  }
  RawFrame take(double exposure_s, double gain = 1) {
    camera->arm({{exposure_s, gain}});
    return camera->next_frame(kPatience);
  }
  double seen_exposure_s(const RawFrame& frame) const {
    return (cv::mean(frame.counts)[0] - world.sensor.black) / world.sensor.counts_per_s /
           frame.gain;
  }

  FakeRequestSensor world;
  CameraDeviceSettings settings;
  std::vector<std::string> notes;
  std::unique_ptr<Camera> camera;
};

CameraUnderTest contract_of(const std::shared_ptr<Bench>& bench) {
  CameraUnderTest t{bench, bench->camera.get()};
  t.unplug = [b = bench.get()] { b->world.present = false; };
  t.replug = [b = bench.get()] { b->world.present = true; };
  t.held = [b = bench.get()] { return b->world.open; };
  return t;
}

template <typename Call>
std::pair<CameraFault, std::string> camera_error(const Call& call) {
  try {
    call();
  } catch (const CameraError& error) {
    return {error.fault(), error.what()};
  }
  return {CameraFault::implausible, "nothing was thrown"};
}

std::function<FakeFault(std::uint32_t)> faults(std::map<std::uint32_t, FakeFault::Kind> at) {
  return [at = std::move(at)](std::uint32_t frame) {
    const auto it = at.find(frame);
    return FakeFault{it == at.end() ? FakeFault::none : it->second};
  };
}

const std::vector<ExposureRequest> kBracket{{0.0004, 1}, {0.005, 1}, {0.05, 1}, {0.005, 4}};

}  // namespace

TEST_CASE("The libcamera camera keeps the camera's contract") {
  check_camera_contract([] { return contract_of(std::make_shared<Bench>()); });
}

TEST_CASE("A request's frame counts for what its metadata report, however late that is") {
  FakeSensor sensor;
  sensor.latency_frames = GENERATE(0, 1, 2, 3, 5, 8);
  CAPTURE(sensor.latency_frames);
  Bench bench(sensor);
  for (int turn = 0; turn < 4; ++turn) {
    bench.camera->arm(kBracket);
    for (const ExposureRequest& asked : kBracket) {
      const RawFrame frame = bench.camera->next_frame(2000ms);
      CHECK(frame.exposure_s == Approx(asked.exposure_s));
      CHECK(frame.gain == Approx(asked.gain));
      CHECK(bench.seen_exposure_s(frame) == Approx(asked.exposure_s).margin(2e-4));
    }
  }
}

TEST_CASE("A bracket is queued ahead: it costs the latency once, not once an exposure") {
  FakeSensor sensor;
  sensor.latency_frames = 4;
  Bench bench(sensor);
  bench.camera->arm(kBracket);
  for (std::size_t i = 0; i < kBracket.size(); ++i)
    bench.camera->next_frame(kPatience);
  CHECK(bench.world.frame <= 4 + kBracket.size() + 1);
}

TEST_CASE("Lost and bad frames are asked for again, and told of") {
  const auto kind =
      GENERATE(FakeFault::dropped, FakeFault::truncated, FakeFault::damaged, FakeFault::repeated);
  CAPTURE(kind);
  Bench bench;
  bench.world.fault = faults({{2, kind}, {4, kind}, {9, kind}});
  bench.camera->arm(kBracket);
  for (const ExposureRequest& asked : kBracket) {
    const RawFrame frame = bench.camera->next_frame(kPatience);
    CHECK(bench.seen_exposure_s(frame) == Approx(asked.exposure_s).margin(2e-4));
  }
  CHECK(bench.notes.size() == 1);
}

TEST_CASE("Requests of nothing but bad frames end in time and say what came") {
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
  bench.world.fault = [&](std::uint32_t) { return FakeFault{c.kind}; };
  const auto [fault, text] = camera_error([&] { bench.take(0.001); });
  CHECK(fault == CameraFault::no_frame);
  CHECK(contains(text, c.text));
  bench.world.fault = faults({});
  CHECK(bench.take(0.001).exposure_s == Approx(0.001));
}

TEST_CASE("An exposure that is never applied is an error of its own, in time") {
  Bench bench;
  bench.world.exposure_sticks = true;
  const std::int64_t before = bench.world.now;
  const auto [fault, text] = camera_error([&] { bench.take(0.001); });
  CHECK(fault == CameraFault::not_applied);
  CHECK(contains(text, "with another exposure or gain"));
  CHECK(static_cast<double>(bench.world.now - before) == Approx(1e9).epsilon(0.05));
}

TEST_CASE("Frames that report nothing count for nothing") {
  Bench bench;
  bench.world.reports = false;
  const auto [fault, text] = camera_error([&] { bench.take(0.001); });
  CHECK(fault == CameraFault::no_frame);
  CHECK(contains(text, "with settings unknown"));
}

TEST_CASE("The frame's duration fits its exposure and readout") {
  Bench bench;
  bench.take(0.05);
  const std::int64_t before = bench.world.now;
  bench.camera->arm({{0.05, 1}, {0.05, 1}});
  const RawFrame first = bench.camera->next_frame(kPatience);
  const RawFrame second = bench.camera->next_frame(kPatience);
  CHECK(first.timestamp_ns >= before);
  CHECK(1e-9 * static_cast<double>(second.timestamp_ns - first.timestamp_ns) ==
        Approx(0.05 + bench.world.sensor.readout_s).margin(1e-4));
}

TEST_CASE("What libcamera's camera cannot apply is refused by name") {
  Bench bench;
  CHECK(contains(camera_error([&] { bench.take(0.3); }).second,
                 "300 ms cannot be applied; the camera has 0.02 ms to 200 ms"));
  CHECK(contains(camera_error([&] { bench.take(0.001, 20); }).second,
                 "a gain of 20 cannot be applied"));
  CHECK(camera_error([&] { bench.take(0.3); }).first == CameraFault::not_applied);
  CHECK(bench.take(0.005).exposure_s == Approx(0.005));
}

TEST_CASE("A camera that is away at the start or without memory is taken when it can be had") {
  Bench bench;
  bench.world.present = false;
  CHECK(camera_error([&] { bench.camera->probe(); }).first == CameraFault::absent);
  bench.world.present = true;
  bench.world.out_of_memory = true;
  CHECK(camera_error([&] { bench.take(0.005); }).first == CameraFault::out_of_memory);
  bench.world.out_of_memory = false;
  bench.camera->probe();
  CHECK(bench.take(0.005).exposure_s == Approx(0.005));
}

TEST_CASE("Unplugged at any frame of a bracket: an error, nothing held, and back again") {
  for (std::uint32_t at = 1; at < 7; ++at) {
    CAPTURE(at);
    Bench bench;
    bench.world.at_frame = [&](std::uint32_t frame) {
      if (frame == at) bench.world.present = false;
    };
    const auto [fault, text] = camera_error([&] {
      bench.camera->arm(kBracket);
      for (std::size_t i = 0; i < kBracket.size(); ++i)
        bench.camera->next_frame(kPatience);
      bench.camera->probe();
    });
    CHECK(fault == CameraFault::absent);
    CHECK(bench.world.open == 0);
    bench.world.at_frame = [](std::uint32_t) {};
    bench.world.present = true;
    CHECK(bench.seen_exposure_s(bench.take(0.005)) == Approx(0.005).margin(2e-4));
  }
}

TEST_CASE("A part that comes minutes later finds no frames of the last one") {
  Bench bench;
  bench.take(0.005);
  bench.world.now += 600'000'000'000;
  const std::int64_t armed = bench.world.now;
  CHECK(bench.take(0.005).timestamp_ns >= armed);
}

TEST_CASE("Timestamps of libcamera on another clock are refused by name") {
  FakeSensor sensor;
  sensor.stamp_offset_ns = GENERATE(1'700'000'000'000'000'000, -31'557'600'000'000'000);
  Bench bench(sensor);
  const auto [fault, text] = camera_error([&] { bench.take(0.005); });
  CHECK(fault == CameraFault::no_frame);
  CHECK(contains(text, "another clock"));
}
