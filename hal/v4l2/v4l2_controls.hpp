// Exposure and gain as V4L2 controls: found on the video node or the sensor's own, in the units
// and ranges that the driver gives.
#pragma once

#include <linux/v4l2-controls.h>

#include <memory>
#include <optional>

#include "hal/frame_matcher.hpp"
#include "hal/v4l2/v4l2_device.hpp"

namespace brdfgate {

class V4l2Controls {
 public:
  /// Finds the controls and turns every automatism off (exposure, gain, white balance). Throws
  /// CameraError for a unit that nobody knows, and for an exposure control that the configuration
  /// denies or misses.
  V4l2Controls(const V4l2Node& video, const CameraDeviceSettings& settings,
               const SensorFormat& sensor);

  CameraCapabilities capabilities() const;
  /// The exposure that one step of the control changes; 0 where the exposure is fixed.
  double exposure_unit_s() const { return exposure_ ? exposure_unit_s_ : 0; }
  /// One row's period where it is known, else 0.
  double line_time_s() const { return line_time_s_; }
  /// What the device makes of a request: rounded to its units. Throws CameraFault::not_applied for
  /// what it cannot.
  AppliedSettings applicable(const ExposureRequest& request) const;
  /// Sets both and reads both back; what is in effect some frames later. Throws
  /// CameraFault::not_applied when the driver keeps other values.
  void apply(const AppliedSettings& settings) const;
  /// The exposure that the controls stand at.
  double current_exposure_s() const;

 private:
  struct Control {
    const V4l2Node* node = nullptr;
    std::uint32_t id = 0;
    std::int64_t least = 0;
    std::int64_t most = 0;
    std::int64_t step = 1;
    std::int64_t preset = 0;  ///< the driver's default
  };

  void find_exposure(const SensorFormat& sensor);
  void find_gain();
  void find_blanking(const SensorFormat& sensor);
  void read_line_time(const SensorFormat& sensor);
  void all_manual() const;
  std::optional<Control> find(std::uint32_t id) const;
  static std::optional<Control> query(const V4l2Node& node, std::uint32_t id);
  static std::int64_t get(const Control& control);
  static void set(const Control& control, const char* name, std::int64_t value);
  static std::int64_t snapped(const Control& control, double value);
  double longest_exposure_s() const;
  [[noreturn]] void refuse(const std::string& what) const;

  const V4l2Node& video_;
  const CameraDeviceSettings settings_;
  std::unique_ptr<V4l2Node> sensor_;  ///< the sensor's own node, where it has one
  std::optional<Control> exposure_;
  double exposure_unit_s_ = 0;
  std::optional<Control> gain_;
  std::optional<Control> blanking_;  ///< rows after the image; a longer exposure needs more
  std::int64_t frame_margin_ = 0;    ///< rows that a frame is longer than its longest exposure
  int rows_ = 0;
  double line_time_s_ = 0;
};

}  // namespace brdfgate
