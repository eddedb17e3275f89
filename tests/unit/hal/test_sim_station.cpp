#include <cmath>

#include "camera_contract.hpp"
#include "catch.hpp"
#include "hal/sim/sim_station.hpp"
#include "lights_contract.hpp"
#include "support/input_error.hpp"
#include "support/sim_rig.hpp"
#include "trigger_contract.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

/// Everything that is drawn, on few pixels.
Scene lively_scene() {
  Scene scene =
      part_of({{"body", make_brdf(GgxParameters{Rgb(0.3, 0.2, 0.1), Rgb::Constant(0.04), 0.2})}});
  scene.sensor.noise = true;
  scene.jitter = {.shift_mm = {1, 1}, .rotation_deg = 1, .tilt_deg = {0.3, 0.3}, .height_mm = 0.1};
  scene.variation = {.albedo = 0.05, .gloss = 0.05, .roughness = 0.05};
  scene.light.ambient = 0.01;
  return scene;
}

bool same(const RawFrame& a, const RawFrame& b) {
  return cv::norm(a.counts, b.counts, cv::NORM_INF) == 0;
}

double mean_electrons(const RawFrame& frame) {
  return (cv::mean(frame.counts)[0] - kBlackDn) / kDnPerElectron;
}

std::string refusal(const SimBenchSettings& settings) {
  return input_error([&] { return std::make_unique<SimStation>(settings); });
}

}  // namespace

TEST_CASE("the simulated camera keeps the camera's contract") {
  check_camera_contract([] {
    const auto station = std::make_shared<SimStation>(precise_bench());
    station->place(lively_scene(), 1, 0);
    CameraUnderTest t{station, &station->camera()};
    t.held = [] { return 0; };
    return t;
  });
}

TEST_CASE("the simulated lights keep the lights' contract") {
  check_lights_contract([] {
    const auto station = std::make_shared<SimStation>(precise_bench());
    // Light 2 burns half as bright again, so that one frame tells which one burns.
    Scene scene = scene_of(SceneTarget::white);
    scene.light.drift = {0, 0.5};
    station->place(scene, 1, 0);
    const auto burning = [station = station.get()] {
      station->camera().arm({{.exposure_s = kWhiteExposureS / 2}});
      const RawFrame frame = station->camera().next_frame(std::chrono::seconds(1));
      return static_cast<LightIndex>(std::lround(std::ceil(electrons(frame, 24, 32) / 2510)));
    };
    return LightsUnderTest{station, &station->lights(), burning};
  });
}

TEST_CASE("the simulated trigger keeps the trigger's contract") {
  check_trigger_contract([] {
    const auto station = std::make_shared<SimStation>(precise_bench());
    return TriggerUnderTest{station, &station->trigger(), [station] { station->fire_trigger(); }};
  });
}

TEST_CASE("a camera with no scene under it says so") {
  SimStation station(precise_bench());
  station.camera().arm({{.exposure_s = 0.001}});
  CHECK_THROWS_AS(station.camera().next_frame(std::chrono::seconds(1)), DeviceError);
}

TEST_CASE("an exposure or gain that is no number over zero cannot be armed") {
  SimStation station(precise_bench());
  for (const double wrong : {0.0, -1.0, std::nan("")}) {
    CHECK_THROWS_AS(station.camera().arm({{.exposure_s = wrong}}), DeviceError);
    CHECK_THROWS_AS(station.camera().arm({{.exposure_s = 1, .gain = wrong}}), DeviceError);
  }
}

TEST_CASE("exposures are reported as applied, and the clock runs by exposure and readout") {
  SimBenchSettings s = precise_bench();
  s.line_time_s = 14.8e-6;
  SimStation station(s);
  station.place(scene_of(SceneTarget::white), 1, 0);
  const RawFrame first = take(station, 2, 30e-6);
  const RawFrame second = take(station, 2, 60e-6);
  CHECK(first.exposure_s == Approx(2 * 14.8e-6));
  CHECK(second.exposure_s == Approx(4 * 14.8e-6));
  // The counts follow the applied exposure: half of full well in 8 ms.
  CHECK(electrons(second, 24, 32) == Approx(5000 * second.exposure_s / 0.008).margin(0.11));
  CHECK(static_cast<double>(second.timestamp_ns - first.timestamp_ns) ==
        Approx(1e9 * (2 + 48) * 14.8e-6).margin(1));
}

