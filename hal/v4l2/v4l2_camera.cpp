#include "hal/v4l2/v4l2_camera.hpp"

#include <algorithm>
#include <utility>

#include "hal/armed_bracket.hpp"
#include "hal/camera_checks.hpp"
#include "hal/frame_matcher.hpp"
#include "hal/raw_formats.hpp"
#include "hal/v4l2/v4l2_controls.hpp"
#include "hal/v4l2/v4l2_device.hpp"

namespace brdfgate {
namespace {

bool nothing_to_set(const CameraDeviceSettings& settings) {
  return settings.fixed_exposure_s && !settings.gain_law;
}

class V4l2Camera final : public Camera {
 public:
  V4l2Camera(const CameraDeviceSettings& settings, const SensorFormat& sensor, V4l2System& system)
      : settings_(settings),
        sensor_(sensor),
        system_(system),
        delay_(nothing_to_set(settings) ? 0 : settings.control_delay_frames) {}

  SensorFormat format() const override { return sensor_; }

  CameraCapabilities capabilities() const override {
    return {.exposure = !settings_.fixed_exposure_s, .gain = settings_.gain_law.has_value()};
  }

  void probe() override {
    try {
      if (device_) {
        device_->check_alive();
      } else {
        open();
      }
    } catch (...) {
      close();
      throw;
    }
  }

  void arm(const std::vector<ExposureRequest>& bracket, std::int64_t not_before_ns) override;
  RawFrame next_frame(std::chrono::milliseconds timeout) override;

  void stop() noexcept override {
    bracket_ = {};
    if (device_) device_->stop();
  }

 private:
  void open();
  void close() noexcept;
  void start_stream();
  void ask_for(const AppliedSettings& settings);
  RawFrame wait_for_next(std::int64_t deadline_ns);
  void take(const V4l2Frame& frame, PassedFrames& passed);
  FrameFacts facts_of(const V4l2Frame& frame);
  TimestampPoint timestamp_point(const V4l2Frame& frame) const;
  double readout_s() const;
  void report_losses();
  [[noreturn]] void fail(CameraFault fault, const std::string& call,
                         const std::string& what) const {
    throw CameraError(fault, settings_.device, call, what);
  }

  const CameraDeviceSettings settings_;
  const SensorFormat sensor_;
  V4l2System& system_;
  std::unique_ptr<V4l2Device> device_;
  std::unique_ptr<V4l2Controls> controls_;  ///< refers to the device
  ControlDelay delay_;
  std::optional<AppliedSettings> asked_;  ///< what the controls stand at; none: not known

