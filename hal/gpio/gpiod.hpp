// GPIO lines of a Linux character device. One interface over both generations of libgpiod, which
// share a name and nothing else: 1.6 (Debian 12, gpiod_v1.cpp) and 2.x (Debian 13, gpiod_v2.cpp);
// the build compiles the file that fits the library it found.
//
// Levels are logical: true is active, low where `active_low`. Every failure is a DeviceError that
// names chip, line and call; after one that came from the kernel the object is of no further use.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "hal/device_error.hpp"
#include "hal/gpio/gpio_settings.hpp"

namespace brdfgate {

/// Output lines of one chip, held exclusively until destruction. What a line does when it is let
/// go is the driver's business: most turn it into an input.
class GpioOutputLines {
 public:
  /// All lines are driven inactive. Throws DeviceError when the chip or a line is missing or taken.
  GpioOutputLines(const std::string& chip, const std::vector<GpioOutputLine>& lines,
                  const std::string& consumer);
  ~GpioOutputLines();
  GpioOutputLines(const GpioOutputLines&) = delete;
  GpioOutputLines& operator=(const GpioOutputLines&) = delete;

  std::size_t size() const { return active_low_.size(); }
  /// Drives all lines in one call. Precondition: one value for each line. Throws DeviceError.
  void set(const std::vector<bool>& active);
  /// As the chip sees them: a pad's real level where the hardware can tell. Throws DeviceError.
  std::vector<bool> get();

 private:
  struct Request;
  std::vector<bool> active_low_;
  std::unique_ptr<Request> request_;
};

struct GpioEdgeEvent {
  bool high = false;              ///< the line's level after the edge
  std::int64_t timestamp_ns = 0;  ///< CLOCK_MONOTONIC, taken in the interrupt
};

/// One input line whose edges are queued by the kernel: the configured one, and both where they
/// are to be debounced here.
class GpioEdgeInput {
 public:
  /// Throws DeviceError when the chip or the line is missing or taken, or has no interrupt.
  GpioEdgeInput(const GpioTriggerSettings& settings, const std::string& consumer);
  ~GpioEdgeInput();
  GpioEdgeInput(const GpioEdgeInput&) = delete;
  GpioEdgeInput& operator=(const GpioEdgeInput&) = delete;

  /// True when the kernel filters edges by settings.debounce; otherwise they come as they are.
  bool debounced() const;
  bool high();
  /// The oldest edge; nothing when `timeout` passes first. Throws DeviceError, also when the chip
  /// has gone.
  std::optional<GpioEdgeEvent> wait(std::chrono::nanoseconds timeout);

 private:
  struct Request;
  std::unique_ptr<Request> request_;
};

/// The line's number where the text is one.
std::optional<unsigned> gpio_line_number(const std::string& line);

}  // namespace brdfgate
