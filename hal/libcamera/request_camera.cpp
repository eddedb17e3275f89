#include "hal/libcamera/request_camera.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "hal/armed_bracket.hpp"
#include "hal/camera_checks.hpp"
#include "hal/frame_matcher.hpp"
#include "hal/raw_formats.hpp"

namespace brdfgate {
namespace {

/// ExposureTime is whole microseconds.
constexpr double kExposureStepS = 1e-6;
/// Frames until a setting that was asked for is given up: pipelines take 2 to 8.
constexpr std::uint64_t kPatienceFrames = 10;
/// Requests kept queued while all that is missing is on its way: the pipeline must not run dry, and
/// what is queued now delays the next bracket.
constexpr std::size_t kKeepAlive = 2;

/// The requests of one bracket: which exposure to ask for next.
class Schedule {
 public:
  Schedule() = default;
  explicit Schedule(std::size_t exposures) : asked_(exposures) {}

  /// The first missing exposure that nobody asked for, or whose frame must have been lost.
  std::optional<std::size_t> next(const FrameMatcher& matcher) {
    for (const std::size_t i : matcher.missing()) {
      if (asked_[i] && completed_ - asked_[i]->frame < kPatienceFrames) continue;
      if (asked_[i]) ++repeats_;
      asked_[i] = {order_++, completed_};
      return i;
    }
    return std::nullopt;
  }
  void completed() { ++completed_; }
  /// Settings take effect in the order in which they were asked for: what was asked for before this
  /// one and is still missing never comes.
  void taken(std::size_t index, const FrameMatcher& matcher) {
    if (!asked_[index]) return;
    for (const std::size_t i : matcher.missing()) {
      if (asked_[i] && asked_[i]->order < asked_[index]->order) {
        asked_[i].reset();
        ++repeats_;
      }
    }
  }
  std::uint64_t repeats() const { return repeats_; }
  std::uint64_t frames() const { return completed_; }

 private:
  struct Asked {
    std::uint64_t order = 0;
    std::uint64_t frame = 0;  ///< completed when it was asked for
  };
  std::vector<std::optional<Asked>> asked_;
  std::uint64_t order_ = 0;
  std::uint64_t completed_ = 0;
  std::uint64_t repeats_ = 0;
};

class RequestCamera final : public Camera {
 public:
  RequestCamera(const CameraDeviceSettings& settings, const SensorFormat& sensor,
                OpenRequestDevice open)
      : settings_(settings),
        sensor_(sensor),
        name_(settings.device.empty() ? "libcamera" : "libcamera " + settings.device),
        open_(std::move(open)) {}

  SensorFormat format() const override { return sensor_; }
  CameraCapabilities capabilities() const override {
    return {.exposure = !settings_.fixed_exposure_s, .gain = !settings_.fixed_exposure_s};
  }
  void probe() override;
  void arm(const std::vector<ExposureRequest>& bracket, std::int64_t not_before_ns) override;
  RawFrame next_frame(std::chrono::milliseconds timeout) override;
  void stop() noexcept override {
    bracket_ = {};
    stop_stream();
  }

 private:
  void close() noexcept;
  void stop_stream() noexcept;
  void start_stream();
  void take_back();
  void check_gain(double gain) const;
  AppliedSettings applicable(const ExposureRequest& request) const;
  RequestSettings request_of(const AppliedSettings& settings) const;
  void queue_free();
  RawFrame wait_for_next(std::int64_t deadline_ns);
  void take(const CompletedRequest& done, PassedFrames& passed);
  FrameFacts facts_of(const CompletedRequest& done) const;
  double readout_s() const;
  void report();
  [[noreturn]] void fail(CameraFault fault, const std::string& call,
                         const std::string& what) const {
    throw CameraError(fault, name_, call, what);
  }

  const CameraDeviceSettings settings_;
  const SensorFormat sensor_;
  const std::string name_;
  const OpenRequestDevice open_;
  std::unique_ptr<RequestDevice> device_;
  bool streaming_ = false;
  std::vector<std::size_t> free_slots_;
  RequestSettings last_queued_;

