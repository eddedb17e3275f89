// What every Camera keeps, simulated or real.
#pragma once

#include <functional>
#include <memory>

#include "catch.hpp"
#include "hal/camera.hpp"

namespace brdfgate::test {

/// A camera ready to take frames, with whatever must live as long as it.
struct CameraUnderTest {
  std::shared_ptr<void> owner;
  Camera* camera = nullptr;
};

/// Frames are what the interface says they are.
inline void check_camera_frames(Camera& camera, std::chrono::milliseconds timeout) {
  SECTION("the format is complete") {
    const SensorFormat f = camera.format();
    CHECK(f.width > 0);
    CHECK(f.height > 0);
    CHECK(f.bits >= 8);
    CHECK(f.bits <= 16);
    CHECK(f.full_well_dn > f.black_level_dn);
  }
  SECTION("a frame has the format's size and counts, and leaves the light to the caller") {
    camera.arm({{.exposure_s = 0.002}});
    const RawFrame frame = camera.next_frame(timeout);
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
    camera.arm({{.exposure_s = 0.001}, {.exposure_s = 0.004}});
    const RawFrame first = camera.next_frame(timeout);
    const cv::Mat copy = first.counts.clone();
    static_cast<void>(camera.next_frame(timeout));
    CHECK(cv::norm(first.counts, copy, cv::NORM_INF) == 0);
  }
  SECTION("frames follow one another without overlap") {
    camera.arm({{.exposure_s = 0.002}, {.exposure_s = 0.002}});
    const RawFrame first = camera.next_frame(timeout);
    const RawFrame second = camera.next_frame(timeout);
    CHECK(static_cast<double>(second.timestamp_ns - first.timestamp_ns) >= 1e9 * first.exposure_s);
  }
}

/// Brackets come as armed, and end.
inline void check_camera_brackets(Camera& camera, std::chrono::milliseconds timeout) {
  const auto exposure = [&] { return camera.next_frame(timeout).exposure_s; };
  SECTION("with nothing armed, next_frame fails at once") {
    CHECK_THROWS_AS(camera.next_frame(timeout), DeviceError);
  }
  SECTION("a bracket comes in the order it was armed, then nothing is left") {
    camera.arm({{.exposure_s = 0.004}, {.exposure_s = 0.001}, {.exposure_s = 0.002}});
    CHECK(exposure() == Approx(0.004).epsilon(0.02));
    CHECK(exposure() == Approx(0.001).epsilon(0.02));
    CHECK(exposure() == Approx(0.002).epsilon(0.02));
    CHECK_THROWS_AS(camera.next_frame(timeout), DeviceError);
  }
  SECTION("arming again drops what was armed") {
    camera.arm({{.exposure_s = 0.004}, {.exposure_s = 0.004}});
    camera.arm({{.exposure_s = 0.001}});
    CHECK(exposure() == Approx(0.001).epsilon(0.02));
    CHECK_THROWS_AS(camera.next_frame(timeout), DeviceError);
  }
  SECTION("stop drops what is armed, may be called again, and the camera can be armed after it") {
    camera.stop();
    camera.arm({{.exposure_s = 0.001}, {.exposure_s = 0.001}});
    static_cast<void>(camera.next_frame(timeout));
    camera.stop();
    camera.stop();
    CHECK_THROWS_AS(camera.next_frame(timeout), DeviceError);
    camera.arm({{.exposure_s = 0.002}});
    CHECK(exposure() == Approx(0.002).epsilon(0.02));
  }
  SECTION("a frame that cannot come in time is an error") {
    camera.arm({{.exposure_s = 0.05}});
    CHECK_THROWS_AS(camera.next_frame(std::chrono::milliseconds(1)), DeviceError);
  }
}

/// Call it inside a TEST_CASE; `make` gives a fresh camera with nothing armed, on which exposures
/// of a few milliseconds work.
inline void check_camera_contract(const std::function<CameraUnderTest()>& make) {
  const CameraUnderTest under_test = make();
  const std::chrono::milliseconds timeout(5000);
  check_camera_frames(*under_test.camera, timeout);
  check_camera_brackets(*under_test.camera, timeout);
}

}  // namespace brdfgate::test
