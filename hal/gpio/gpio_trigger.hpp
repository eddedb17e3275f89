// The trigger on a GPIO line.
#pragma once

#include "hal/gpio/debounce.hpp"
#include "hal/gpio/gpiod.hpp"
#include "hal/trigger.hpp"

namespace brdfgate {

/// Debounced by the kernel where library and driver can, else by the edges' times. Edges that come
/// between two waits are queued (the kernel keeps 16). For one thread.
class GpioTrigger final : public Trigger {
 public:
  /// Throws DeviceError.
  explicit GpioTrigger(const GpioTriggerSettings& settings);

  bool wait(std::chrono::milliseconds timeout) override;

 private:
  bool is_active(bool high) const { return high == (edge_ == GpioEdge::rising); }

  GpioEdge edge_;
  GpioEdgeInput input_;
  bool every_edge_counts_;
  EdgeDebouncer debouncer_;
};

}  // namespace brdfgate
