// A bench in front of a real kernel: looks at the station's two LED lines as the lamps would, and
// feeds a v4l2loopback device with the frames that the simulated part gives under them.
//
//   lab_bench STATION VIDEO LINE1 LINE2 ORDERS
//
// STATION: a station file with a simulated camera, whose sensor and rig are the real one's. VIDEO:
// the loopback's node. LINE1, LINE2: sysfs files that hold 0 or 1. ORDERS: a file read before every
// frame, one order a line:
//   scene FILE   what lies under the camera      dead N    light N stays dark
//   silent       no frames                       stuck N   light N stays on
//   mute N       no frames while light N burns   number N  of these orders
// ORDERS.done holds the number of the orders that the last frame obeyed.
#include <fcntl.h>
#include <fmt/core.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "config/scene_reader.hpp"
#include "config/station_config.hpp"
#include "hal/sim/sim_station.hpp"

using namespace brdfgate;

namespace {

/// A frame that took longer, from looking at the lines to its last byte, is dropped: the loopback
/// stamps it when it is written, and the station takes it for begun one exposure earlier. Shorter
/// than the station's settle time, so that no stall passes one light's frame off as another's.
constexpr std::chrono::milliseconds kSlowestFrame{200};

struct Orders {
  std::string scene;
  std::string number;
  bool silent = false;
  LightIndex mute = kNoLight;
  std::array<bool, 2> dead{};
  std::array<bool, 2> stuck{};
};

Orders read_orders(const std::string& file) {
  Orders orders;
  std::ifstream in(file);
  std::string line;
  while (std::getline(in, line)) {
    std::istringstream words(line);
    std::string order;
    std::string what;
    words >> order >> what;
    if (order == "scene") orders.scene = what;
    if (order == "number") orders.number = what;
    if (order == "mute") orders.mute = std::stoi(what);
    if (order == "silent") orders.silent = true;
    if (order == "dead") orders.dead.at(std::stoul(what) - 1) = true;
    if (order == "stuck") orders.stuck.at(std::stoul(what) - 1) = true;
  }
  return orders;
}

/// A line whose chip has gone burns nothing.
bool is_high(const std::string& file) {
  std::ifstream in(file);
  char level = '0';
  in >> level;
  return level == '1';
}

LightIndex lit_now(const std::array<std::string, 2>& lines, const Orders& orders) {
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (orders.stuck[i] || (!orders.dead[i] && is_high(lines[i]))) {
      return static_cast<LightIndex>(i) + 1;
    }
  }
  return kNoLight;
}

/// Frames of one scene, a few of each light, taken beforehand: rendering takes longer than a frame.
class Album {
 public:
  explicit Album(const StationConfig& config) : config_(config), bench_(config.simulator) {}

  void open(const std::string& scene) {
    if (scene == scene_) return;
    bench_.place(read_scene(scene), config_.camera.seed, part_++);
    for (std::size_t light = 0; light < frames_.size(); ++light) {
      frames_[light].clear();
      if (light > 0) bench_.lights().on(static_cast<LightIndex>(light));
      for (int i = 0; i < kVariants; ++i) {
        bench_.camera().arm({{.exposure_s = config_.camera.bracket_ms.front() * 1e-3}});
        frames_[light].push_back(bench_.camera().next_frame(std::chrono::seconds(10)).counts);
      }
      bench_.lights().all_off();
    }
    scene_ = scene;
  }
  const cv::Mat& next(LightIndex light) {
    return frames_.at(static_cast<std::size_t>(light))[turn_++ % kVariants];
  }

 private:
  static constexpr int kVariants = 3;
  StationConfig config_;
  SimStation bench_;
  std::array<std::vector<cv::Mat>, 3> frames_;
  std::string scene_;
  std::uint64_t part_ = 0;
  std::size_t turn_ = 0;
};

int open_output(const std::string& node, const SensorFormat& sensor) {
  const int fd = ::open(node.c_str(), O_RDWR);
  if (fd < 0) throw std::runtime_error("cannot open " + node);
  v4l2_format format{};
  format.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  format.fmt.pix.width = static_cast<std::uint32_t>(sensor.width);
  format.fmt.pix.height = static_cast<std::uint32_t>(sensor.height);
  format.fmt.pix.pixelformat = V4L2_PIX_FMT_Y16;
  format.fmt.pix.field = V4L2_FIELD_NONE;
  format.fmt.pix.bytesperline = format.fmt.pix.width * 2;
  format.fmt.pix.sizeimage = format.fmt.pix.bytesperline * format.fmt.pix.height;
  if (::ioctl(fd, VIDIOC_S_FMT, &format) != 0) throw std::runtime_error("VIDIOC_S_FMT refused");
  return fd;
}

/// One exposure: what burns at both its ends burned through; a light switched meanwhile is seen in
/// the frame, which therefore is not the other's either.
cv::Mat expose(Album& album, LightIndex at_start, LightIndex at_end) {
  const cv::Mat frame = album.next(at_start);
  if (at_end == at_start) return frame;
  cv::Mat both;
  cv::addWeighted(frame, 0.5, album.next(at_end), 0.5, 0, both);
  return both;
}

void write_frame(int fd, const cv::Mat& frame) {
  const std::size_t bytes = frame.total() * frame.elemSize();
  if (::write(fd, frame.data, bytes) != static_cast<ssize_t>(bytes)) {
    throw std::runtime_error("the loopback takes no frame");
  }
}

/// Whole or not at all, for whoever reads it meanwhile.
void acknowledge(const std::string& orders_file, const std::string& number) {
  const std::string file = orders_file + ".done";
  std::ofstream(file + ".new") << number << '\n';
  std::filesystem::rename(file + ".new", file);
}

void run(const std::array<std::string, 5>& arguments) {
  const StationConfig config = read_station_config(arguments[0]);
  const std::array<std::string, 2> lines{arguments[2], arguments[3]};
  Album album(config);
  const int fd = open_output(arguments[1], config.camera.sensor);
  const std::chrono::duration<double, std::milli> exposure(config.camera.bracket_ms.front());
  std::string obeyed;
  while (true) {
    const Orders orders = read_orders(arguments[4]);
    if (!orders.scene.empty()) album.open(orders.scene);
    const auto begun = std::chrono::steady_clock::now();
    const LightIndex at_start = lit_now(lines, orders);
    std::this_thread::sleep_for(exposure);
    const LightIndex at_end = lit_now(lines, orders);
    const bool muted = orders.mute != kNoLight && at_end == orders.mute;
    if (!orders.silent && !muted) {
      const cv::Mat frame = expose(album, at_start, at_end);
      if (std::chrono::steady_clock::now() - begun > kSlowestFrame) continue;
      write_frame(fd, frame);
    }
    if (obeyed != orders.number) acknowledge(arguments[4], obeyed = orders.number);
  }
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 6) throw std::runtime_error("usage: lab_bench STATION VIDEO LINE1 LINE2 ORDERS");
    run({argv[1], argv[2], argv[3], argv[4], argv[5]});
  } catch (const std::exception& error) {
    fmt::print(stderr, "lab_bench: {}\n", error.what());
    return 2;
  }
}
