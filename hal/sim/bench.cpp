#include "hal/sim/bench.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "hal/sim/random.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr std::uint64_t kNoiseStream = 0x6e6f697365;
/// Share of a light's steady output that no frame tells from nothing: under a count in 16 bits.
constexpr double kGlowsNoMore = 1e-6;

void require(bool right, const std::string& field, double seen, const std::string& expected) {
  if (!right) throw InputError(field, "is " + std::to_string(seen), expected);
}

void check_sensor(const SensorFormat& s, const SensorNoise& n) {
  require(s.width > 0 && s.width % 2 == 0, "camera.sensor.width", s.width, "even and over 0");
  require(s.height > 0 && s.height % 2 == 0, "camera.sensor.height", s.height, "even and over 0");
  require(s.bits >= 8 && s.bits <= 16, "camera.sensor.bits", s.bits, "8 to 16");
  require(s.black_level_dn >= 0, "camera.sensor.black_level_dn", s.black_level_dn, "at least 0");
  require(s.full_well_dn > s.black_level_dn, "camera.sensor.full_well_dn", s.full_well_dn,
          "over the black level");
  require(n.gain_dn_per_e > 0, "camera.sensor.gain_dn_per_electron", n.gain_dn_per_e, "over 0");
  require(n.read_noise_dn >= 0, "camera.sensor.read_noise_dn", n.read_noise_dn, "at least 0");
}

void check_settings(const SimBenchSettings& s) {
  check_sensor(s.sensor, s.noise);
  require(s.full_well_e > 0, "simulator.full_well_e", s.full_well_e, "over 0");
  require(s.dark_current_e_s >= 0, "simulator.dark_current_e_s", s.dark_current_e_s, "at least 0");
  require(s.line_time_s > 0, "simulator.line_time_us", s.line_time_s * 1e6, "over 0");
  require(s.vignetting >= 0 && s.vignetting < 1, "simulator.vignetting", s.vignetting,
          "at least 0, under 1");
  require(s.led_radius_m >= 0, "simulator.led_radius_mm", s.led_radius_m * 1e3, "at least 0");
  require(s.light_rise_s >= 0, "simulator.light_rise_ms", s.light_rise_s * 1e3, "at least 0");
  require(s.light_settle_s >= 0, "lights.settle_ms", s.light_settle_s * 1e3, "at least 0");
  require(s.gamma > 0, "simulator.gamma", s.gamma, "over 0");
  require(s.white_exposure_s > 0, "simulator.white_exposure_ms", s.white_exposure_s * 1e3,
          "over 0");
  require(s.geometry.camera.focal_px > 0, "rig.camera: focal length in pixels",
          s.geometry.camera.focal_px, "over 0");
  require(!s.geometry.lights_W.empty(), "rig.lights: number", 0, "at least one");
  for (const Eigen::Vector3d& light : s.geometry.lights_W) {
    require(light.z() > 0, "rig.lights: height over the plane in m", light.z(), "over 0");
  }
}

std::vector<double> intensities(const Scene& scene, int lights) {
  std::vector<double> relative(static_cast<std::size_t>(lights), 1.0);
  for (std::size_t i = 0; i < std::min(relative.size(), scene.light.drift.size()); ++i) {
    relative[i] += scene.light.drift[i];
    require(relative[i] >= 0, "scene.light.drift", scene.light.drift[i], "at least -1");
  }
  return relative;
}

}  // namespace

void TriggerLine::fire() {
  {
    const std::lock_guard lock(mutex_);
    ++edges_;
  }
  fired_.notify_one();
}

bool TriggerLine::wait(std::chrono::milliseconds timeout) {
  std::unique_lock lock(mutex_);
  if (!fired_.wait_for(lock, timeout, [this] { return edges_ > 0; })) return false;
  --edges_;
  return true;
}

SimBench::SimBench(const SimBenchSettings& settings)
    : settings_(settings), optics_(settings_), sensor_(settings_) {
  check_settings(settings_);
  level_at_switch_.resize(static_cast<std::size_t>(lights()));
}

double SimBench::level_now(std::size_t light) const {
  const double target = static_cast<LightIndex>(light) + 1 == burning_ ? 1 : 0;
  if (settings_.light_rise_s <= 0) return target;
  const double since_s = 1e-9 * static_cast<double>(clock_ns_ - switched_ns_);
  return target + (level_at_switch_[light] - target) * std::exp(-since_s / settings_.light_rise_s);
}

