#include "app/calibration_work.hpp"

#include <fmt/core.h>

#include <algorithm>

#include "app/calibration_file.hpp"
#include "app/hand_geometry.hpp"
#include "app/utc_time.hpp"
#include "app/white_factor_file.hpp"
#include "config/chart_reader.hpp"
#include "model/error.hpp"
#include "model/lamp_monitor.hpp"
#include "model/reference_upkeep.hpp"
#include "model/reflectance.hpp"
#include "model/response.hpp"

namespace brdfgate {
namespace {

/// What the sweep tells of the sensor: its noise and full well, or its tone curve.
void use_sweep(const CalibrationRecordings& recordings, const StationConfig& config,
               CalibrationInput& levels, CalibrationOutcome& out) {
  if (config.camera.tone_curve) {
    if (recordings.sweep.empty()) {
      throw InputError("calibration", "no recording of the camera's tone curve",
                       "role: ptc of the white reference (brdfgate capture --role ptc)");
    }
    levels.response = recover_response(recordings.sweep);
    return;
  }
  if (recordings.sweep.empty()) return;
  out.sweep = photon_transfer(recordings.sweep, measure_darks(levels).black_level_dn);
  if (!out.sweep->linear()) {
    throw InputError("photon-transfer sweep",
                     fmt::format("the camera is not linear: its signal deviates by {:.1f} % from "
                                 "its exposure times",
                                 out.sweep->linearity_percent),
                     fmt::format("under {:.0f} %: raw counts, gamma and automatic exposure off; or "
                                 "camera.sensor.response: tone_curve",
                                 PhotonTransfer::kLinearLimit));
  }
  levels.gain_dn_per_e = out.sweep->gain_dn_per_e;
  levels.full_well_dn = out.sweep->full_well_dn;
}

/// Worst of several black recordings, per light.
void measure_stray(const CalibrationRecordings& recordings, Calibration& calibration) {
  for (const NamedCapture& black : recordings.blacks) {
    std::vector<double> share;
    try {
      share = stray_share(to_radiance(black.capture, calibration).lights, calibration);
    } catch (const InputError& error) {
      throw InputError(black.name, error.what());
    }
    if (calibration.stray_share.empty()) calibration.stray_share.resize(share.size(), -1);
    for (std::size_t l = 0; l < share.size(); ++l)
      calibration.stray_share[l] = std::max(calibration.stray_share[l], share[l]);
  }
}

/// Camera RGB to XYZ from the recordings of the chart, where there are any.
void calibrate_colour(const CalibrationRecordings& recordings, const CalibrationRequest& request,
                      CalibrationOutcome& out) {
  if (recordings.charts.empty()) return;
  Calibration& calibration = out.calibration;
  ChartSeen seen;
  seen.chart = request.chart.empty() ? classic_chart() : read_chart(request.chart);
  seen.rgb.assign(seen.chart.patches.size(), Eigen::Array3d::Zero());
  const double n = static_cast<double>(recordings.charts.size());
  for (const NamedCapture& chart : recordings.charts) {
    try {
      const auto f = to_reflectance(to_radiance(chart.capture, calibration), calibration);
      const auto rgb = chart_rgb(f, calibration, seen.chart);
      for (std::size_t i = 0; i < rgb.size(); ++i)
        seen.rgb[i] += rgb[i] / n;
    } catch (const InputError& error) {
      throw InputError(chart.name, error.what());
    }
  }
  calibration.colour = fit_camera_colour(seen.rgb, seen.chart, request.colour_model);
  out.chart = std::move(seen);
}

/// The patch's own reflectance, of the last recording in which it is in view.
void measure_monitor(const CalibrationRecordings& recordings, const StationConfig& config,
                     Calibration& calibration) {
  for (const NamedCapture& nest : recordings.nests) {
    if (!config.inspection.monitor) {
      throw InputError(nest.name, "is of a part or the open nest, which calibrates a monitor patch",
                       "inspection.monitor in the station file, or no such recording");
    }
    try {
      calibration.patch_f = measure_patch(to_radiance(nest.capture, calibration).lights,
                                          calibration, *config.inspection.monitor);
    } catch (const InputError& error) {
      throw InputError(nest.name, error.what());
    }
  }
}

/// Geometry, with the white reference freed of its own radiance factor where that is known: first
/// with the angles of the rig as drawn, in the end with those found.
GeometryResult place(const CalibrationRecordings& recordings, const CalibrationRequest& request,
                     Calibration& calibration) {
  if (request.white_factor.empty()) return calibrate_geometry(recordings.geometry, calibration);
  WhiteFactorTable table = read_white_factor(request.white_factor, calibration.white.size());
  table.sigma = request.white_factor_sigma;
  const StationGeometry drawn = calibration.geometry;
  apply_white_factor(table, drawn, calibration);
  const GeometryResult found = calibrate_geometry(recordings.geometry, calibration);
  apply_white_factor(table, drawn, calibration, true);
  apply_white_factor(table, calibration.geometry, calibration);
  return found;
}

void check_stray(const CalibrationRecordings& recordings, const CalibrationRequest& request,
                 CalibrationOutcome& out) {
  const std::vector<double>& share = out.calibration.stray_share;
  for (std::size_t l = 0; l < share.size(); ++l) {
    const double stray = share[l] - request.black_reflectance / request.white_reflectance[0];
    const std::string what =
        fmt::format("light {}: the black gauge shows {:.2f} % of white, {:.2f} % more than its own",
                    l + 1, 100 * share[l], 100 * stray);
    if (stray > request.max_stray) {
      throw InputError(recordings.blacks.front().name, what,
                       fmt::format("at most {:.2f} % (--max-stray): cover what shines or reflects "
                                   "around the part; is it the black gauge?",
                                   100 * request.max_stray));
    }
    if (stray > kStrayToMention) out.warnings.push_back(what + ": stray light or reflections");
  }
}

void compare_with_last(const CalibrationRequest& request, CalibrationOutcome& out) {
  if (request.last.empty()) return;
  const Calibration last = read_calibration(request.last);
  if (last.station_hash != out.calibration.station_hash) {
    throw InputError(request.last.string(), "is of another sensor or rig",
                     "station " + out.calibration.station_hash.substr(0, 16));
  }
  out.drift = lamp_drift(last, out.calibration);
}

}  // namespace

void CalibrationRecordings::add(const std::string& name, Recording&& recording) {
  switch (recording.role) {
    case RecordingRole::dark:
      levels.darks.push_back(std::move(recording.capture));
      return;
    case RecordingRole::white:
      levels.whites.push_back(std::move(recording.capture));
      return;
    case RecordingRole::board:
      geometry.boards.push_back({name, std::move(recording.capture)});
      return;
    case RecordingRole::mirror:
      geometry.mirrors.push_back({name, std::move(recording.capture)});
      return;
    case RecordingRole::black:
      blacks.push_back({name, std::move(recording.capture)});
      return;
    case RecordingRole::ptc:
      sweep.push_back(std::move(recording.capture));
      return;
    case RecordingRole::chart:
      charts.push_back({name, std::move(recording.capture)});
      return;
    case RecordingRole::part:
      nests.push_back({name, std::move(recording.capture)});
      return;
  }
}

CalibrationRecordings start_recordings(const CalibrationRequest& request,
                                       const StationConfig& config) {
  CalibrationRecordings out;
  out.levels.geometry = make_geometry(config.rig, config.camera.sensor);
  out.levels.nominal = config.camera.noise;
  out.levels.white_reflectance = request.white_reflectance;
  out.geometry.pattern = request.board;
  check_pattern(out.geometry.pattern);
  out.geometry.plate_m = {config.inspection.region_mm[0] / 1000,
                          config.inspection.region_mm[1] / 1000};
  if (!request.geometry.empty()) {
    out.geometry.by_hand = read_hand_geometry(request.geometry, out.levels.geometry);
  }
  return out;
}

CalibrationOutcome make_calibration(const CalibrationRecordings& recordings,
                                    const CalibrationRequest& request,
                                    const StationConfig& config) {
  CalibrationOutcome out;
  CalibrationInput levels = recordings.levels;  // shares the counts
  use_sweep(recordings, config, levels, out);
  Calibration& calibration = out.calibration;
  calibration = calibrate(levels);
  out.geometry = place(recordings, request, calibration);
  measure_stray(recordings, calibration);
  measure_monitor(recordings, config, calibration);
  calibrate_colour(recordings, request, out);
  check_stray(recordings, request, out);
  calibration.station_hash = config.station_hash;
  calibration.created = utc_now();
  calibration.certificate = request.certificate;
  out.days_until_due =
      days_until_due(calibration, config.upkeep.max_age_days, calibration.created.substr(0, 10));
  compare_with_last(request, out);
  return out;
}

CalibrationOutcome sensor_calibration(const CalibrationRecordings& recordings,
                                      const StationConfig& config) {
  CalibrationOutcome out;
  CalibrationInput levels = recordings.levels;  // shares the counts
  Calibration& calibration = out.calibration;
  const DarkLevels dark = measure_darks(levels);
  if (!recordings.sweep.empty()) use_sweep(recordings, config, levels, out);
  calibration.sensor = levels.darks.front().sensor;
  calibration.sensor.black_level_dn = dark.black_level_dn;
  calibration.noise = levels.nominal;
  calibration.noise.read_noise_dn = dark.read_noise_dn;
  calibration.response = levels.response;
  calibration.geometry = levels.geometry;
  calibration.quality.lights.resize(calibration.geometry.lights_W.size());
  return out;
}

Recording read_station_recording(const std::filesystem::path& dir, const StationConfig& config) {
  Recording recording = read_recording(dir);
  if (recording.station_hash != config.station_hash) {
    throw InputError((dir / "recording.yaml").string(), "was captured on another sensor or rig",
                     "station " + config.station_hash.substr(0, 16));
  }
  return recording;
}

}  // namespace brdfgate
