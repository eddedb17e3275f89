// What every Camera keeps, simulated or real. Cases follow what the camera declares it can do.
#pragma once

#include <array>
#include <functional>
#include <limits>
#include <memory>

#include "catch.hpp"
#include "hal/camera.hpp"

namespace brdfgate::test {

/// A camera ready to take frames, with whatever must live as long as it.
struct CameraUnderTest {
  std::shared_ptr<void> owner;
  Camera* camera = nullptr;
  /// Three exposures that it can apply, rising; all the same where the exposure is fixed.
  std::array<double, 3> exposures_s{0.001, 0.002, 0.004};
  std::chrono::milliseconds timeout{5000};
  /// Takes the device away and brings it back; empty where nobody can.
  std::function<void()> unplug{};
  std::function<void()> replug{};
  /// Descriptors, mappings and buffers held by the camera; empty where nobody can count them.
  std::function<int()> held{};
  int cycles = 10000;  ///< of the leak test
};

/// Frames are what the interface says they are.
inline void check_camera_frames(const CameraUnderTest& t) {
  Camera& camera = *t.camera;
  const auto [brief, middle, lengthy] = t.exposures_s;
  SECTION("the format is complete") {
    const SensorFormat f = camera.format();
    CHECK(f.width > 0);
    CHECK(f.height > 0);
    CHECK(f.bits >= 8);
    CHECK(f.bits <= 16);
    CHECK(f.full_well_dn > f.black_level_dn);
  }
  SECTION("a frame has the format's size and counts, and leaves the light to the caller") {
    camera.arm({{.exposure_s = middle}});
    const RawFrame frame = camera.next_frame(t.timeout);
    CHECK(frame.counts.type() == CV_16UC1);
    CHECK(frame.counts.cols == camera.format().width);
    CHECK(frame.counts.rows == camera.format().height);
    CHECK(frame.light == kNoLight);
    CHECK(frame.gain == Approx(1).epsilon(0.02));
    double most = 0;
    cv::minMaxLoc(frame.counts, nullptr, &most);
    CHECK(most < (1 << camera.format().bits));
  }
  SECTION("frames own their counts") {
    camera.arm({{.exposure_s = brief}, {.exposure_s = lengthy}});
    const RawFrame first = camera.next_frame(t.timeout);
    const cv::Mat copy = first.counts.clone();
    static_cast<void>(camera.next_frame(t.timeout));
    CHECK(cv::norm(first.counts, copy, cv::NORM_INF) == 0);
  }
  SECTION("frames follow one another without overlap") {
    camera.arm({{.exposure_s = middle}, {.exposure_s = middle}});
    const RawFrame first = camera.next_frame(t.timeout);
    const RawFrame second = camera.next_frame(t.timeout);
    CHECK(static_cast<double>(second.timestamp_ns - first.timestamp_ns) >= 1e9 * first.exposure_s);
  }
  SECTION("no frame's exposure began before it may") {
    camera.arm({{.exposure_s = brief}});
    const RawFrame first = camera.next_frame(t.timeout);
    const std::int64_t not_before = first.timestamp_ns + 300'000'000;
    camera.arm({{.exposure_s = brief}, {.exposure_s = middle}}, not_before);
    CHECK(camera.next_frame(t.timeout).timestamp_ns >= not_before);
    CHECK(camera.next_frame(t.timeout).timestamp_ns > not_before);
  }
}

/// Exposure and gain are applied, or refused by name.
inline void check_camera_settings(const CameraUnderTest& t) {
  Camera& camera = *t.camera;
  SECTION("an exposure or gain that is no number over zero cannot be armed") {
    for (const double wrong : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
      CHECK_THROWS_AS(camera.arm({{.exposure_s = wrong}}), DeviceError);
      CHECK_THROWS_AS(camera.arm({{.exposure_s = t.exposures_s[0], .gain = wrong}}), DeviceError);
    }
  }
  SECTION("a gain is applied, or refused") {
    const std::vector<ExposureRequest> doubled{{.exposure_s = t.exposures_s[0], .gain = 2}};
    if (camera.capabilities().gain) {
      camera.arm(doubled);
      CHECK(camera.next_frame(t.timeout).gain == Approx(2).epsilon(0.02));
    } else {
      CHECK_THROWS_AS(camera.arm(doubled), DeviceError);
    }
  }
  SECTION("the same bracket gives the same exposures again") {
    for (int turn = 0; turn < 3; ++turn) {
      camera.arm({{.exposure_s = t.exposures_s[2]}, {.exposure_s = t.exposures_s[0]}});
      CHECK(camera.next_frame(t.timeout).exposure_s == Approx(t.exposures_s[2]).epsilon(0.02));
      CHECK(camera.next_frame(t.timeout).exposure_s == Approx(t.exposures_s[0]).epsilon(0.02));
    }
  }
}

/// Brackets come as armed, and end.
inline void check_camera_brackets(const CameraUnderTest& t) {
  Camera& camera = *t.camera;
  const auto [brief, middle, lengthy] = t.exposures_s;
  const auto exposure = [&] { return camera.next_frame(t.timeout).exposure_s; };
  SECTION("with nothing armed, next_frame fails at once") {
    CHECK_THROWS_AS(camera.next_frame(t.timeout), DeviceError);
    camera.arm(std::vector<ExposureRequest>{});
    CHECK_THROWS_AS(camera.next_frame(t.timeout), DeviceError);
  }
  SECTION("a bracket comes in the order it was armed, then nothing is left") {
    camera.arm({{.exposure_s = lengthy}, {.exposure_s = brief}, {.exposure_s = middle}});
    CHECK(exposure() == Approx(lengthy).epsilon(0.02));
    CHECK(exposure() == Approx(brief).epsilon(0.02));
    CHECK(exposure() == Approx(middle).epsilon(0.02));
    CHECK_THROWS_AS(camera.next_frame(t.timeout), DeviceError);
  }
  SECTION("arming again drops what was armed") {
    camera.arm({{.exposure_s = lengthy}, {.exposure_s = lengthy}});
    camera.arm({{.exposure_s = brief}});
    CHECK(exposure() == Approx(brief).epsilon(0.02));
    CHECK_THROWS_AS(camera.next_frame(t.timeout), DeviceError);
  }
  SECTION("stop drops what is armed, may be called again, and the camera can be armed after it") {
    camera.stop();
    camera.arm({{.exposure_s = brief}, {.exposure_s = brief}});
    static_cast<void>(camera.next_frame(t.timeout));
    camera.stop();
    camera.stop();
    CHECK_THROWS_AS(camera.next_frame(t.timeout), DeviceError);
    camera.arm({{.exposure_s = middle}});
    CHECK(exposure() == Approx(middle).epsilon(0.02));
  }
  SECTION("a frame that cannot come in time is an error, and the next bracket is sound") {
    camera.arm({{.exposure_s = brief}});
    // Seconds away, however long a busy machine takes to ask for it.
    const std::int64_t far_off = camera.next_frame(t.timeout).timestamp_ns + 5'000'000'000;
    camera.arm({{.exposure_s = lengthy}, {.exposure_s = brief}}, far_off);
    CHECK_THROWS_AS(camera.next_frame(std::chrono::milliseconds(1)), DeviceError);
    CHECK_THROWS_AS(camera.next_frame(t.timeout), DeviceError);
    camera.probe();
    camera.arm({{.exposure_s = middle}, {.exposure_s = brief}});
    CHECK(exposure() == Approx(middle).epsilon(0.02));
    CHECK(exposure() == Approx(brief).epsilon(0.02));
  }
}

/// Devices go away, and nothing is left behind.
inline void check_camera_upkeep(const CameraUnderTest& t) {
  Camera& camera = *t.camera;
  const auto [brief, middle, lengthy] = t.exposures_s;
  if (t.unplug) {
    SECTION("unplugged in mid-bracket is an error; back, it works without a new camera") {
      camera.arm({{.exposure_s = brief}, {.exposure_s = middle}});
      static_cast<void>(camera.next_frame(t.timeout));
      t.unplug();
      CHECK_THROWS_AS(camera.next_frame(t.timeout), CameraError);
      CHECK_THROWS_AS(camera.probe(), CameraError);
      CHECK_THROWS_AS(camera.arm({{.exposure_s = brief}}), CameraError);
      t.replug();
      camera.probe();
      camera.arm({{.exposure_s = middle}});
      CHECK(camera.next_frame(t.timeout).exposure_s == Approx(middle).epsilon(0.02));
    }
  }
  if (t.held) {
    SECTION("no descriptor and no buffer is lost over many cycles") {
      camera.arm({{.exposure_s = brief}});
      static_cast<void>(camera.next_frame(t.timeout));
      camera.stop();
      const int held = t.held();
      int wrong = 0;
      for (int i = 0; i < t.cycles; ++i) {
        camera.arm({{.exposure_s = brief}, {.exposure_s = brief}});
        static_cast<void>(camera.next_frame(t.timeout));
        // Half of the cycles break off in mid-bracket.
        if (i % 2 == 0) static_cast<void>(camera.next_frame(t.timeout));
        camera.stop();
        wrong += t.held() == held ? 0 : 1;
      }
      CHECK(wrong == 0);
    }
  }
}

/// Call it inside a TEST_CASE; `make` gives a fresh camera with nothing armed.
inline void check_camera_contract(const std::function<CameraUnderTest()>& make) {
  const CameraUnderTest under_test = make();
  check_camera_frames(under_test);
  check_camera_settings(under_test);
  check_camera_brackets(under_test);
  check_camera_upkeep(under_test);
}

}  // namespace brdfgate::test
