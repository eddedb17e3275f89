// How a real camera is addressed and what has to be known of it that its driver does not say.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "hal/raw_formats.hpp"
#include "model/frame.hpp"

namespace brdfgate {

/// What instant a driver's timestamps mark.
enum class TimestampPoint {
  driver,             ///< V4L2 only: start of exposure or end of frame, as the buffers' flags say
  start_of_exposure,  ///< of the first row
  start_of_readout,   ///< the first row's exposure is over: a CSI-2 receiver's frame start
  end_of_frame,       ///< the last row is in
};

/// Analogue gain, linear, from a driver's gain code; sensors differ, and no driver says which law
/// is theirs: the datasheet does.
struct GainLaw {
  enum class Kind {
    linear,      ///< gain = code / scale
    decibel,     ///< gain = 10^(code * scale / 20): `scale` decibels a step
    reciprocal,  ///< gain = scale / (scale - code)
  };
  Kind kind = Kind::linear;
  double scale = 1;  ///< over 0

  double gain_of(double code) const;
  double code_of(double gain) const;
};

struct CameraDeviceSettings {
  /// V4L2: the video node, best a stable name under /dev/v4l/by-id or by-path. libcamera: the
  /// camera's id as `cam --list` prints it; empty: the only one there is.
  std::string device;
  /// V4L2: the sensor's own node (/dev/v4l-subdevN), where exposure and gain are its controls.
  std::string subdevice;
  const RawFormat* pixel_format = nullptr;  ///< never null once configured
  int shift_right = 0;  ///< bits below the counts in a word aligned to its high end, 0..8

  /// V4L2: how many frames that begin after a control was set may still carry the old setting,
  /// 0..16. Measured as docs/cameras.md says; a figure too small mixes exposures up.
  int control_delay_frames = 2;
  double line_time_s = 0;  ///< one row's period; 0: from the driver (V4L2: pixel rate and blanking)
  double readout_s = 0;  ///< first row to last row; 0: line time times height, or the frame period
  TimestampPoint timestamp = TimestampPoint::driver;
  std::optional<double> fixed_exposure_s;  ///< a camera without exposure control
  /// What a camera cannot apply is taken with its fixed exposure, and reported so; false: an error.
  bool accept_fixed_exposure = false;
  std::optional<GainLaw> gain_law;  ///< none: gain 1 is the driver's default code
  double frame_interval_s = 0;      ///< asked of the driver; 0: its own choice
  int buffers = 4;                  ///< 2..32

  /// Told of drops, waits and recoveries, on the thread that uses the camera. May be empty.
  std::function<void(const std::string&)> note;
};

}  // namespace brdfgate