  ArmedBracket bracket_;
  Schedule schedule_;
};

void RequestCamera::probe() {
  try {
    if (device_) {
      device_->check_alive();
    } else {
      device_ = open_();
    }
  } catch (...) {
    close();
    throw;
  }
}

void RequestCamera::close() noexcept {
  bracket_ = {};
  stop_stream();
  device_.reset();
}

void RequestCamera::stop_stream() noexcept {
  if (device_ && streaming_) device_->stop();
  streaming_ = false;
  free_slots_.clear();
}

void RequestCamera::start_stream() {
  if (streaming_) {
    take_back();
    return;
  }
  device_->start();
  streaming_ = true;
  for (std::size_t slot = 0; slot < device_->slots(); ++slot)
    free_slots_.push_back(slot);
}

void RequestCamera::check_gain(double gain) const {
  RequestRange reach{1, 1};
  if (!settings_.fixed_exposure_s) reach = device_->gain_range().value_or(reach);
  if (gain >= reach.least * (1 - kGainTolerance) && gain <= reach.most * (1 + kGainTolerance)) {
    return;
  }
  fail(CameraFault::not_applied, "arm",
       "a gain of " + gain_text(gain) + " cannot be applied; the camera has " +
           gain_text(reach.least) + " to " + gain_text(reach.most));
}

/// What completed since the last bracket, unseen.
void RequestCamera::take_back() {
  while (const auto done = device_->wait(0)) {
    free_slots_.push_back(done->slot);
    if (done->cancelled) fail(CameraFault::absent, "request", "cancelled; the camera went away");
  }
}

AppliedSettings RequestCamera::applicable(const ExposureRequest& request) const {
  check_gain(request.gain);
  if (settings_.fixed_exposure_s) return {fixed_exposure_s(request, settings_), 1};
  const auto exposures = device_->exposure_range_s();
  if (!exposures) {
    fail(CameraFault::not_applied, "controls",
         "the camera has no exposure control; where its exposure is fixed, say "
         "camera.device.fixed_exposure_ms");
  }
  const double line = settings_.line_time_s;
  if (request.exposure_s < exposures->least - line || request.exposure_s > exposures->most + line) {
    fail(CameraFault::not_applied, "arm",
         "an exposure of " + ms_text(request.exposure_s) + " cannot be applied; the camera has " +
             ms_text(exposures->least) + " to " + ms_text(exposures->most));
  }
  return {std::round(request.exposure_s / kExposureStepS) * kExposureStepS, request.gain};
}

RequestSettings RequestCamera::request_of(const AppliedSettings& settings) const {
  RequestSettings request{settings.exposure_s, settings.gain, 0};
  const RequestRange reach = device_->frame_duration_range_s().value_or(RequestRange{});
  // Readout and exposure may overlap, or not: a frame that fits both one after the other fits.
  request.frame_duration_s =
      std::max({reach.least, settings_.frame_interval_s, settings.exposure_s + readout_s()});
  return request;
}

void RequestCamera::arm(const std::vector<ExposureRequest>& bracket, std::int64_t not_before_ns) {
  bracket_ = {};
  check_requests(bracket, name_);
  try {
    if (!device_) device_ = open_();
    std::vector<AppliedSettings> wanted;
    wanted.reserve(bracket.size());
    for (const ExposureRequest& request : bracket)
      wanted.push_back(applicable(request));
    start_stream();
    const MatchRule rule{.exposure_tolerance_s = settings_.line_time_s + kExposureStepS / 2,
                         .gain_tolerance = kGainTolerance,
                         .not_before_ns = std::max(not_before_ns, device_->now_ns())};
    schedule_ = Schedule(wanted.size());
    bracket_ = ArmedBracket(std::move(wanted), rule);
    queue_free();
  } catch (...) {
    close();
    throw;
  }
}

void RequestCamera::queue_free() {
  const FrameMatcher& matcher = bracket_.matcher();
  while (!free_slots_.empty() && matcher.size() > 0) {
    if (const auto index = schedule_.next(matcher)) {
      last_queued_ = request_of(matcher.wanted(*index));
    } else if (device_->slots() - free_slots_.size() >= kKeepAlive) {
      return;
    }
    const std::size_t slot = free_slots_.back();
    device_->queue(slot, last_queued_);
    free_slots_.pop_back();
  }
}

RawFrame RequestCamera::next_frame(std::chrono::milliseconds timeout) {
  if (bracket_.over()) fail(CameraFault::no_frame, "next_frame", "nothing is armed");
  try {
    RawFrame frame =
        wait_for_next(device_->now_ns() + to_ns(1e-3 * static_cast<double>(timeout.count())));
    if (bracket_.over()) report();
    return frame;
  } catch (const CameraError& error) {
    if (error.fault() == CameraFault::no_frame) {
      stop();
    } else {
      close();
    }
    throw;
  }
}

RawFrame RequestCamera::wait_for_next(std::int64_t deadline_ns) {
  PassedFrames passed;
  while (bracket_.awaits_next()) {
    const auto done = device_->wait(std::max<std::int64_t>(deadline_ns - device_->now_ns(), 0));
    if (done) {
      free_slots_.push_back(done->slot);
      if (done->cancelled) fail(CameraFault::absent, "request", "cancelled; the camera went away");
      take(*done, passed);
      queue_free();
    }
    if (bracket_.awaits_next() && device_->now_ns() >= deadline_ns) {
      device_->check_alive();
      fail(passed.other > 0 && passed.other >= passed.sum() / 2 ? CameraFault::not_applied
                                                                : CameraFault::no_frame,
           "next_frame", "no frame of the bracket in time; " + passed.text());
    }
  }
  return bracket_.hand_out();
}

void RequestCamera::take(const CompletedRequest& done, PassedFrames& passed) {
  schedule_.completed();
  const RawImage image{done.bytes, device_->stride(), sensor_.width, sensor_.height};
  if (done.damaged || !is_complete(*settings_.pixel_format, image)) {
    ++passed.damaged;
    return;
  }
  const FrameMatcher::Outcome outcome = bracket_.offer(facts_of(done), image, settings_, passed);
  if (outcome.fate == FrameFate::taken) schedule_.taken(outcome.index, bracket_.matcher());
}

double RequestCamera::readout_s() const {
  return settings_.readout_s > 0 ? settings_.readout_s : settings_.line_time_s * sensor_.height;
}

FrameFacts RequestCamera::facts_of(const CompletedRequest& done) const {
  const double exposure_s = done.exposure_s.value_or(settings_.fixed_exposure_s.value_or(0));
  check_stamp(done.timestamp_ns, device_->now_ns(), exposure_s, name_);
  // libcamera calls it the start of exposure; its pipelines pass on the receiver's frame start,
  // which is the end of the first row's exposure. The later reading is the safe one.
  const TimestampPoint point = settings_.timestamp == TimestampPoint::driver
                                   ? TimestampPoint::start_of_readout
                                   : settings_.timestamp;
  FrameFacts facts;
  facts.sequence = done.sequence;
  facts.stamp_ns = done.timestamp_ns;
  facts.begun_ns = begun_ns(point, done.timestamp_ns, exposure_s, readout_s());
  if (done.exposure_s) {
    facts.applied = AppliedSettings{*done.exposure_s, done.gain.value_or(1)};
  } else if (settings_.fixed_exposure_s) {
    facts.applied = AppliedSettings{*settings_.fixed_exposure_s, 1};
  }
  return facts;
}

void RequestCamera::report() {
  if (!settings_.note) return;
  const FrameMatcher& matcher = bracket_.matcher();
  const std::uint64_t faults = matcher.lost() + matcher.repeated() + schedule_.repeats();
  const bool slow = schedule_.frames() > matcher.size() + kPatienceFrames;
  if (faults == 0 && !slow) return;
  settings_.note(name_ + ": " + std::to_string(schedule_.frames()) + " frames for " +
                 std::to_string(matcher.size()) + " exposures; " + std::to_string(matcher.lost()) +
                 " lost, " + std::to_string(matcher.repeated()) + " repeated, " +
                 std::to_string(schedule_.repeats()) + " asked for again");
}

}  // namespace

std::unique_ptr<Camera> make_request_camera(const CameraDeviceSettings& settings,
                                            const SensorFormat& sensor, OpenRequestDevice open) {
  return std::make_unique<RequestCamera>(settings, sensor, std::move(open));
}

}  // namespace brdfgate
