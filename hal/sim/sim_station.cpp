#include "hal/sim/sim_station.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <numbers>
#include <string>

#include "hal/sim/bench.hpp"

namespace brdfgate {
namespace {

constexpr const char* kCameraName = "simulated camera";
constexpr const char* kLightsName = "simulated lights";

class SimCamera final : public Camera {
 public:
  explicit SimCamera(SimBench& bench) : bench_(bench) {}

  SensorFormat format() const override { return bench_.settings().sensor; }

  CameraCapabilities capabilities() const override { return {}; }

  void probe() override {}

  void arm(const std::vector<ExposureRequest>& bracket, std::int64_t not_before_ns) override {
    armed_.clear();
    for (const ExposureRequest& request : bracket) {
      if (!std::isfinite(request.exposure_s) || request.exposure_s <= 0) {
        throw DeviceError(kCameraName, "arm", "the exposure must be over 0 s");
      }
      if (!std::isfinite(request.gain) || request.gain <= 0) {
        throw DeviceError(kCameraName, "arm", "the gain must be over 0");
      }
    }
    armed_.assign(bracket.begin(), bracket.end());
    bench_.advance_to(not_before_ns);
  }

  RawFrame next_frame(std::chrono::milliseconds timeout) override {
    if (armed_.empty()) throw DeviceError(kCameraName, "next_frame", "nothing is armed");
    if (!bench_.occupied()) {
      throw DeviceError(kCameraName, "next_frame", "no scene was placed under the camera");
    }
    const ExposureRequest request = armed_.front();
    armed_.pop_front();
    if (bench_.frame_time_s(request.exposure_s) > std::chrono::duration<double>(timeout).count()) {
      armed_.clear();
      throw CameraError(
          CameraFault::no_frame, kCameraName, "next_frame",
          "exposure and readout take longer than " + std::to_string(timeout.count()) + " ms");
    }
    return bench_.expose(request.exposure_s, request.gain);
  }

  void stop() noexcept override { armed_.clear(); }

 private:
  SimBench& bench_;
  std::deque<ExposureRequest> armed_;
};

class SimLights final : public Lights {
 public:
  explicit SimLights(SimBench& bench) : bench_(bench) { bench_.switch_to(kNoLight); }
  ~SimLights() override { bench_.switch_to(kNoLight); }

  int count() const override { return bench_.lights(); }

  void on(LightIndex light) override {
    if (light < 1 || light > count()) {
      throw LightsError(
          kLightsName, "on",
          "there is no light " + std::to_string(light) + ", only 1 to " + std::to_string(count()));
    }
    bench_.switch_to(light);
  }

  void all_off() noexcept override { bench_.switch_to(kNoLight); }

  void verify() override {}

  std::int64_t switched_at_ns() const override { return bench_.switched_at_ns(); }
  std::int64_t settled_at_ns() const override {
    return switched_at_ns() + std::llround(1e9 * bench_.settings().light_settle_s);
  }

 private:
  SimBench& bench_;
};

class SimTrigger final : public Trigger {
 public:
  explicit SimTrigger(TriggerLine& line) : line_(line) {}
  bool wait(std::chrono::milliseconds timeout) override { return line_.wait(timeout); }

 private:
  TriggerLine& line_;
};

}  // namespace

struct SimStation::Bench {
  explicit Bench(const SimBenchSettings& settings) : shared(settings) {}

  SimBench shared;
  SimCamera camera{shared};
  SimLights lights{shared};
  SimTrigger trigger{shared.trigger_line};
  Drawn drawn;
};

StationGeometry deviated(const StationGeometry& nominal, const SimDeviation& deviation) {
  constexpr double kDeg = std::numbers::pi / 180;
  StationGeometry built = nominal;
  built.camera.X_WC.translation() += deviation.camera_m;
  built.camera.X_WC.linear() *=
      (Eigen::AngleAxisd(deviation.camera_deg.z() * kDeg, Eigen::Vector3d::UnitZ()) *
       Eigen::AngleAxisd(deviation.camera_deg.y() * kDeg, Eigen::Vector3d::UnitY()) *
       Eigen::AngleAxisd(deviation.camera_deg.x() * kDeg, Eigen::Vector3d::UnitX()))
          .toRotationMatrix();
  built.camera.focal_px *= 1 + deviation.focal;
  built.camera.centre_px += deviation.centre_px;
  built.camera.distortion = deviation.distortion;
  for (std::size_t l = 0; l < std::min(built.lights_W.size(), deviation.lights_m.size()); ++l)
    built.lights_W[l] += deviation.lights_m[l];
  return built;
}

SimStation::SimStation(const SimBenchSettings& settings)
    : bench_(std::make_unique<Bench>(settings)) {}

SimStation::~SimStation() = default;

void SimStation::place(const Scene& scene, std::uint64_t seed, std::uint64_t index) {
  bench_->shared.place(scene, seed, index);
  bench_->drawn = {bench_->shared.draw().pose, bench_->shared.draw().variation};
}

Camera& SimStation::camera() {
  return bench_->camera;
}
Lights& SimStation::lights() {
  return bench_->lights;
}
Trigger& SimStation::trigger() {
  return bench_->trigger;
}
void SimStation::fire_trigger() {
  bench_->shared.trigger_line.fire();
}
const SimStation::Drawn& SimStation::drawn() const {
  return bench_->drawn;
}

}  // namespace brdfgate
