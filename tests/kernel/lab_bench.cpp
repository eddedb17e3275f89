// A bench in front of a real kernel: looks at the station's two LED lines as the lamps would, and
// feeds a v4l2loopback device or a USB camera with the frames that the simulated part gives under
// them.
//
//   lab_bench STATION VIDEO LINE1 LINE2 ORDERS
//
// STATION: a station file with a simulated camera, whose sensor and rig are the real one's. VIDEO:
// the loopback's node, or usb for a USB camera with exposure and gain controls that is plugged in
// here. LINE1, LINE2: sysfs files that hold 0 or 1. ORDERS: a file read before every frame, one
// order a line:
//   scene FILE   what lies under the camera      dead N     light N stays dark
//   silent       no frames                       stuck N    light N stays on
//   mute N       no frames while light N burns   unplugged  the USB camera is not there
//   number N     of these orders                 deaf       it takes exposures and does not apply
//   them
// ORDERS.done holds the number of the orders that the last frame obeyed.
#include <fmt/core.h>

#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "config/scene_reader.hpp"
#include "config/station_config.hpp"
#include "hal/sim/sim_station.hpp"
#include "kernel/bench_outlet.hpp"

using namespace brdfgate;
using namespace brdfgate::lab;

namespace {

/// A frame that took longer, from looking at the lines to its last byte, is dropped: the loopback
/// stamps it when it is written, and the station takes it for begun one exposure earlier. Shorter
/// than the station's settle time, so that no stall passes one light's frame off as another's.
constexpr std::chrono::milliseconds kSlowestFrame{200};
/// Between two looks at the orders while nobody takes frames. The bench is a machine in real time:
/// exposures last as long as they say.
constexpr std::chrono::milliseconds kIdle{10};

struct Orders {
  std::string scene;
  std::string number;
  bool silent = false;
  bool unplugged = false;
  bool deaf = false;
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
    if (order == "unplugged") orders.unplugged = true;
    if (order == "deaf") orders.deaf = true;
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

/// Frames of one scene, a few of each light and exposure, kept: to render them takes longer than a
/// frame.
class Album {
 public:
  explicit Album(const StationConfig& config) : config_(config), bench_(config.simulator) {}

  void open(const std::string& scene) {
    if (scene == scene_) return;
    bench_.place(read_scene(scene), config_.camera.seed, part_++);
    pages_.clear();
    scene_ = scene;
  }
  const cv::Mat& next(LightIndex light, const ExposureRequest& exposure) {
    std::vector<cv::Mat>& page = pages_[{light, exposure.exposure_s, exposure.gain}];
    if (page.empty()) page = taken(light, exposure);
    return page[turn_++ % kVariants];
  }

 private:
  static constexpr int kVariants = 3;

  std::vector<cv::Mat> taken(LightIndex light, const ExposureRequest& exposure) {
    std::vector<cv::Mat> page;
    if (light != kNoLight) bench_.lights().on(light);
    for (int i = 0; i < kVariants; ++i) {
      bench_.camera().arm({exposure});
      page.push_back(bench_.camera().next_frame(std::chrono::seconds(10)).counts);
    }
    bench_.lights().all_off();
    return page;
  }

  StationConfig config_;
  SimStation bench_;
  std::map<std::tuple<LightIndex, double, double>, std::vector<cv::Mat>> pages_;
  std::string scene_;
  std::uint64_t part_ = 0;
  std::size_t turn_ = 0;
};

std::unique_ptr<Outlet> open_outlet(const std::string& video, const CameraConfig& camera) {
  if (video == "usb") return std::make_unique<UsbOutlet>(camera.sensor);
  return std::make_unique<LoopbackOutlet>(video, camera.sensor, camera.bracket_ms.front() * 1e-3);
}

/// One frame, by what burns at both ends of its exposure; a light switched meanwhile is seen in it,
/// and it is therefore not the other's either. Nothing where the bench was too slow to say.
void expose(Album& album, const std::array<std::string, 2>& lines, const Orders& orders,
            const ExposureRequest& exposure, Outlet& outlet) {
  const auto begun = std::chrono::steady_clock::now();
  const LightIndex at_start = lit_now(lines, orders);
  std::this_thread::sleep_for(std::chrono::duration<double>(exposure.exposure_s));
  const LightIndex at_end = lit_now(lines, orders);
  if (orders.silent || (orders.mute != kNoLight && at_end == orders.mute)) return;
  cv::Mat frame = album.next(at_start, exposure);
  if (at_end != at_start) {
    cv::Mat both;
    cv::addWeighted(frame, 0.5, album.next(at_end, exposure), 0.5, 0, both);
    frame = both;
  }
  if (std::chrono::steady_clock::now() - begun <= kSlowestFrame) outlet.put(frame);
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
  const std::unique_ptr<Outlet> outlet = open_outlet(arguments[1], config.camera);
  std::string obeyed;
  while (true) {
    const Orders orders = read_orders(arguments[4]);
    if (!orders.scene.empty()) album.open(orders.scene);
    outlet->plug(!orders.unplugged);
    outlet->go_deaf(orders.deaf);
    if (const auto exposure = outlet->next_exposure()) {
      expose(album, lines, orders, *exposure, *outlet);
    } else {
      std::this_thread::sleep_for(kIdle);
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