double SimBench::mean_level(std::size_t light, double exposure_s) const {
  const double target = static_cast<LightIndex>(light) + 1 == burning_ ? 1 : 0;
  const double tau = settings_.light_rise_s;
  if (tau <= 0) return target;
  // The mean of an exponential over the exposure.
  return target + (level_now(light) - target) * tau / exposure_s * -std::expm1(-exposure_s / tau);
}

void SimBench::switch_to(LightIndex light) {
  if (light == burning_) return;
  std::vector<double> levels;
  for (std::size_t i = 0; i < level_at_switch_.size(); ++i)
    levels.push_back(level_now(i));
  level_at_switch_ = std::move(levels);
  burning_ = light;
  switched_ns_ = clock_ns_;
}

void SimBench::place(const Scene& scene, std::uint64_t seed, std::uint64_t index) {
  require(scene.light.ambient >= 0, "scene.light.ambient", scene.light.ambient, "at least 0");
  require(scene.sensor.defocus_px >= 0, "scene.sensor.defocus_px", scene.sensor.defocus_px,
          "at least 0");
  const PartDraw draw = draw_part(scene, seed, index);
  Placed placed{.surface = PartSurface(scene, draw.variation),
                .X_WP = part_pose(draw.pose),
                .draw = draw,
                .lights_on = scene.lights_on,
                .intensity = intensities(scene, lights()),
                .ambient = scene.light.ambient,
                .defocus_px = scene.sensor.defocus_px,
                .noise = scene.sensor.noise,
                .seed = derive_seed(derive_seed(seed, index), kNoiseStream)};
  if (placed.ambient > 0) {
    const Eigen::Vector3d to_camera = settings_.geometry.camera.position().normalized();
    placed.surface.prepare_ambient(std::acos(std::clamp(to_camera.z(), -1.0, 1.0)));
  }
  placed.rate_e_s.resize(static_cast<std::size_t>(lights()) + 1);
  placed_ = std::make_unique<Placed>(std::move(placed));
}

double SimBench::frame_time_s(double asked_s) const {
  return sensor_.applied_exposure_s(asked_s) + sensor_.readout_s();
}

RawFrame SimBench::expose(double asked_s, double gain) {
  RawFrame frame;
  frame.exposure_s = sensor_.applied_exposure_s(asked_s);
  frame.gain = gain;
  frame.timestamp_ns = clock_ns_;
  frame.counts = sensor_.expose(rate_now(frame.exposure_s),
                                {.exposure_s = frame.exposure_s,
                                 .gain = gain,
                                 .noise = placed_->noise,
                                 .noise_seed = derive_seed(placed_->seed, placed_->frames)});
  ++placed_->frames;
  clock_ns_ += std::llround(1e9 * frame_time_s(asked_s));
  return frame;
}

cv::Mat SimBench::rate_now(double exposure_s) {
  if (!placed_->lights_on) return rate_image(kNoLight);
  cv::Mat total;
  for (std::size_t i = 0; i < level_at_switch_.size(); ++i) {
    const double level = mean_level(i, exposure_s);
    if (level < kGlowsNoMore) continue;
    const cv::Mat& lit = rate_image(static_cast<LightIndex>(i) + 1);
    if (level > 1 - kGlowsNoMore) return lit;
    if (total.empty()) total = rate_image(kNoLight).clone();
    cv::scaleAdd(lit - rate_image(kNoLight), level, total, total);
  }
  return total.empty() ? rate_image(kNoLight) : total;
}

const cv::Mat& SimBench::rate_image(LightIndex light) {
  cv::Mat& image = placed_->rate_e_s[static_cast<std::size_t>(light)];
  if (image.empty()) image = render(light);
  return image;
}

cv::Mat SimBench::render(LightIndex light) {
  if (light == kNoLight) {
    if (placed_->ambient <= 0) {
      return cv::Mat::zeros(settings_.sensor.height, settings_.sensor.width, CV_32FC1);
    }
    cv::Mat ambient = optics_.render_ambient(placed_->surface, placed_->X_WP, placed_->ambient);
    defocus(ambient, settings_.sensor.mosaic, placed_->defocus_px);
    return ambient;
  }
  cv::Mat lit = optics_.render_light(placed_->surface, placed_->X_WP, light);
  lit *= placed_->intensity[static_cast<std::size_t>(light - 1)];
  defocus(lit, settings_.sensor.mosaic, placed_->defocus_px);
  if (placed_->ambient > 0) lit += rate_image(kNoLight);
  return lit;
}

}  // namespace brdfgate
