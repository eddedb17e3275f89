// The lights of the station. Dark is the safe state.
#pragma once

#include "model/frame.hpp"

namespace brdfgate {

/// All lights are off after construction, after destruction and on any exit between.
class Lights {
 public:
  Lights() = default;
  Lights(const Lights&) = delete;
  Lights& operator=(const Lights&) = delete;
  virtual ~Lights() = default;

  /// How many there are; they are numbered from 1.
  virtual int count() const = 0;
  /// Switches this one on and every other off. Throws DeviceError for one that does not exist.
  virtual void on(LightIndex light) = 0;
  virtual void all_off() noexcept = 0;
};

/// Switches the lights off when a scope is left, however that happens.
class LightsOffAtExit {
 public:
  explicit LightsOffAtExit(Lights& lights) : lights_(lights) {}
  LightsOffAtExit(const LightsOffAtExit&) = delete;
  LightsOffAtExit& operator=(const LightsOffAtExit&) = delete;
  ~LightsOffAtExit() { lights_.all_off(); }

 private:
  Lights& lights_;
};

}  // namespace brdfgate
