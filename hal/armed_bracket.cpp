#include "hal/armed_bracket.hpp"

#include <utility>

namespace brdfgate {

FrameMatcher::Outcome ArmedBracket::offer(const FrameFacts& facts, const RawImage& image,
                                          const CameraDeviceSettings& settings,
                                          PassedFrames& passed) {
  const FrameMatcher::Outcome outcome = matcher_.offer(facts);
  passed.count(outcome.fate);
  if (outcome.fate != FrameFate::taken) return outcome;
  RawFrame raw;
  raw.counts = unpack(*settings.pixel_format, image, settings.shift_right);
  raw.exposure_s = facts.applied->exposure_s;
  raw.gain = facts.applied->gain;
  raw.timestamp_ns = facts.begun_ns;
  kept_.insert_or_assign(outcome.index, std::move(raw));
  return outcome;
}

RawFrame ArmedBracket::hand_out() {
  auto taken = kept_.extract(next_++);
  return std::move(taken.mapped());
}

}  // namespace brdfgate
