#include <fstream>

#include "catch.hpp"
#include "hal/sim/camera_fault.hpp"
#include "hal/sim/sim_station.hpp"
#include "support/input_error.hpp"
#include "support/sim_rig.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using Kind = SimCameraFault::Kind;

namespace {

constexpr std::chrono::seconds kPatience(1);

/// A bench whose camera fails as told.
struct Bench {
  Bench() {
    SimBenchSettings settings = precise_bench();
    settings.camera_fault_file = dir / "fault";
    station = std::make_unique<SimStation>(settings);
    Scene scene = part_of({lambert_material("body", 0.5)});
    scene.sensor.noise = true;
    station->place(scene, 1, 0);
    station->lights().on(2);
  }
  void fails(const std::string& text) { dir.write("fault", text); }
  std::vector<RawFrame> take(const std::vector<double>& exposures_s) {
    std::vector<ExposureRequest> bracket;
    for (const double s : exposures_s)
      bracket.push_back({.exposure_s = s});
    station->camera().arm(bracket);
    std::vector<RawFrame> frames;
    for (std::size_t i = 0; i < bracket.size(); ++i)
      frames.push_back(station->camera().next_frame(kPatience));
    return frames;
  }
  CameraFault fault_of_taking(const std::vector<double>& exposures_s) {
    try {
      take(exposures_s);
    } catch (const CameraError& error) {
      return error.fault();
    }
    FAIL("nothing was thrown");
    return {};
  }

  TempDir dir;
  std::unique_ptr<SimStation> station;
};

double signal(const RawFrame& frame) {
  return cv::mean(frame.counts)[0] - kBlackDn;
}

}  // namespace

TEST_CASE("A fault is a kind and a frame") {
  CHECK(parse_camera_fault("", "f") == SimCameraFault{});
  CHECK(parse_camera_fault("frozen 3\n", "f") == SimCameraFault{Kind::frozen, 3});
  CHECK(parse_camera_fault("absent", "f") == SimCameraFault{Kind::absent, 0});
  for (const char* wrong : {"melted", "frozen three", "frozen -1", "frozen 3 4"}) {
    CAPTURE(wrong);
    CHECK(contains(input_error([&] { parse_camera_fault(wrong, "f"); }), "f: "));
  }
}

TEST_CASE("A simulated camera that is away or without memory is back when the fault is gone") {
  Bench bench;
  bench.fails("absent");
  CHECK_THROWS_AS(bench.station->camera().probe(), CameraError);
  CHECK(bench.fault_of_taking({0.001}) == CameraFault::absent);
  bench.fails("out_of_memory");
  CHECK(bench.fault_of_taking({0.001}) == CameraFault::out_of_memory);
  bench.fails("");
  CHECK(bench.take({0.001}).size() == 1);
}

TEST_CASE("Unplugged, the simulated camera stays away until it is plugged in") {
  Bench bench;
  bench.fails("unplugged 1");
  bench.station->camera().probe();
  CHECK(bench.fault_of_taking({0.001, 0.002}) == CameraFault::absent);
  CHECK_THROWS_AS(bench.station->camera().probe(), CameraError);
  bench.fails("none");
  bench.station->camera().probe();
  CHECK(bench.take({0.001}).size() == 1);
}

TEST_CASE("Frames of the simulated camera get lost, black, frozen and wrongly exposed") {
  Bench bench;
  SECTION("lost") {
    bench.fails("lost 1");
    CHECK(bench.fault_of_taking({0.001, 0.002}) == CameraFault::no_frame);
  }
  SECTION("black") {
    bench.fails("black 1");
    const auto frames = bench.take({0.001, 0.002, 0.004});
    CHECK(signal(frames[0]) > 0);
    CHECK(signal(frames[1]) == 0);
    CHECK(signal(frames[2]) == Approx(4 * signal(frames[0])).epsilon(0.05));
  }
  SECTION("frozen") {
    bench.fails("frozen 1");
    const auto frames = bench.take({0.001, 0.002, 0.004});
    CHECK(cv::norm(frames[0].counts, frames[2].counts, cv::NORM_INF) == 0);
    CHECK(frames[2].exposure_s == Approx(0.004));
  }
  SECTION("not applied") {
    bench.fails("not_applied 1");
    const auto frames = bench.take({0.001, 0.002});
    CHECK(frames[1].exposure_s == Approx(0.002));
    CHECK(signal(frames[1]) == Approx(signal(frames[0])).epsilon(0.05));
  }
}
