// The devices of a configured station, and the sequence of exposures that captures one part.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "config/station_config.hpp"
#include "hal/camera.hpp"
#include "hal/lights.hpp"

namespace brdfgate {

/// Camera and lights as configured. On hardware the part is simply there; on the simulated bench
/// someone has to put it there first.
class Station {
 public:
  explicit Station(LightsMode mode) : lights_mode_(mode) {}
  Station(const Station&) = delete;
  Station& operator=(const Station&) = delete;
  virtual ~Station() = default;

  virtual Camera& camera() = 0;
  virtual Lights& lights() = 0;
  LightsMode lights_mode() const { return lights_mode_; }
  virtual bool simulated() const = 0;
  /// Throws DeviceError when camera or lights cannot be used now; what was away and is back is
  /// taken into use again. Cheap while nothing is wrong; not during a capture.
  virtual void check() = 0;
  /// Called before every capture; check()s. Simulated: reads the scene anew and places the
  /// next part of it: scene number `trigger_id` for 1..n, for any other id the scenes in turn.
  /// Throws InputError for an unusable scene file.
  virtual void next_part(std::uint32_t trigger_id) = 0;

 private:
  LightsMode lights_mode_;
};

/// Real devices that are away are no error yet: check() tells. Throws InputError for a backend
/// that these programs were built without.
std::unique_ptr<Station> open_station(const StationConfig& config);

/// The bracket under each of the two measuring lights and the exposures without light, lights off
/// before and after, whatever happens. A frame counts only if its exposure began once what it is
/// taken under had settled. `acquired` is called when the last frame is in. Throws DeviceError.
Capture capture_part(Station& station, const CameraConfig& config,
                     const std::function<void()>& acquired = {});

/// A photon-transfer sweep of a steady scene under light 2: two equal frames of each of
/// `points` exposures, half of them rising by a factor, half evenly up to 1.3 times the exposure
/// that saturates the middle of the image, which is searched for first (up to the frame timeout);
/// and one pair without light.
Capture capture_sweep(Station& station, const CameraConfig& config, int points);

/// Every configured exposure with all lights off: a dark recording.
Capture capture_dark(Station& station, const CameraConfig& config);

}  // namespace brdfgate
