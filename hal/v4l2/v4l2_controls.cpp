#include "hal/v4l2/v4l2_controls.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>

#include "hal/camera_checks.hpp"

namespace brdfgate {
namespace {

/// Of V4L2_CID_EXPOSURE_ABSOLUTE.
constexpr double kAbsoluteUnitS = 100e-6;

}  // namespace

V4l2Controls::V4l2Controls(const V4l2Node& video, const CameraDeviceSettings& settings,
                           const SensorFormat& sensor)
    : video_(video), settings_(settings), rows_(sensor.height), line_time_s_(settings.line_time_s) {
  if (!settings.subdevice.empty()) {
    sensor_ = std::make_unique<V4l2Node>(video.system(), settings.subdevice);
  }
  all_manual();
  read_line_time(sensor);
  find_exposure(sensor);
  find_gain();
}

void V4l2Controls::refuse(const std::string& what) const {
  video_.fail(what, "controls", CameraFault::not_applied);
}

std::optional<V4l2Controls::Control> V4l2Controls::query(const V4l2Node& node, std::uint32_t id) {
  v4l2_query_ext_ctrl asked{};
  asked.id = id;
  if (node.try_ioctl(VIDIOC_QUERY_EXT_CTRL, &asked) < 0) return std::nullopt;
  if ((asked.flags & V4L2_CTRL_FLAG_DISABLED) != 0) return std::nullopt;
  return Control{&node,
                 id,
                 asked.minimum,
                 asked.maximum,
                 std::max<std::int64_t>(static_cast<std::int64_t>(asked.step), 1),
                 asked.default_value};
}

std::optional<V4l2Controls::Control> V4l2Controls::find(std::uint32_t id) const {
  if (sensor_) {
    if (auto control = query(*sensor_, id)) return control;
  }
  return query(video_, id);
}

std::int64_t V4l2Controls::get(const Control& control) {
  v4l2_ext_control value{};
  value.id = control.id;
  v4l2_ext_controls list{};
  list.which = V4L2_CTRL_WHICH_CUR_VAL;
  list.count = 1;
  list.controls = &value;
  control.node->ioctl(VIDIOC_G_EXT_CTRLS, "VIDIOC_G_EXT_CTRLS", &list);
  // Pixel rates are 64-bit controls, all others that are read here 32-bit ones.
  return control.id == V4L2_CID_PIXEL_RATE ? value.value64 : value.value;
}

void V4l2Controls::set(const Control& control, const char* name, std::int64_t wanted) {
  v4l2_ext_control value{};
  value.id = control.id;
  value.value = static_cast<std::int32_t>(wanted);
  v4l2_ext_controls list{};
  list.which = V4L2_CTRL_WHICH_CUR_VAL;
  list.count = 1;
  list.controls = &value;
  const int result = control.node->try_ioctl(VIDIOC_S_EXT_CTRLS, &list);
  if (result < 0) {
    control.node->fail(-result, (std::string("VIDIOC_S_EXT_CTRLS ") + name).c_str(),
                       CameraFault::not_applied);
  }
}

void V4l2Controls::all_manual() const {
  struct Automatism {
    std::uint32_t id;
    const char* name;
    std::int64_t off;
  };
  static constexpr std::array<Automatism, 4> kAutomatisms{
      {{V4L2_CID_EXPOSURE_AUTO, "exposure_auto", V4L2_EXPOSURE_MANUAL},
       {V4L2_CID_AUTOGAIN, "gain_automatic", 0},
       {V4L2_CID_AUTO_WHITE_BALANCE, "white_balance_automatic", 0},
       {V4L2_CID_EXPOSURE_AUTO_PRIORITY, "exposure_dynamic_framerate", 1}}};
  for (const Automatism& automatism : kAutomatisms) {
    if (const auto control = find(automatism.id)) set(*control, automatism.name, automatism.off);
  }
}

void V4l2Controls::read_line_time(const SensorFormat& sensor) {
  if (line_time_s_ > 0) return;
  const auto rate = find(V4L2_CID_PIXEL_RATE);
  const auto blanking = find(V4L2_CID_HBLANK);
  if (!rate || !blanking) return;
  const auto pixels_per_s = static_cast<double>(get(*rate));
  if (pixels_per_s <= 0) return;
  line_time_s_ = (sensor.width + static_cast<double>(get(*blanking))) / pixels_per_s;
}

void V4l2Controls::find_exposure(const SensorFormat& sensor) {
  if (settings_.fixed_exposure_s) return;
  exposure_ = find(V4L2_CID_EXPOSURE_ABSOLUTE);
  exposure_unit_s_ = kAbsoluteUnitS;
  if (exposure_) return;
  exposure_ = find(V4L2_CID_EXPOSURE);
  if (!exposure_) {
    refuse("the camera has no exposure control" +
           std::string(settings_.subdevice.empty() ? " on this node" : "") +
           "; name the sensor's own node in camera.device.subdevice, or, where the exposure is "
           "fixed, say camera.device.fixed_exposure_ms");
  }
  if (line_time_s_ <= 0) {
    refuse(
        "the exposure counts lines and the driver does not say how long one is; needed: "
        "camera.device.line_time_us");
  }
  exposure_unit_s_ = line_time_s_;
  find_blanking(sensor);
}

void V4l2Controls::find_blanking(const SensorFormat& sensor) {
  blanking_ = find(V4L2_CID_VBLANK);
  if (!blanking_) return;
  frame_margin_ = std::max<std::int64_t>(sensor.height + get(*blanking_) - exposure_->most, 0);
}

void V4l2Controls::find_gain() {
  gain_ = find(V4L2_CID_ANALOGUE_GAIN);
  if (!gain_) gain_ = find(V4L2_CID_GAIN);
  if (!gain_ && settings_.gain_law) {
    refuse("the camera has no gain control; remove camera.device.gain");
  }
}

CameraCapabilities V4l2Controls::capabilities() const {
  return {.exposure = exposure_.has_value(),
          .gain = gain_.has_value() && settings_.gain_law.has_value()};
}

std::int64_t V4l2Controls::snapped(const Control& control, double value) {
  const auto steps = std::llround((value - static_cast<double>(control.least)) /
                                  static_cast<double>(control.step));
  return std::clamp<std::int64_t>(control.least + steps * control.step, control.least,
                                  control.most);
}

double V4l2Controls::longest_exposure_s() const {
  // Blanking grows with the exposure, and the driver's range for the exposure with it.
  const std::int64_t lines =
      blanking_ ? std::max(exposure_->most, rows_ + blanking_->most - frame_margin_)
                : exposure_->most;
  return static_cast<double>(lines) * exposure_unit_s_;
}

AppliedSettings V4l2Controls::applicable(const ExposureRequest& request) const {
  AppliedSettings applied{request.exposure_s, 1};
  if (exposure_) {
    Control reach = *exposure_;
    reach.most = std::llround(longest_exposure_s() / exposure_unit_s_);
    applied.exposure_s =
        static_cast<double>(snapped(reach, request.exposure_s / exposure_unit_s_)) *
        exposure_unit_s_;
    const double step_s = static_cast<double>(reach.step) * exposure_unit_s_;
    if (std::abs(applied.exposure_s - request.exposure_s) > 0.501 * step_s) {
      refuse("an exposure of " + ms_text(request.exposure_s) +
             " cannot be applied; the driver has " +
             ms_text(static_cast<double>(reach.least) * exposure_unit_s_) + " to " +
             ms_text(longest_exposure_s()) + " in steps of " + ms_text(step_s));
    }
  } else {
    applied.exposure_s = fixed_exposure_s(request, settings_);
  }
  if (gain_ && settings_.gain_law) {
    applied.gain = settings_.gain_law->gain_of(
        static_cast<double>(snapped(*gain_, settings_.gain_law->code_of(request.gain))));
  }
  if (std::abs(applied.gain - request.gain) > kGainTolerance * request.gain) {
    refuse("a gain of " + gain_text(request.gain) + " cannot be applied; " +
           (gain_ && settings_.gain_law
                ? "the driver has " +
                      gain_text(settings_.gain_law->gain_of(static_cast<double>(gain_->least))) +
                      " to " +
                      gain_text(settings_.gain_law->gain_of(static_cast<double>(gain_->most)))
                : std::string("without camera.device.gain only 1 can")));
  }
  return applied;
}

void V4l2Controls::apply(const AppliedSettings& settings) const {
  const auto confirmed = [this](const Control& control, const char* name, std::int64_t wanted) {
    set(control, name, wanted);
    const std::int64_t kept = get(control);
    if (kept == wanted) return;
    refuse(std::string(name) + " was set to " + std::to_string(wanted) + " and reads " +
           std::to_string(kept));
  };
  if (exposure_) {
    const std::int64_t code = std::llround(settings.exposure_s / exposure_unit_s_);
    if (blanking_) {
      const std::int64_t rows = code + frame_margin_ - rows_;
      set(*blanking_, "vertical_blanking", std::clamp(rows, blanking_->least, blanking_->most));
    }
    confirmed(*exposure_, "exposure", code);
  }
  if (gain_) {
    const double code = settings_.gain_law ? settings_.gain_law->code_of(settings.gain)
                                           : static_cast<double>(gain_->preset);
    confirmed(*gain_, "gain", snapped(*gain_, code));
  }
}

double V4l2Controls::current_exposure_s() const {
  if (!exposure_) return *settings_.fixed_exposure_s;
  return static_cast<double>(get(*exposure_)) * exposure_unit_s_;
}

}  // namespace brdfgate
