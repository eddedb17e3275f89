// What a V4L2 frame holds, on a real kernel: v4l2loopback hands on what this program writes. The
// camera contract itself is run by camera_contract. Runs in the kernel lab, as root.
#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <thread>

#include "catch.hpp"
#include "hal/v4l2/v4l2_camera.hpp"

using namespace brdfgate;

namespace {

constexpr const char* kLoopback = "/dev/video40";

SensorFormat mono(int width, int height, int bits) {
  return {.width = width,
          .height = height,
          .bits = bits,
          .black_level_dn = 0,
          .full_well_dn = double((1 << bits) - 1)};
}

CameraDeviceSettings device(const std::string& node, const char* format) {
  CameraDeviceSettings settings;
  settings.device = node;
  settings.pixel_format = find_raw_format(format);
  settings.fixed_exposure_s = 0.002;
  // The loopback copies its writer's buffer and names no clock; it stamps when a frame is written.
  settings.timestamp = TimestampPoint::end_of_frame;
  settings.readout_s = 0.0001;
  return settings;
}

/// Writes frames into the loopback for as long as it lives; the first count says which.
class Feeder {
 public:
  Feeder(const std::string& node, int width, int height)
      : fd_(::open(node.c_str(), O_RDWR)),
        frame_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 100) {
    v4l2_format format{};
    format.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    format.fmt.pix.width = static_cast<std::uint32_t>(width);
    format.fmt.pix.height = static_cast<std::uint32_t>(height);
    format.fmt.pix.pixelformat = V4L2_PIX_FMT_Y16;
    format.fmt.pix.field = V4L2_FIELD_NONE;
    if (fd_ < 0 || ::ioctl(fd_, VIDIOC_S_FMT, &format) != 0) {
      throw std::runtime_error(node + " takes no frames");
    }
    // Before the first frame the loopback has no format to tell.
    if (::write(fd_, frame_.data(), frame_.size() * sizeof frame_[0]) < 0) {
      throw std::runtime_error(node + " takes no frame");
    }
    thread_ = std::jthread([this](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        ++frame_[0];
        static_cast<void>(!::write(fd_, frame_.data(), frame_.size() * sizeof frame_[0]));
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      }
    });
  }
  ~Feeder() {
    thread_.request_stop();
    thread_.join();
    ::close(fd_);
  }
  Feeder(const Feeder&) = delete;
  Feeder& operator=(const Feeder&) = delete;

 private:
  int fd_;
  std::vector<std::uint16_t> frame_;
  std::jthread thread_;
};

}  // namespace

TEST_CASE("Counts come through the kernel as they were written") {
  const Feeder feeder(kLoopback, 64, 48);
  const auto camera = make_v4l2_camera(device(kLoopback, "Y16"), mono(64, 48, 16));
  camera->arm({{.exposure_s = 0.002}, {.exposure_s = 0.002}});
  const RawFrame first = camera->next_frame(std::chrono::seconds(20));
  const RawFrame second = camera->next_frame(std::chrono::seconds(20));
  CHECK(first.counts.at<std::uint16_t>(47, 63) == 100);
  CHECK(second.counts.at<std::uint16_t>(0, 0) > first.counts.at<std::uint16_t>(0, 0));
  CHECK(second.timestamp_ns > first.timestamp_ns);
}

TEST_CASE("A missing node is told") {
  const auto absent = make_v4l2_camera(device("/dev/video99", "GREY"), mono(64, 48, 8));
  CHECK_THROWS_AS(absent->probe(), CameraError);
}
