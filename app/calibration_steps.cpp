#include "app/calibration_steps.hpp"

#include <fmt/core.h>

#include <istream>
#include <ostream>

#include "config/scene_reader.hpp"
#include "model/error.hpp"
#include "model/response.hpp"

namespace brdfgate {
namespace {

constexpr int kSweepPoints = 24;
constexpr int kTiltedBoards = 8;
/// Reprojection error, px, that the first boards may show: the lens' distortion is not known yet.
constexpr double kFirstBoardsRms = 6;

std::string dark_text(const CalibrationRecordings& recordings) {
  const DarkLevels dark = measure_darks(recordings.levels);
  return fmt::format("black level {:.2f} DN, read noise {:.2f} DN", dark.black_level_dn,
                     dark.read_noise_dn);
}

std::string sweep_text(const CalibrationOutcome& sensor) {
  if (!sensor.calibration.response.empty()) {
    const ToneCurve& curve = sensor.calibration.response.front();
    return fmt::format("tone curve recovered from count {} to {}", curve.least, curve.most);
  }
  return fmt::format("gain {:.4f} DN per electron, full well {:.0f} DN, linear within {:.2f} %",
                     sensor.sweep->gain_dn_per_e, sensor.sweep->full_well_dn,
                     sensor.sweep->linearity_percent);
}

std::string board_text(const CameraFit& fit) {
  return fmt::format("reprojection error {:.3f} px rms over {} boards, {}", fit.rms_px,
                     fit.view_rms_px.size(),
                     fit.intrinsics ? "focal length and distortion fitted"
                                    : "pose only as yet (5 boards give the focal length)");
}

std::string lights_text(const CalibrationOutcome& outcome) {
  std::string text;
  const Calibration& c = outcome.calibration;
  if (!outcome.geometry.lights) return "lights as configured (no board was recorded)";
  for (std::size_t l = 0; l < c.quality.lights.size(); ++l) {
    text +=
        fmt::format("{}light {} within {:.1f} mm, falloff residual {:.2f} %", l == 0 ? "" : "; ",
                    l + 1, 1e3 * c.quality.lights[l].sigma_m, 100 * c.quality.lights[l].residual);
  }
  return text;
}

std::string stray_text(const Calibration& c) {
  std::string text = "shows";
  for (std::size_t l = 0; l < c.stray_share.size(); ++l)
    text += fmt::format("{} {:.2f} %", l == 0 ? "" : " and", 100 * c.stray_share[l]);
  return text + " of white under the lights";
}

}  // namespace

std::vector<CalibrationStep> calibration_steps(const StationConfig& config, double spacer_mm,
                                               bool camera_by_hand) {
  std::vector<CalibrationStep> steps{
      {"dark", RecordingRole::dark, "Cover the lens.", 2},
      {"sweep", RecordingRole::ptc,
       "Lay the white reference into the nest, flat. (Exposures up to saturation.)", 1,
       !config.camera.tone_curve}};
  if (!camera_by_hand) {
    steps.push_back({"board", RecordingRole::board,
                     "Lay the board into the nest, flat and centred: it defines the frame.", 1,
                     true});
    steps.push_back({"board_tilted", RecordingRole::board,
                     "Hold the board at 10 to 20 degrees, another way each time, in view as a "
                     "whole.",
                     kTiltedBoards, true});
  }
  steps.push_back({"white", RecordingRole::white,
                   "Lay the white reference into the nest, flat, clean and without shadows.", 2});
  if (spacer_mm > 0) {
    steps.push_back({"white_raised", RecordingRole::white,
                     fmt::format("Lay the white reference on the {} mm spacer.", spacer_mm), 2,
                     true, spacer_mm});
  }
  steps.push_back(
      {"mirror", RecordingRole::mirror, "Lay the mirror-like gauge into the nest.", 1, true});
  steps.push_back({"black", RecordingRole::black, "Lay the black gauge into the nest.", 1, true});
  if (config.camera.sensor.channels() == 3) {
    steps.push_back({"chart", RecordingRole::chart,
                     "Lay the colour chart into the nest, upright as the camera sees it.", 1,
                     true});
  }
  if (config.inspection.monitor) {
    steps.push_back({"absent", RecordingRole::part,
                     "Leave the nest open: the monitor patch is measured.", 1, true});
  }
  return steps;
}

CalibrationWalk::CalibrationWalk(const StationConfig& config, const CalibrationRequest& request,
                                 CalibrationWalkSettings settings, std::istream& in,
                                 std::ostream& out)
    : config_(config),
      request_(request),
      settings_(std::move(settings)),
      in_(in),
      out_(out),
      recordings_(start_recordings(request, config)) {}

CalibrationWalk::~CalibrationWalk() = default;

CalibrationRecordings CalibrationWalk::run() {
  const auto steps = calibration_steps(config_, settings_.spacer_mm,
                                       recordings_.geometry.by_hand.camera.has_value());
  for (std::size_t i = 0; i < steps.size(); ++i) {
    out_ << fmt::format("\nStep {} of {}: {}\n", i + 1, steps.size(), steps[i].put);
    walk(steps[i]);
  }
  return std::move(recordings_);
}

void CalibrationWalk::walk(const CalibrationStep& step) {
  // Tilted boards say nothing without the one that defines the frame.
  if (step.key == "board_tilted" && recordings_.geometry.boards.empty()) {
    out_ << "  left out: there is no board that lies flat\n";
    return;
  }
  for (int number = 1; number <= step.captures;) {
    if (ask(step, number) == Answer::skip) {
      out_ << "  left out\n";
      return;
    }
    CalibrationRecordings next = recordings_;  // shares the counts
    if (!capture_once(step, number, next)) continue;
    recordings_ = std::move(next);
    ++number;
  }
}

bool CalibrationWalk::capture_once(const CalibrationStep& step, int number,
                                   CalibrationRecordings& next) {
  const std::string name = fmt::format("{} {}", step.key, number);
  try {
    Recording recording;
    recording.role = step.role;
    recording.station_hash = config_.station_hash;
    recording.capture = take(step);
    const Capture capture = recording.capture;
    if (step.height_mm > 0) {
      next.geometry.raised.push_back({step.height_mm / 1000, {name, capture}});
    } else {
      next.add(name, std::move(recording));
    }
    const std::string found = assess(step, next);
    out_ << "  good: " << found << "\n";
    keep(step, number, capture);
    return true;
  } catch (const InputError& error) {
    out_ << "  not usable: " << error.what() << "\n  Put it right and capture again.\n";
    return false;
  }
}

CalibrationWalk::Answer CalibrationWalk::ask(const CalibrationStep& step, int number) {
  out_ << fmt::format("  {} of {}. Enter: capture{}, q: give up > ", number, step.captures,
                      step.optional ? ", s: leave out" : "")
       << std::flush;
  std::string answer;
  if (!std::getline(in_, answer)) {
    throw InputError("standard input", "ended at step '" + step.key + "'",
                     "an answer for every step");
  }
  out_ << "\n";
  if (answer == "q") throw InputError("calibration", "given up at step '" + step.key + "'");
  if (answer == "s" && step.optional) return Answer::skip;
  scene_ = settings_.scenes / ((step.key == "sweep" ? "white" : step.key) + ".yaml");
  if (!answer.empty() && answer != "s") scene_ = answer;
  return Answer::capture;
}

Capture CalibrationWalk::take(const CalibrationStep& step) {
  const bool simulated = config_.camera.backend == CameraBackend::simulated;
  if (simulated) {  // someone has to put the thing there: a bench with it alone, and new chances
    StationConfig bench = config_;
    bench.camera.scenes = {scene_};
    bench.camera.seed += ++captures_;
    station_ = open_station(bench);
  } else if (!station_) {
    station_ = open_station(config_);
  }
  station_->next_part(0);
  switch (step.role) {
    case RecordingRole::dark:
      return capture_dark(*station_, config_.camera);
    case RecordingRole::ptc:
      return capture_sweep(*station_, config_.camera, kSweepPoints);
    default:
      return capture_part(*station_, config_.camera);
  }
}

std::string CalibrationWalk::assess(const CalibrationStep& step,
                                    const CalibrationRecordings& candidate) const {
  switch (step.role) {
    case RecordingRole::dark:
      return dark_text(candidate);
    case RecordingRole::ptc:
      return sweep_text(sensor_calibration(candidate, config_));
    case RecordingRole::board: {
      CalibrationOutcome sensor = sensor_calibration(candidate, config_);
      const bool few = candidate.geometry.boards.size() < kLeastViews;
      return board_text(*calibrate_camera(candidate.geometry, sensor.calibration,
                                          few ? kFirstBoardsRms : kWorstRms));
    }
    default:
      return assess_whole(step, candidate);
  }
}

std::string CalibrationWalk::assess_whole(const CalibrationStep& step,
                                          const CalibrationRecordings& candidate) const {
  CalibrationRequest request = request_;
  request.last.clear();
  const CalibrationOutcome outcome = make_calibration(candidate, request, config_);
  const Calibration& c = outcome.calibration;
  switch (step.role) {
    case RecordingRole::black:
      return stray_text(c);
    case RecordingRole::chart:
      return fmt::format("residual {:.2f} CIEDE2000 mean, {:.2f} max", c.colour->de00_mean,
                         c.colour->de00_max);
    case RecordingRole::part:
      return fmt::format("the patch reflects as a {:.3f} white", EIGEN_PI * c.patch_f[0].mean());
    default:
      break;
  }
  return lights_text(outcome);
}

void CalibrationWalk::keep(const CalibrationStep& step, int number, const Capture& capture) const {
  if (settings_.record.empty()) return;
  Recording recording;
  recording.role = step.role;
  recording.station_hash = config_.station_hash;
  recording.capture = capture;
  write_recording(settings_.record / step.key / fmt::format("part_{:04}", number), recording);
}

}  // namespace brdfgate