TEST_CASE("signal is proportional to exposure and gain until it clips") {
  SimStation station(precise_bench());
  station.place(scene_of(SceneTarget::white), 1, 0);
  const double base = electrons(take(station, 2, 0.001), 24, 32);
  CHECK(base == Approx(625).margin(0.11));
  CHECK(electrons(take(station, 2, 0.010), 24, 32) == Approx(6250).margin(0.11));
  CHECK(electrons(take(station, 2, 0.001, 4), 24, 32) == Approx(2500).margin(0.11));
  CHECK(take(station, 2, 0.1).counts.at<std::uint16_t>(24, 32) == 60000);
}

TEST_CASE("a frame is dark while no light was switched on, or the lights do not work") {
  SimStation station(precise_bench());
  Scene scene = scene_of(SceneTarget::white);
  station.place(scene, 1, 0);
  CHECK(cv::countNonZero(take(station, kNoLight).counts != kBlackDn) == 0);
  scene.lights_on = false;
  station.place(scene, 1, 0);
  CHECK(cv::countNonZero(take(station, 1).counts != kBlackDn) == 0);
}

TEST_CASE("drift changes each light by its own share") {
  const SimBenchSettings s = precise_bench();
  Scene scene = scene_of(SceneTarget::white);
  scene.light.drift = {-0.1, 0.2};
  CHECK(electrons(take(s, scene, 1), 24, 32) == Approx(4500).margin(0.11));
  CHECK(electrons(take(s, scene, 2), 24, 32) == Approx(6000).margin(0.11));
}

TEST_CASE("part n of a seed is the same on every bench, whatever else was called") {
  const SimBenchSettings s = precise_bench(64, 48, Mosaic::rggb);
  const Scene scene = lively_scene();
  SimStation plain(s);
  plain.place(scene, 11, 3);
  const RawFrame first = take(plain, 1);
  const RawFrame second = take(plain, 2);

  SimStation busy(s);
  busy.place(scene, 11, 2);
  take(busy, 2);
  busy.place(scene, 11, 3);
  busy.camera().arm({{.exposure_s = 1}, {.exposure_s = 2}});
  busy.camera().stop();
  busy.lights().on(2);
  CHECK(same(first, take(busy, 1)));
  CHECK(same(second, take(busy, 2)));
  CHECK(busy.drawn().pose.shift_mm == plain.drawn().pose.shift_mm);
  CHECK(busy.drawn().variation.gloss == plain.drawn().variation.gloss);

  SECTION("and the light taken first does not matter to the mean") {
    SimStation other(s);
    other.place(scene, 11, 3);
    take(other, 2);
    CHECK(mean_electrons(take(other, 1)) == Approx(mean_electrons(first)).epsilon(0.01));
  }
}

TEST_CASE("other parts, other seeds and later frames differ") {
  const SimBenchSettings s = precise_bench();
  const Scene scene = lively_scene();
  SimStation station(s);
  station.place(scene, 11, 3);
  const RawFrame base = take(station, 1);
  CHECK_FALSE(same(base, take(station, 1)));
  station.place(scene, 11, 4);
  CHECK_FALSE(same(base, take(station, 1)));
  station.place(scene, 12, 3);
  CHECK_FALSE(same(base, take(station, 1)));
}

