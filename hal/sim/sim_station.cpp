#include "hal/sim/sim_station.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "hal/sim/bench.hpp"
#include "hal/sim/sim_camera.hpp"

namespace brdfgate {
namespace {

constexpr const char* kLightsName = "simulated lights";

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