  ArmedBracket bracket_;
};

void V4l2Camera::open() {
  close();
  device_ = std::make_unique<V4l2Device>(system_, settings_, sensor_);
  controls_ = std::make_unique<V4l2Controls>(device_->node(), settings_, sensor_);
}

void V4l2Camera::close() noexcept {
  bracket_ = {};
  controls_.reset();
  device_.reset();
  asked_.reset();
}

void V4l2Camera::start_stream() {
  if (device_->streaming()) {
    device_->flush();
    return;
  }
  device_->start();
  delay_.restart(controls_->current_exposure_s());
  asked_.reset();
}

void V4l2Camera::ask_for(const AppliedSettings& settings) {
  const bool stands =
      asked_ && asked_->exposure_s == settings.exposure_s && asked_->gain == settings.gain;
  if (stands) return;
  asked_.reset();
  controls_->apply(settings);
  delay_.set(settings, system_.now_ns());
  asked_ = settings;
}

void V4l2Camera::arm(const std::vector<ExposureRequest>& bracket, std::int64_t not_before_ns) {
  bracket_ = {};
  check_requests(bracket, settings_.device);
  try {
    if (!device_) open();
    std::vector<AppliedSettings> wanted;
    wanted.reserve(bracket.size());
    for (const ExposureRequest& request : bracket)
      wanted.push_back(controls_->applicable(request));
    start_stream();
    const MatchRule rule{.exposure_tolerance_s = controls_->exposure_unit_s() / 2,
                         .not_before_ns = std::max(not_before_ns, system_.now_ns())};
    if (!wanted.empty()) ask_for(wanted.front());
    bracket_ = ArmedBracket(std::move(wanted), rule);
  } catch (...) {
    close();
    throw;
  }
}

RawFrame V4l2Camera::next_frame(std::chrono::milliseconds timeout) {
  if (bracket_.over()) fail(CameraFault::no_frame, "next_frame", "nothing is armed");
  try {
    RawFrame frame =
        wait_for_next(system_.now_ns() + to_ns(1e-3 * static_cast<double>(timeout.count())));
    if (bracket_.over()) report_losses();
    return frame;
  } catch (const CameraError& error) {
    // Late frames of a camera that is otherwise well are left behind by the next arm().
    if (error.fault() == CameraFault::no_frame) {
      stop();
    } else {
      close();
    }
    throw;
  }
}

RawFrame V4l2Camera::wait_for_next(std::int64_t deadline_ns) {
  PassedFrames passed;
  while (bracket_.awaits_next()) {
    ask_for(bracket_.next_wanted());
    const auto frame = device_->wait(std::max<std::int64_t>(deadline_ns - system_.now_ns(), 0));
    if (frame) {
      take(*frame, passed);
      device_->requeue(*frame);
    }
    if (bracket_.awaits_next() && system_.now_ns() >= deadline_ns) {
      device_->check_alive();
      fail(CameraFault::no_frame, "next_frame",
           "no frame of the bracket in time; " + passed.text());
    }
  }
  return bracket_.hand_out();
}

void V4l2Camera::take(const V4l2Frame& frame, PassedFrames& passed) {
  const RawImage image{frame.bytes, device_->stride(), sensor_.width, sensor_.height};
  if (frame.damaged || !is_complete(*settings_.pixel_format, image)) {
    ++passed.damaged;
    return;
  }
  bracket_.offer(facts_of(frame), image, settings_, passed);
}

TimestampPoint V4l2Camera::timestamp_point(const V4l2Frame& frame) const {
  const std::uint32_t clock = frame.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK;
  const bool told = settings_.timestamp != TimestampPoint::driver;
  // A driver that names no clock is believed where the configuration says what its stamps mark.
  if (clock != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC &&
      !(told && clock == V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN)) {
    fail(CameraFault::no_frame, "VIDIOC_DQBUF",
         "the driver's timestamps are not of the monotonic clock; where they are although it does "
         "not say so, camera.device.timestamp tells what they mark");
  }
  if (told) return settings_.timestamp;
  const bool start = (frame.flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
  return start ? TimestampPoint::start_of_exposure : TimestampPoint::end_of_frame;
}

double V4l2Camera::readout_s() const {
  if (settings_.readout_s > 0) return settings_.readout_s;
  if (controls_->line_time_s() > 0) return controls_->line_time_s() * sensor_.height;
  return device_->frame_period_s();
}

FrameFacts V4l2Camera::facts_of(const V4l2Frame& frame) {
  const TimestampPoint point = timestamp_point(frame);
  check_stamp(frame.timestamp_ns, system_.now_ns(), delay_.longest_s(), settings_.device);
  const auto begun = [&](double exposure_s) {
    return begun_ns(point, frame.timestamp_ns, exposure_s, readout_s());
  };
  FrameFacts facts;
  facts.sequence = frame.sequence;
  facts.stamp_ns = frame.timestamp_ns;
  facts.applied = delay_.in_effect(frame.sequence, begun(delay_.longest_s()));
  facts.begun_ns = begun(facts.applied ? facts.applied->exposure_s : delay_.longest_s());
  return facts;
}

void V4l2Camera::report_losses() {
  const FrameMatcher& matcher = bracket_.matcher();
  if (!settings_.note || matcher.lost() + matcher.repeated() == 0) return;
  settings_.note(settings_.device + ": in one bracket " + std::to_string(matcher.lost()) +
                 " frame(s) lost, " + std::to_string(matcher.repeated()) +
                 " repeated; the exposures were taken again");
}

}  // namespace

std::unique_ptr<Camera> make_v4l2_camera(const CameraDeviceSettings& settings,
                                         const SensorFormat& sensor, V4l2System& system) {
  return std::make_unique<V4l2Camera>(settings, sensor, system);
}

}  // namespace brdfgate
