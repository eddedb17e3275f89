// Lights on GPIO lines.
#pragma once

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>

#include "hal/gpio/gpiod.hpp"
#include "hal/lights.hpp"

namespace brdfgate {

/// Light n burns on the n-th line. No light burns longer than the settings' max_on at a stretch: a
/// thread of its own switches it off then, and verify() reports it. What a hung or killed process
/// cannot do is left to the service manager (`brdfgate lights --off`) and to the wiring
/// (docs/hardware.md).
///
/// A chip or line that cannot be had, or fails later, throws where it is switched; the next on()
/// asks for it anew. Thread-safe against its own watch only: one thread switches.
class GpioLights final : public Lights {
 public:
  /// Takes the lines, all off. Lines that cannot be had now are an error of verify() and on().
  explicit GpioLights(const GpioLightsSettings& settings);
  ~GpioLights() override;

  int count() const override { return static_cast<int>(settings_.lines.size()); }
  void on(LightIndex light) override;
  void all_off() noexcept override;
  /// Compares the lines' levels with what was switched.
  void verify() override;
  std::int64_t switched_at_ns() const override { return switched_ns_; }
  std::int64_t settled_at_ns() const override { return switched_ns_ + settings_.settle.count(); }

 private:
  void take_lines();
  void drive(LightIndex light);
  void give_up() noexcept;
  void watch(const std::stop_token& stop);

  const GpioLightsSettings settings_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::unique_ptr<GpioOutputLines> lines_;  ///< none: the next on() takes them
  LightIndex burning_ = kNoLight;
  LightIndex cut_ = kNoLight;  ///< the light that was cut since it was switched on
  std::chrono::steady_clock::time_point burning_until_{};
  std::atomic<std::int64_t> switched_ns_{0};
  std::jthread watch_;
};

}  // namespace brdfgate
