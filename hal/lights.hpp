// The lights of the station. Dark is the safe state.
#pragma once

#include <cstdint>

#include "hal/device_error.hpp"
#include "model/frame.hpp"

namespace brdfgate {

/// A light could not be switched, or does not do what it was told.
class LightsError : public DeviceError {
 public:
  using DeviceError::DeviceError;
};

/// All lights are off after construction, after destruction and on any exit between.
class Lights {
 public:
  Lights() = default;
  Lights(const Lights&) = delete;
  Lights& operator=(const Lights&) = delete;
  virtual ~Lights() = default;

  /// How many there are; they are numbered from 1.
  virtual int count() const = 0;
  /// Switches this one on and every other off. Throws LightsError for one that does not exist, or
  /// when the device fails; then all are off as far as they can be.
  virtual void on(LightIndex light) = 0;
  virtual void all_off() noexcept = 0;

  /// Call it when the frames are in: throws LightsError when the lights do not stand as they were
  /// switched last, because the limit on burning time cut them or the device says otherwise.
  virtual void verify() = 0;

  /// When the lights last changed, ns on the clock of the frames' timestamps: CLOCK_MONOTONIC, the
  /// bench's own where camera and lights are simulated. Switching what stands already changes
  /// nothing. Call it on the thread that switches.
  virtual std::int64_t switched_at_ns() const = 0;
  /// A frame shows what is switched now, and nothing of what was before, if its exposure began at
  /// this time or later: switched_at_ns() and the configured settle time. Same clock and thread.
  virtual std::int64_t settled_at_ns() const = 0;
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