TEST_CASE("a light follows its switch exponentially, and the one before fades") {
  SimBenchSettings s = precise_bench();
  s.light_rise_s = 0.002;
  s.light_settle_s = 0.02;
  SimStation station(s);
  Scene scene = scene_of(SceneTarget::white);
  scene.light.drift = {0, 0.5};
  station.place(scene, 1, 0);
  const double exposure = 0.001;
  const double steady = 5000 * exposure / kWhiteExposureS;
  // The mean of 1 - exp(-t / tau) over an exposure that starts at `t0`.
  const auto risen = [&](double t0) {
    const double tau = s.light_rise_s;
    return 1 - tau / exposure * (std::exp(-t0 / tau) - std::exp(-(t0 + exposure) / tau));
  };
  const auto shoot = [&] {
    station.camera().arm({{.exposure_s = exposure}});
    return station.camera().next_frame(std::chrono::seconds(1));
  };
  const auto after_s = [&](const RawFrame& frame) {
    return 1e-9 * static_cast<double>(frame.timestamp_ns - station.lights().switched_at_ns());
  };
  station.lights().on(1);
  CHECK(station.lights().settled_at_ns() - station.lights().switched_at_ns() == 20'000'000);
  RawFrame frame = shoot();
  while (frame.timestamp_ns < station.lights().settled_at_ns()) {
    CHECK(electrons(frame, 24, 32) == Approx(steady * risen(after_s(frame))).margin(0.15));
    frame = shoot();
  }
  CHECK(electrons(frame, 24, 32) == Approx(steady).margin(0.15));
  station.lights().on(2);
  for (int i = 0; i < 4; ++i) {
    frame = shoot();
    const double share = risen(after_s(frame));
    CHECK(electrons(frame, 24, 32) == Approx(steady * (1.5 * share + 1 - share)).margin(0.2));
  }
}

TEST_CASE("photon transfer of two white frames gives the bench's gain") {
  SimStation station(precise_bench(256, 192));
  Scene scene = scene_of(SceneTarget::white);
  scene.sensor.noise = true;
  station.place(scene, 1, 0);
  cv::Mat a;
  cv::Mat b;
  take(station, 2).counts.convertTo(a, CV_64F);
  take(station, 2).counts.convertTo(b, CV_64F);
  const cv::Mat difference = a - b;
  const double signal = (cv::mean(a)[0] + cv::mean(b)[0]) / 2 - kBlackDn;
  const double variance = difference.dot(difference) / static_cast<double>(a.total()) / 2;
  CHECK((variance - 4 - 1.0 / 12) / signal == Approx(kDnPerElectron).epsilon(0.03));
}

TEST_CASE("the variation drawn is the variation seen") {
  SimStation station(precise_bench());
  Scene scene = part_of({lambert_material("body", 0.5)});
  scene.variation.albedo = 0.2;
  for (std::uint64_t part = 0; part < 4; ++part) {
    station.place(scene, 1, part);
    const double expected = 5000 * 0.5 / 0.99 * station.drawn().variation.albedo;
    CHECK(electrons(take(station, 2), 24, 32) == Approx(expected).margin(0.11));
  }
}

TEST_CASE("a scene that is refused leaves the part that was there") {
  SimStation station(precise_bench());
  station.place(part_of({lambert_material("body", 0.5)}), 1, 0);
  const RawFrame before = take(station, 2);
  Scene wrong = part_of({});
  CHECK(contains(input_error([&] { station.place(wrong, 1, 1); }), "scene.materials"));
  wrong = scene_of(SceneTarget::white);
  wrong.light.ambient = -1;
  CHECK(contains(input_error([&] { station.place(wrong, 1, 1); }), "scene.light.ambient"));
  CHECK(same(before, take(station, 2)));
}

TEST_CASE("settings that are not physical are refused by name") {
  CHECK(refusal(precise_bench()) == "(no error)");
  SimBenchSettings s = precise_bench();
  SECTION("odd width") {
    s.sensor.width = 63;
    CHECK(contains(refusal(s), "camera.sensor.width"));
  }
  SECTION("line time") {
    s.line_time_s = 0;
    CHECK(contains(refusal(s), "simulator.line_time_us"));
  }
  SECTION("rise of the lights") {
    s.light_rise_s = -1;
    CHECK(contains(refusal(s), "simulator.light_rise_ms"));
  }
  SECTION("settling of the lights") {
    s.light_settle_s = -1;
    CHECK(contains(refusal(s), "lights.settle_ms"));
  }
  SECTION("white exposure") {
    s.white_exposure_s = std::nan("");
    CHECK(contains(refusal(s), "simulator.white_exposure_ms"));
  }
  SECTION("no lights") {
    s.geometry.lights_W.clear();
    CHECK(contains(refusal(s), "rig.lights"));
  }
  SECTION("a light under the plane") {
    s.geometry.lights_W[0].z() = -0.1;
    CHECK(contains(refusal(s), "rig.lights"));
  }
}
