// A bracket on its way: which of its frames came, and those taken ahead of their turn. The same for
// every camera that matches frames to requests.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "hal/camera_checks.hpp"
#include "hal/camera_settings.hpp"
#include "hal/frame_matcher.hpp"
#include "hal/raw_formats.hpp"
#include "model/frame.hpp"

namespace brdfgate {

class ArmedBracket {
 public:
  ArmedBracket() = default;  ///< nothing is armed
  ArmedBracket(std::vector<AppliedSettings> wanted, const MatchRule& rule)
      : matcher_(std::move(wanted), rule) {}

  const FrameMatcher& matcher() const { return matcher_; }
  /// Every frame was handed out, or none was armed.
  bool over() const { return next_ >= matcher_.size(); }
  /// The next one to hand out has not come. Precondition: not over().
  bool awaits_next() const { return matcher_.is_missing(next_); }
  const AppliedSettings& next_wanted() const { return matcher_.wanted(next_); }

  /// Keeps the frame if it is one of the bracket; its fate is counted in `passed` where not.
  /// Precondition: `image` is complete for the settings' pixel format.
  FrameMatcher::Outcome offer(const FrameFacts& facts, const RawImage& image,
                              const CameraDeviceSettings& settings, PassedFrames& passed);
  /// Hands out the next frame. Precondition: not over(), not awaits_next().
  RawFrame hand_out();

 private:
  FrameMatcher matcher_;
  std::size_t next_ = 0;
  std::map<std::size_t, RawFrame> kept_;  ///< by place in the bracket
};

}  // namespace brdfgate
