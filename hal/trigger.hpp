// What starts an inspection other than the PLC's trigger bit: a line on the machine.
#pragma once

#include <chrono>

namespace brdfgate {

class Trigger {
 public:
  Trigger() = default;
  Trigger(const Trigger&) = delete;
  Trigger& operator=(const Trigger&) = delete;
  virtual ~Trigger() = default;
  /// True when an edge came before `timeout` passed, false otherwise. Throws DeviceError.
  virtual bool wait(std::chrono::milliseconds timeout) = 0;
};

}  // namespace brdfgate
