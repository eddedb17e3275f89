#include "hal/frame_matcher.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace brdfgate {

FrameMatcher::FrameMatcher(std::vector<AppliedSettings> wanted, const MatchRule& rule)
    : wanted_(std::move(wanted)), found_(wanted_.size(), false), rule_(rule) {}

bool FrameMatcher::repeats(const FrameFacts& frame) {
  const bool stands_still = last_ && frame.sequence <= last_->sequence;
  const bool same_time = last_ && frame.stamp_ns <= last_->stamp_ns;
  if (stands_still || same_time) {
    ++repeated_;
    return true;
  }
  if (last_) lost_ += frame.sequence - last_->sequence - 1;
  last_ = frame;
  return false;
}

bool FrameMatcher::fits(const AppliedSettings& applied, const AppliedSettings& wanted) const {
  return std::abs(applied.exposure_s - wanted.exposure_s) <= rule_.exposure_tolerance_s &&
         std::abs(applied.gain - wanted.gain) <= rule_.gain_tolerance * wanted.gain;
}

FrameMatcher::Outcome FrameMatcher::offer(const FrameFacts& frame) {
  if (repeats(frame)) return {FrameFate::repeated};
  if (frame.begun_ns < rule_.not_before_ns) return {FrameFate::early};
  if (!frame.applied) return {FrameFate::unknown};
  for (std::size_t i = 0; i < wanted_.size(); ++i) {
    if (found_[i] || !fits(*frame.applied, wanted_[i])) continue;
    found_[i] = true;
    return {FrameFate::taken, i};
  }
  return {FrameFate::unwanted};
}

std::vector<std::size_t> FrameMatcher::missing() const {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < found_.size(); ++i)
    if (!found_[i]) out.push_back(i);
  return out;
}

void ControlDelay::set(const AppliedSettings& settings, std::int64_t now_ns) {
  longest_s_ = std::max(longest_s_, settings.exposure_s);
  last_set_ = settings;
  set_ns_ = now_ns;
  first_after_.reset();
}

std::optional<AppliedSettings> ControlDelay::in_effect(std::uint64_t sequence,
                                                       std::int64_t begun_ns) {
  if (!last_set_) return std::nullopt;
  if (!first_after_ && begun_ns >= set_ns_) first_after_ = sequence;
  if (!first_after_ || sequence < *first_after_ + static_cast<std::uint64_t>(delay_frames_)) {
    return std::nullopt;
  }
  longest_s_ = last_set_->exposure_s;
  return last_set_;
}

void ControlDelay::restart(double exposure_s) {
  last_set_.reset();
  first_after_.reset();
  longest_s_ = exposure_s;
}

}  // namespace brdfgate
