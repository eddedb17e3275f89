#include "app/machine_lines.hpp"

#include <condition_variable>
#include <mutex>
#include <utility>

namespace brdfgate {
namespace {

using namespace std::chrono_literals;

constexpr auto kRetry = 1s;
/// How soon a stop and a lost chip are noticed.
constexpr auto kLook = 100ms;

/// Not a sleep: ends with the stop.
void pause(const std::stop_token& stop, std::chrono::milliseconds time) {
  std::mutex unused;
  std::condition_variable_any woken;
  std::unique_lock lock(unused);
  woken.wait_for(lock, stop, time, [] { return false; });
}

}  // namespace

TriggerWatch::TriggerWatch(Open open, Told told)
    : open_(std::move(open)),
      told_(std::move(told)),
      thread_([this](const std::stop_token& stop) { run(stop); }) {}

bool TriggerWatch::take_line() {
  if (!trigger_) trigger_ = open_();
  if (std::exchange(lost_, false)) {
    spdlog::info("trigger line: there again");
    told_.lost(false);
  }
  return trigger_->wait(kLook);
}

void TriggerWatch::run(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    try {
      if (take_line()) told_.fired();
    } catch (const DeviceError& error) {
      trigger_.reset();
      faults_.report("trigger line", error.what());
      if (!std::exchange(lost_, true)) told_.lost(true);
      pause(stop, kRetry);
    }
  }
}

VerdictLines::VerdictLines(GpioOutputsSettings settings) : settings_(std::move(settings)) {
  show(kFailSafeOutputs);
}

void VerdictLines::show(const GpioOutputState& state) noexcept {
  if (lines_ && shown_ == state) return;
  const auto now = std::chrono::steady_clock::now();
  if (!lines_ && now < retry_at_) return;
  try {
    if (!lines_) lines_ = std::make_unique<GpioOutputs>(settings_);
    lines_->set(state);
    shown_ = state;
  } catch (const std::exception& error) {
    lines_.reset();
    shown_.reset();
    retry_at_ = now + kRetry;
    faults_.report("output lines", error.what());
  }
}

}  // namespace brdfgate
