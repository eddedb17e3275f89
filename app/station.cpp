#include "app/station.hpp"

#include <cmath>
#include <set>
#include <span>

#include "app/open_camera.hpp"
#include "config/scene_reader.hpp"
#include "hal/gpio/gpio_lights.hpp"
#include "hal/sim/sim_station.hpp"
#include "model/bracket_check.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

class SimulatedBench final : public Station {
 public:
  explicit SimulatedBench(const StationConfig& config)
      : Station(config.lights.mode),
        scenes_(config.camera.scenes),
        seed_(config.camera.seed),
        bench_(config.simulator) {}

  Camera& camera() override { return bench_.camera(); }
  Lights& lights() override { return bench_.lights(); }
  bool simulated() const override { return true; }

  void check() override { bench_.camera().probe(); }

  void next_part(std::uint32_t trigger_id) override {
    check();
    const bool named = trigger_id >= 1 && trigger_id <= scenes_.size();
    const std::size_t scene = named ? trigger_id - 1 : turn_++ % scenes_.size();
    bench_.place(read_scene(scenes_[scene]), seed_, part_++);
  }

 private:
  std::vector<std::filesystem::path> scenes_;
  std::uint64_t seed_;
  SimStation bench_;
  std::uint64_t part_ = 0;
  std::size_t turn_ = 0;
};

class HardwareStation final : public Station {
 public:
  explicit HardwareStation(const StationConfig& config)
      : Station(config.lights.mode),
        lights_(config.lights.gpio),
        camera_(open_camera(config.camera)) {}

  Camera& camera() override { return *camera_; }
  Lights& lights() override { return lights_; }
  bool simulated() const override { return false; }

  void check() override {
    lights_.verify();
    camera_->probe();
  }

  void next_part(std::uint32_t /*trigger_id*/) override { check(); }

 private:
  GpioLights lights_;
  std::unique_ptr<Camera> camera_;
};

/// Light 1 and light 2; a ring of more has other uses.
constexpr LightIndex kMeasuringLights = 2;

void capture_bracket(Station& station, LightIndex light, const std::vector<double>& exposures_ms,
                     const CameraConfig& config, Capture& into) {
  std::vector<ExposureRequest> bracket;
  bracket.reserve(exposures_ms.size());
  for (const double ms : exposures_ms)
    bracket.push_back({ms * 1e-3, config.gain});
  station.camera().arm(bracket, station.lights().settled_at_ns());
  const std::chrono::milliseconds timeout(static_cast<long>(config.frame_timeout_ms));
  for (std::size_t i = 0; i < bracket.size(); ++i) {
    RawFrame frame = station.camera().next_frame(timeout);
    frame.light = light;
    into.frames.push_back(std::move(frame));
  }
}

/// Throws where what was captured since frame `first` cannot be of one scene.
void check_bracket(const Capture& capture, std::size_t first, const CameraConfig& config) {
  const auto contradiction = bracket_contradiction(std::span(capture.frames).subspan(first),
                                                   capture.sensor, !config.tone_curve);
  if (contradiction) {
    throw CameraError(CameraFault::implausible, "camera", "bracket", *contradiction);
  }
}

void capture_lit(Station& station, LightIndex light, const std::vector<double>& exposures_ms,
                 const CameraConfig& config, Capture& into) {
  station.lights().on(light);
  capture_bracket(station, light, exposures_ms, config, into);
  station.lights().verify();
}

void capture_light(Station& station, LightIndex light, const CameraConfig& config, Capture& into) {
  const std::size_t first = into.frames.size();
  if (station.lights_mode() == LightsMode::steady) {
    capture_lit(station, light, config.bracket_ms, config, into);
  } else {
    for (const double ms : config.bracket_ms) {
      capture_lit(station, light, {ms}, config, into);
      station.lights().all_off();
    }
  }
  check_bracket(into, first, config);
}

}  // namespace

