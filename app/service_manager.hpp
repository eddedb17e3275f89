// What a service manager (systemd) is told: that the service is up, and that it still works.
#pragma once

#include <chrono>
#include <cstdint>

namespace brdfgate {

/// The station serves. Without a service manager nothing happens.
void notify_ready();
void notify_stopping();

/// Feeds the service manager's watchdog for as long as the inspections get on: a process that
/// hangs, with a light on perhaps, is then killed, and the unit's ExecStopPost switches the lights
/// off. Without a watchdog nothing happens.
class ServiceWatchdog {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// No inspection takes so long, on the slowest board and with every frame at its time-out. What a
  /// light may burn meanwhile is bounded by lights.max_on_ms.
  static constexpr std::chrono::seconds kStuck{60};

  /// `progress` is any number that changes whenever the inspections' thread gets on. Call it
  /// several times a second. False: the thread is stuck, the watchdog starves.
  bool alive(Time now, std::uint64_t progress);

 private:
  std::uint64_t progress_ = 0;
  Time moved_{};
  Time fed_{};
};

}  // namespace brdfgate
