// Which exposure of a bracket a frame is. A sensor applies a setting some frames after it was
// asked, frames get lost and come twice: frames are never counted off against requests; a frame
// counts only for what is known to have been in effect when it was exposed.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

namespace brdfgate {

/// Exposure and gain as a sensor applies them.
struct AppliedSettings {
  double exposure_s = 0;
  double gain = 1;
};

/// What a driver says of a frame, its pixels apart.
struct FrameFacts {
  std::uint64_t sequence = 0;  ///< of the frames that the sensor made, lost ones included
  std::int64_t stamp_ns = 0;   ///< the driver's timestamp, whatever instant it marks
  std::int64_t begun_ns = 0;   ///< start of exposure of the first row; while the settings are not
                               ///< known: the earliest it can have been
  /// Nothing: not known, because a change was under way.
  std::optional<AppliedSettings> applied;
};

/// What became of a frame.
enum class FrameFate {
  taken,     ///< it is an exposure that was missing
  early,     ///< its exposure began too early
  repeated,  ///< the same frame once more: sequence or time stand still
  unknown,   ///< its settings are not known
  unwanted,  ///< its settings are known and not, or no longer, missing
};

struct MatchRule {
  double exposure_tolerance_s = 0;  ///< reported against asked: one line
  double gain_tolerance = 0.01;     ///< relative
  std::int64_t not_before_ns = 0;   ///< frames that began before do not count
};

class FrameMatcher {
 public:
  FrameMatcher() = default;
  /// `wanted` as the sensor can apply them, rounding done.
  FrameMatcher(std::vector<AppliedSettings> wanted, const MatchRule& rule);

  struct Outcome {
    FrameFate fate = FrameFate::unknown;
    std::size_t index = 0;  ///< of the bracket, with `taken`
  };
  /// Frames in the order in which they came. Of several missing exposures that fit the first is
  /// taken.
  Outcome offer(const FrameFacts& frame);

  /// Indices of what is missing, in the bracket's order.
  std::vector<std::size_t> missing() const;
  bool is_missing(std::size_t index) const { return !found_.at(index); }
  const AppliedSettings& wanted(std::size_t index) const { return wanted_.at(index); }
  std::size_t size() const { return wanted_.size(); }
  /// Frames that the sensor made and nobody saw, since the first one offered.
  std::uint64_t lost() const { return lost_; }
  std::uint64_t repeated() const { return repeated_; }

 private:
  bool repeats(const FrameFacts& frame);
  bool fits(const AppliedSettings& applied, const AppliedSettings& wanted) const;

  std::vector<AppliedSettings> wanted_;
  std::vector<bool> found_;
  MatchRule rule_;
  std::optional<FrameFacts> last_;
  std::uint64_t lost_ = 0;
  std::uint64_t repeated_ = 0;
};

/// For sensors that do not report what they applied: a setting is in effect from the frame on that
/// is `delay_frames` behind the first one begun after it was set. Lost frames count, as their
/// numbers say.
class ControlDelay {
 public:
  explicit ControlDelay(int delay_frames) : delay_frames_(delay_frames) {}

  void set(const AppliedSettings& settings, std::int64_t now_ns);
  /// What was in effect at this frame; nothing while a change is under way. Frames in order.
  std::optional<AppliedSettings> in_effect(std::uint64_t sequence, std::int64_t begun_ns);
  /// The longest exposure that may have been in effect since before the last change.
  double longest_s() const { return longest_s_; }
  /// The sensor was restarted, with an exposure that nobody asked for yet.
  void restart(double exposure_s);

 private:
  int delay_frames_;
  std::optional<AppliedSettings> last_set_;
  std::int64_t set_ns_ = 0;
  std::optional<std::uint64_t> first_after_;  ///< sequence of the first frame begun after the set
  double longest_s_ = 0;
};

}  // namespace brdfgate