std::unique_ptr<Station> open_station(const StationConfig& config) {
  switch (config.camera.backend) {
    case CameraBackend::simulated:
      return std::make_unique<SimulatedBench>(config);
    case CameraBackend::v4l2:
    case CameraBackend::libcamera:
      return std::make_unique<HardwareStation>(config);
  }
  throw InputError("camera.backend", "unknown backend", "simulated, v4l2 or libcamera");
}

Capture capture_part(Station& station, const CameraConfig& config,
                     const std::function<void()>& acquired) {
  const LightsOffAtExit off(station.lights());
  station.lights().all_off();
  Capture capture{station.camera().format(), {}};
  capture_bracket(station, kNoLight, config.ambient_ms, config, capture);
  check_bracket(capture, 0, config);
  for (LightIndex light = kMeasuringLights; light >= 1; --light)
    capture_light(station, light, config, capture);
  station.lights().all_off();
  if (acquired) acquired();
  return capture;
}

namespace {

/// Whether the middle of the image is saturated in this exposure.
bool saturates(Station& station, const CameraConfig& config, double exposure_s) {
  const SensorFormat sensor = station.camera().format();
  Capture taken;
  capture_lit(station, kMeasuringLights, {exposure_s * 1e3}, config, taken);
  station.lights().all_off();
  const cv::Mat& counts = taken.frames.front().counts;
  const cv::Rect middle(counts.cols * 3 / 8, counts.rows * 3 / 8, counts.cols / 4, counts.rows / 4);
  constexpr double kSaturated = 0.98;  // of the range; noise keeps some pixels under it
  return cv::mean(counts(middle))[0] - sensor.black_level_dn >
         kSaturated * (sensor.full_well_dn - sensor.black_level_dn);
}

/// The exposure in which the middle of the image saturates: doubled until it does, then halved in,
/// to within a tenth; the longest that the timeout allows where it never does.
double saturating_exposure_s(Station& station, const CameraConfig& config) {
  const double longest = 0.9e-3 * config.frame_timeout_ms;
  double under = 1e-3 * config.bracket_ms.front();
  while (!saturates(station, config, std::min(2 * under, longest))) {
    if (2 * under >= longest) return longest;
    under *= 2;
  }
  double over = std::min(2 * under, longest);
  for (int i = 0; i < 3; ++i) {
    const double between = std::sqrt(under * over);
    (saturates(station, config, between) ? over : under) = between;
  }
  return over;
}

std::vector<double> sweep_exposures_ms(double saturating_s, double longest_s, int points) {
  std::vector<double> out;
  const double top = std::min(1.3 * saturating_s, longest_s);
  const int rising = points / 2;
  for (int i = 0; i < rising; ++i)
    out.push_back(1e3 * top / 500 * std::pow(500.0 / 8, double(i) / rising));
  for (int i = 0; i < points - rising; ++i)
    out.push_back(1e3 * top * (1.0 / 8 + 7.0 / 8 * i / (points - rising - 1)));
  return out;
}

}  // namespace

Capture capture_sweep(Station& station, const CameraConfig& config, int points) {
  const LightsOffAtExit off(station.lights());
  const double longest = 0.9e-3 * config.frame_timeout_ms;
  const std::vector<double> exposures_ms =
      sweep_exposures_ms(saturating_exposure_s(station, config), longest, points);
  Capture capture{station.camera().format(), {}};
  for (const double ms : exposures_ms) {
    capture_lit(station, kMeasuringLights, {ms, ms}, config, capture);
    station.lights().all_off();  // no LED burns longer than it takes
  }
  capture_bracket(station, kNoLight, {exposures_ms.front(), exposures_ms.front()}, config, capture);
  return capture;
}

Capture capture_dark(Station& station, const CameraConfig& config) {
  station.lights().all_off();
  Capture capture{station.camera().format(), {}};
  std::set<double> exposures(config.bracket_ms.begin(), config.bracket_ms.end());
  exposures.insert(config.ambient_ms.begin(), config.ambient_ms.end());
  capture_bracket(station, kNoLight, {exposures.begin(), exposures.end()}, config, capture);
  return capture;
}

}  // namespace brdfgate
