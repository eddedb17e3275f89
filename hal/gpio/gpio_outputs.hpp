// The pass, reject and busy lines of a machine without a PLC.
#pragma once

#include <memory>

#include "hal/gpio/gpiod.hpp"

namespace brdfgate {

/// What the lines say when nothing can be said.
inline constexpr GpioOutputState kFailSafeOutputs{};

/// Fail-safe from construction on and after destruction as far as the driver keeps levels; wire the
/// lines so that an unpowered board says the same.
class GpioOutputs {
 public:
  /// Throws DeviceError.
  explicit GpioOutputs(const GpioOutputsSettings& settings);
  ~GpioOutputs();
  GpioOutputs(const GpioOutputs&) = delete;
  GpioOutputs& operator=(const GpioOutputs&) = delete;

  /// All lines in one call. Throws DeviceError.
  void set(const GpioOutputState& state);

 private:
  GpioOutputsSettings settings_;
  std::unique_ptr<GpioOutputLines> lines_;
};

}  // namespace brdfgate
