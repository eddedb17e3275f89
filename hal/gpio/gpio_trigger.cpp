#include "hal/gpio/gpio_trigger.hpp"

#include <algorithm>

#include "hal/monotonic.hpp"

namespace brdfgate {
namespace {

std::int64_t software_period_ns(const GpioTriggerSettings& settings, const GpioEdgeInput& input) {
  return input.debounced() ? 0 : std::chrono::nanoseconds(settings.debounce).count();
}

}  // namespace

GpioTrigger::GpioTrigger(const GpioTriggerSettings& settings)
    : edge_(settings.edge),
      input_(settings, "brdfgate trigger"),
      every_edge_counts_(software_period_ns(settings, input_) == 0),
      debouncer_(software_period_ns(settings, input_), is_active(input_.high())) {}

bool GpioTrigger::wait(std::chrono::milliseconds timeout) {
  const std::int64_t deadline = monotonic_ns() + std::chrono::nanoseconds(timeout).count();
  while (true) {
    if (debouncer_.take()) return true;
    const std::int64_t now = monotonic_ns();
    const std::int64_t until = std::min(deadline, debouncer_.decided_at_ns().value_or(deadline));
    if (const auto event = input_.wait(std::chrono::nanoseconds(until - now))) {
      if (every_edge_counts_) return true;
      debouncer_.edge(is_active(event->high), event->timestamp_ns);
    } else {
      debouncer_.no_edge_until(std::max(now, until));
      if (until >= deadline) return debouncer_.take();
    }
  }
}

}  // namespace brdfgate
