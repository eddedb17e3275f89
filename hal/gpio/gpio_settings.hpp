// How the station hangs on GPIO lines: plain data, ranges as the station file's.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

namespace brdfgate {

// A chip is named by its path (/dev/gpiochip0), its name (gpiochip0) or its label
// (pinctrl-bcm2711); a line by its name (GPIO17), or by its number on the chip where the text is a
// number.

struct GpioLightsSettings {
  std::string chip;                ///< empty: there is none, the lights are simulated
  std::vector<std::string> lines;  ///< light 1, light 2, then whatever else is lit; no line twice
  bool active_low = false;         ///< a light burns when its line is low
  std::chrono::nanoseconds settle{0};       ///< from switching until frames may count, 0..10 s
  std::chrono::milliseconds max_on{10000};  ///< no light burns longer at a stretch, 1 ms..10 min
};

enum class GpioEdge { rising, falling };
enum class GpioBias { as_is, none, pull_up, pull_down };

struct GpioTriggerSettings {
  std::string chip;
  std::string line;
  GpioEdge edge = GpioEdge::rising;
  GpioBias bias = GpioBias::as_is;
  std::chrono::microseconds debounce{0};  ///< a level must stand so long to count, 0..1 s
};

struct GpioOutputLine {
  std::string line;
  bool active_low = false;
};

/// Lines for a machine without a PLC; those not given are not driven.
struct GpioOutputsSettings {
  std::string chip;
  std::optional<GpioOutputLine> pass;    ///< active while a result stands that passed
  std::optional<GpioOutputLine> reject;  ///< active while one stands that did not, and on a fault
  std::optional<GpioOutputLine> busy;    ///< active while no trigger would be taken
};

/// What those lines say. As constructed it is what they say when nothing can be said: no pass, out
/// with the part, no trigger taken.
struct GpioOutputState {
  bool pass = false;
  bool reject = true;
  bool busy = true;
  bool operator==(const GpioOutputState&) const = default;
};

}  // namespace brdfgate
