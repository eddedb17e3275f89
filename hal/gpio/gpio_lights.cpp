#include "hal/gpio/gpio_lights.hpp"

#include "hal/monotonic.hpp"

namespace brdfgate {
namespace {

constexpr const char* kConsumer = "brdfgate lights";

std::vector<GpioOutputLine> output_lines(const GpioLightsSettings& settings) {
  std::vector<GpioOutputLine> lines;
  for (const std::string& line : settings.lines)
    lines.push_back({line, settings.active_low});
  return lines;
}

}  // namespace

GpioLights::GpioLights(const GpioLightsSettings& settings) : settings_(settings) {
  try {
    take_lines();
  } catch (const LightsError&) {
    // verify() and on() ask again and tell
  }
  watch_ = std::jthread([this](const std::stop_token& stop) { watch(stop); });
}

GpioLights::~GpioLights() {
  watch_.request_stop();
  watch_.join();
  all_off();
}

void GpioLights::take_lines() {
  if (lines_) return;
  try {
    lines_ = std::make_unique<GpioOutputLines>(settings_.chip, output_lines(settings_), kConsumer);
  } catch (const DeviceError& error) {
    throw LightsError("lights", "open", error.what());
  }
}

/// With the lock held.
void GpioLights::drive(LightIndex light) {
  std::vector<bool> levels(settings_.lines.size(), false);
  if (light != kNoLight) levels[static_cast<std::size_t>(light - 1)] = true;
  try {
    lines_->set(levels);
  } catch (const DeviceError& error) {
    give_up();
    throw LightsError("lights", light == kNoLight ? "off" : "on", error.what());
  }
  if (light != burning_) switched_ns_ = monotonic_ns();
  burning_ = light;
}

/// Lets go of the lines: what the chip no longer takes, the wiring's pull-downs keep dark.
void GpioLights::give_up() noexcept {
  lines_.reset();
  if (burning_ != kNoLight) switched_ns_ = monotonic_ns();
  burning_ = kNoLight;
}

void GpioLights::on(LightIndex light) {
  const std::lock_guard lock(mutex_);
  if (light < 1 || light > count()) {
    throw LightsError(
        "lights", "on",
        "there is no light " + std::to_string(light) + ", only 1 to " + std::to_string(count()));
  }
  if (light == burning_) return;  // its time goes on
  cut_ = kNoLight;
  take_lines();
  drive(light);
  burning_until_ = std::chrono::steady_clock::now() + settings_.max_on;
  changed_.notify_all();
}

void GpioLights::all_off() noexcept {
  const std::lock_guard lock(mutex_);
  cut_ = kNoLight;
  if (!lines_) return;
  try {
    drive(kNoLight);
  } catch (const LightsError&) {
    // drive() let go of the lines; the next on() says what is wrong
  }
}

void GpioLights::verify() {
  const std::lock_guard lock(mutex_);
  if (cut_ != kNoLight) {
    throw LightsError("lights", "watch",
                      "light " + std::to_string(cut_) + " was switched off after " +
                          std::to_string(settings_.max_on.count()) + " ms (lights.max_on_ms)");
  }
  std::vector<bool> seen;
  try {
    take_lines();
    seen = lines_->get();
  } catch (const DeviceError& error) {
    give_up();
    throw LightsError("lights", "verify", error.what());
  }
  for (int light = 1; light <= count(); ++light) {
    if (seen[static_cast<std::size_t>(light - 1)] == (light == burning_)) continue;
    drive(kNoLight);
    throw LightsError("lights", "verify",
                      settings_.chip + " line " +
                          settings_.lines[static_cast<std::size_t>(light - 1)] +
                          " does not have the level it was set to: is it shorted?");
  }
}

void GpioLights::watch(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (!stop.stop_requested()) {
    changed_.wait(lock, stop, [this] { return burning_ != kNoLight; });
    const auto until = burning_until_;
    const LightIndex light = burning_;
    const bool changed = changed_.wait_until(
        lock, stop, until, [&] { return burning_ != light || burning_until_ != until; });
    if (stop.stop_requested() || changed || light == kNoLight) continue;
    cut_ = light;
    try {
      drive(kNoLight);
    } catch (const LightsError&) {
      // drive() let go of the lines
    }
  }
}

}  // namespace brdfgate
