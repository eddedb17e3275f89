// The V4L2 backend on real kernel drivers: vivid (a virtual camera) and v4l2loopback (frames that
// another program writes). Neither has an exposure control; cases follow what a camera declares.
// Runs in the kernel lab, as root.
#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "catch.hpp"
#include "gpio_sim.hpp"
#include "hal/v4l2/v4l2_camera.hpp"
#include "unit/hal/camera_contract.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

namespace fs = std::filesystem;

/// The first video node whose driver gave it this name.
std::string node_named(const std::string& start) {
  std::string found;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator("/sys/class/video4linux", none)) {
    std::ifstream in(entry.path() / "name");
    std::string name;
    std::getline(in, name);
    const std::string node = "/dev/" + entry.path().filename().string();
    if (name.rfind(start, 0) == 0 && fs::exists(node)) found = node;
  }
  return found;
}

void write_text(const fs::path& file, const std::string& text) {
  std::ofstream out(file);
  out << text << std::flush;
  if (!out) throw std::runtime_error("cannot write " + file.string());
}

int open_descriptors() {
  const fs::directory_iterator fds("/proc/self/fd");
  return static_cast<int>(std::distance(begin(fds), end(fds)));
}

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

CameraUnderTest under_test(const std::shared_ptr<void>& owner, Camera& camera) {
  CameraUnderTest t{owner, &camera};
  t.exposures_s = {0.002, 0.002, 0.002};
  t.timeout = std::chrono::seconds(20);
  t.held = [] { return open_descriptors(); };
  t.cycles = 50;  // of real time; ten thousand run against the fake driver
  return t;
}

}  // namespace

TEST_CASE("The V4L2 camera keeps the camera's contract on vivid, and when it is unbound and back") {
  const std::string node = node_named("vivid-000-vid-cap");
  REQUIRE_FALSE(node.empty());
  check_camera_contract([&] {
    const std::shared_ptr<Camera> camera =
        make_v4l2_camera(device(node, "GREY"), mono(320, 180, 8));
    CameraUnderTest t = under_test(camera, *camera);
    const fs::path driver = "/sys/bus/platform/drivers/vivid";
    t.unplug = [driver] { write_text(driver / "unbind", "vivid.0"); };
    t.replug = [driver] {
      write_text(driver / "bind", "vivid.0");
      GpioSim::await([] { return !node_named("vivid-000-vid-cap").empty(); });
    };
    return t;
  });
}

TEST_CASE("The V4L2 camera keeps the camera's contract on v4l2loopback") {
  const std::string node = node_named("lab");
  REQUIRE_FALSE(node.empty());
  check_camera_contract([&] {
    const auto feeder = std::make_shared<Feeder>(node, 64, 48);
    const std::shared_ptr<Camera> camera = make_v4l2_camera(device(node, "Y16"), mono(64, 48, 16));
    return under_test(std::make_shared<std::pair<std::shared_ptr<Feeder>, std::shared_ptr<Camera>>>(
                          feeder, camera),
                      *camera);
  });
}

TEST_CASE("Counts come through the kernel as they were written") {
  const std::string node = node_named("lab");
  const Feeder feeder(node, 64, 48);
  const auto camera = make_v4l2_camera(device(node, "Y16"), mono(64, 48, 16));
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
