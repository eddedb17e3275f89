// The walk through a calibration: what to put under the camera, when, and how good it came out.
#pragma once

#include <filesystem>
#include <iosfwd>
#include <memory>
#include <string>
#include <vector>

#include "app/calibration_work.hpp"
#include "app/station.hpp"

namespace brdfgate {

/// One thing to put under the camera.
struct CalibrationStep {
  std::string key;  ///< names the folder of its recordings, and its scene on the simulated station
  RecordingRole role = RecordingRole::dark;
  std::string put;  ///< the instruction
  int captures = 1;
  bool optional = false;
  double height_mm = 0;  ///< of a raised white reference
};

/// In their order: dark, sweep (needed with a tone curve), boards (none where the camera was
/// measured by hand), white, raised white (with a spacer), mirror, black.
std::vector<CalibrationStep> calibration_steps(const StationConfig& config, double spacer_mm,
                                               bool camera_by_hand);

struct CalibrationWalkSettings {
  std::filesystem::path record;  ///< keeps every good recording here; empty: none are kept
  std::filesystem::path scenes;  ///< of the simulated station: <key>.yaml per step
  double spacer_mm = 0;          ///< 0: the white is not raised
};

/// Asks for one thing after the other on `out`, takes answers from `in`, line by line: empty
/// captures, s skips what is optional, q gives up; on the simulated station anything else is a
/// scene file to capture instead of the step's own. Each capture is judged at once, together with
/// those before it; one that is not usable is named and asked for again.
class CalibrationWalk {
 public:
  CalibrationWalk(const StationConfig& config, const CalibrationRequest& request,
                  CalibrationWalkSettings settings, std::istream& in, std::ostream& out);
  ~CalibrationWalk();

  /// All good recordings. Throws InputError where the walk was given up or the answers ended.
  CalibrationRecordings run();

 private:
  enum class Answer { capture, skip };
  void walk(const CalibrationStep& step);
  bool capture_once(const CalibrationStep& step, int number, CalibrationRecordings& next);
  Answer ask(const CalibrationStep& step, int number);
  Capture take(const CalibrationStep& step);
  std::string assess(const CalibrationStep& step, const CalibrationRecordings& candidate) const;
  std::string assess_whole(const CalibrationStep& step,
                           const CalibrationRecordings& candidate) const;
  void keep(const CalibrationStep& step, int number, const Capture& capture) const;

  const StationConfig& config_;
  const CalibrationRequest& request_;
  const CalibrationWalkSettings settings_;
  std::istream& in_;
  std::ostream& out_;
  std::unique_ptr<Station> station_;
  std::filesystem::path scene_;  ///< what lies under the simulated camera next
  std::uint64_t captures_ = 0;   ///< so far: the simulated station's seeds differ by it
  CalibrationRecordings recordings_;
};

}  // namespace brdfgate
