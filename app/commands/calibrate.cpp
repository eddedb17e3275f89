// brdfgate calibrate: recordings of dark, white, board and gauges to one calibration file.
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <map>

#include "app/calibration_file.hpp"
#include "app/calibration_report.hpp"
#include "app/calibration_steps.hpp"
#include "app/calibration_summary.hpp"
#include "app/calibration_work.hpp"
#include "app/commands/commands.hpp"
#include "app/progress.hpp"
#include "app/session.hpp"
#include "model/reference_upkeep.hpp"

namespace brdfgate {
namespace {

struct CalibrateOptions {
  SessionOptions session;
  CalibrationRequest request;
  std::vector<std::filesystem::path> from;
  std::filesystem::path out;
  std::filesystem::path report;  ///< HTML; empty: none
  bool live = false;
  CalibrationWalkSettings walk;
  std::vector<double> white_reflectance{0.99};
  double square_mm = 8;
  double most_drift = 0.05;
  std::vector<std::pair<double, std::filesystem::path>> raised_whites;  ///< height in mm, folder
};

void gather_raised(const CalibrateOptions& options, const StationConfig& config,
                   CalibrationRecordings& gathered) {
  for (const auto& [height_mm, folder] : options.raised_whites) {
    for (const auto& dir : find_recordings(folder)) {
      Recording recording = read_station_recording(dir, config);
      if (recording.role != RecordingRole::white) {
        throw InputError(dir.string(), "is no recording of the white reference", "role: white");
      }
      gathered.geometry.raised.push_back(
          {height_mm / 1000, {dir.string(), std::move(recording.capture)}});
    }
  }
}

CalibrationRecordings gather(const CalibrateOptions& options, const StationConfig& config) {
  CalibrationRecordings gathered = start_recordings(options.request, config);
  const auto folders = find_all_recordings(options.from);
  Progress progress("reading recordings", static_cast<int>(folders.size()));
  for (const auto& dir : folders) {
    gathered.add(dir.string(), read_station_recording(dir, config));
    progress.advance();
  }
  gather_raised(options, config, gathered);
  return gathered;
}

/// The conversation is on stderr: stdout keeps what the command prints otherwise.
CalibrationRecordings walk_through(const CalibrateOptions& options, const StationConfig& config) {
  CalibrationWalkSettings settings = options.walk;
  if (settings.scenes.empty()) settings.scenes = shipped_scenes();
  CalibrationWalk walk(config, options.request, settings, std::cin, std::cerr);
  return walk.run();
}

bool drifted(const CalibrateOptions& options, const CalibrationOutcome& outcome) {
  return std::any_of(outcome.drift.begin(), outcome.drift.end(),
                     [&](double d) { return std::abs(d) > options.most_drift; });
}

void add_white_options(CLI::App& command, CalibrateOptions& o) {
  CalibrationRequest& r = o.request;
  command
      .add_option("--white-reflectance", o.white_reflectance,
                  "certified, of the white plate: one figure, or red green blue")
      ->expected(1, 3)
      ->check(CLI::Range(0.5, 1.0));
  command.add_option("--certificate", r.certificate.number, "number of the plate's certificate");
  command.add_option("--certificate-date", r.certificate.date, "YYYY-MM-DD");
  command.add_option("--certificate-due", r.certificate.due, "YYYY-MM-DD, when it ends");
  command.add_option("--last", r.last, "the calibration before: tells how the lamps drifted");
  command.add_option("--max-drift", o.most_drift, "of a lamp; beyond, the exit code is 1")
      ->check(CLI::Range(0.0, 10.0));
  command.add_option("--black-reflectance", r.black_reflectance, "of the black gauge itself")
      ->check(CLI::Range(0.0, 0.2));
  command.add_option("--white-factor", r.white_factor,
                     "CSV of the white plate's own radiance factor: light,theta_h_deg,factor");
  command.add_option("--white-factor-sigma", r.white_factor_sigma, "its relative uncertainty")
      ->check(CLI::Range(0.0, 0.5));
  command
      .add_option("--max-stray", r.max_stray,
                  "stray light as a share of white that the black gauge may show; beyond: refused")
      ->check(CLI::Range(0.0, 1.0));
}

void add_colour_options(CLI::App& command, CalibrateOptions& o) {
  command.add_option("--chart", o.request.chart,
                     "file of the colour chart, unless the classic 24 patches");
  static const std::map<std::string, ColourModel> models{
      {"matrix", ColourModel::matrix}, {"root-polynomial", ColourModel::root_polynomial}};
  command.add_option("--colour-model", o.request.colour_model, "matrix or root-polynomial")
      ->transform(CLI::CheckedTransformer(models));
}

void add_geometry_options(CLI::App& command, CalibrateOptions& o) {
  CalibrationRequest& r = o.request;
  static const std::map<std::string, BoardKind> kinds{{"checker", BoardKind::checker},
                                                      {"charuco", BoardKind::charuco}};
  command.add_option("--board", r.board.kind, "pattern of the board: checker or charuco")
      ->transform(CLI::CheckedTransformer(kinds));
  command.add_option("--board-columns", r.board.squares_x, "squares along the board's x");
  command.add_option("--board-rows", r.board.squares_y, "squares along the board's y");
  command.add_option("--square-mm", o.square_mm, "side of a square");
  command.add_option("--geometry", r.geometry, "poses measured by hand (YAML) instead of fitted");
  command.add_option("--raised-white", o.raised_whites,
                     "height in mm and folder of the white plate on a spacer");
}

void add_live_options(CLI::App& command, CalibrateOptions& o, CLI::Option* from) {
  CLI::Option* live =
      command.add_flag("--live", o.live, "walk through it on the station, step by step");
  live->excludes(from);
  command.add_option("--record", o.walk.record, "keep the recordings of the walk here")
      ->needs(live);
  command.add_option("--spacer-mm", o.walk.spacer_mm, "height of the spacer under the white plate")
      ->needs(live)
      ->check(CLI::Range(0.1, 100.0));
  command
      .add_option("--scenes", o.walk.scenes,
                  "simulated station: folder of dark.yaml, white.yaml, board.yaml, ...")
      ->needs(live);
}

/// What CLI11 cannot check, and the options that are not in the request's own terms.
void complete(CalibrateOptions& o) {
  if (o.from.empty() && !o.live) {
    throw InputError("calibrate", "neither --from nor --live", "recordings, or the station itself");
  }
  const std::vector<double>& white = o.white_reflectance;
  if (white.size() == 2) {
    throw InputError("--white-reflectance", "two figures", "one, or three: red green blue");
  }
  for (std::size_t c = 0; c < 3; ++c)
    o.request.white_reflectance[c] = white[white.size() == 3 ? c : 0];
  o.request.board.square_m = o.square_mm / 1000;
  const WhiteCertificate& certificate = o.request.certificate;
  for (const auto& [date, where] : {std::pair(certificate.date, "--certificate-date"),
                                    std::pair(certificate.due, "--certificate-due")}) {
    if (!date.empty()) check_date(date, where);
  }
}

int run(const CalibrateOptions& options) {
  const StationConfig config = load_config(options.session);
  const CalibrationRecordings gathered =
      options.live ? walk_through(options, config) : gather(options, config);
  CalibrationOutcome outcome = make_calibration(gathered, options.request, config);
  outcome.calibration.hash = write_calibration(options.out, outcome.calibration);
  if (!options.report.empty()) write_calibration_report(options.report, outcome, gathered);
  if (options.session.json) {
    fmt::print("{}\n", calibration_json(outcome, gathered).dump(2));
  } else {
    print_calibration(outcome, gathered, options.out);
  }
  return drifted(options, outcome) ? kExitNo : kExitYes;
}

}  // namespace

/// Beginners get the two things that they must record; the rest is optional and said to be.
void add_calibrate(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<CalibrateOptions>();
  CLI::App* command = tool.add_subcommand(
      "calibrate", "noise, white reference and geometry from calibration recordings");
  options->session.add_to(*command);
  CLI::Option* from = command->add_option(
      "--from", options->from,
      "folders with dark, white, ptc, board, mirror, black, chart recordings, and "
      "of the open nest");
  add_live_options(*command, *options, from);
  command->add_option("--out", options->out, "calibration file to write (.exr)")->required();
  command->add_option("--report", options->report, "write a report with pictures (.html) here");
  add_white_options(*command, *options);
  add_colour_options(*command, *options);
  add_geometry_options(*command, *options);
  command->callback([options, &exit_code] {
    complete(*options);
    exit_code = run(*options);
  });
}

}  // namespace brdfgate
