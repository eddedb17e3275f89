// The lines of the machine beside the PLC: a trigger input and the verdict's outputs. Both survive
// a chip that goes and comes back.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "app/fault_log.hpp"
#include "hal/gpio/gpio_outputs.hpp"
#include "hal/trigger.hpp"

namespace brdfgate {

/// Waits for edges on a thread of its own. While the line cannot be had or read it asks for it
/// anew, once a second.
class TriggerWatch {
 public:
  using Open = std::function<std::unique_ptr<Trigger>()>;
  struct Told {
    std::function<void()> fired;          ///< an edge that counts
    std::function<void(bool lost)> lost;  ///< the line was lost, or is back; only when it changes
  };
  /// Both are called on the watch's thread. `open` throws DeviceError.
  TriggerWatch(Open open, Told told);

 private:
  void run(const std::stop_token& stop);
  bool take_line();

  Open open_;
  Told told_;
  FaultLog faults_;
  std::unique_ptr<Trigger> trigger_;
  bool lost_ = false;
  std::jthread thread_;
};

/// Shows what it is told on the lines. A failure is logged, and the lines are asked for anew with
/// the first show() a second later. For one thread at a time.
class VerdictLines {
 public:
  explicit VerdictLines(GpioOutputsSettings settings);
  void show(const GpioOutputState& state) noexcept;

 private:
  GpioOutputsSettings settings_;
  std::unique_ptr<GpioOutputs> lines_;
  std::optional<GpioOutputState> shown_;
  std::chrono::steady_clock::time_point retry_at_{};
  FaultLog faults_;
};

}  // namespace brdfgate
