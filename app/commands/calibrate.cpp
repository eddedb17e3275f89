// brdfgate calibrate: recordings of dark, white, board and gauges to one calibration file.
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <map>
#include <nlohmann/json.hpp>

#include "app/calibration_file.hpp"
#include "app/commands/commands.hpp"
#include "app/hand_geometry.hpp"
#include "app/progress.hpp"
#include "app/session.hpp"
#include "app/white_factor_file.hpp"
#include "config/chart_reader.hpp"
#include "model/camera_colour.hpp"
#include "model/lamp_monitor.hpp"
#include "model/linearity.hpp"
#include "model/reference_upkeep.hpp"

namespace brdfgate {
namespace {

std::array<double, 3> per_channel(const std::vector<double>& given) {
  if (given.size() == 1) return {given[0], given[0], given[0]};
  return {given.at(0), given.at(1), given.at(2)};
}

struct CalibrateOptions {
  SessionOptions session;
  std::vector<std::filesystem::path> from;
  std::filesystem::path out;
  std::vector<double> white_reflectance{0.99};
  WhiteCertificate certificate;
  std::filesystem::path last;  ///< the calibration before this one
  double most_drift = 0.05;
  BoardPattern board;
  double square_mm = 8;
  std::filesystem::path geometry;
  std::vector<std::pair<double, std::filesystem::path>> raised_whites;  ///< height in mm, folder
  std::filesystem::path chart;  ///< file of another chart than the classic one
  ColourModel colour_model = ColourModel::matrix;
  std::filesystem::path white_factor;
  double white_factor_sigma = 0.005;
};

/// Everything that was recorded, by what it is for.
struct Gathered {
  CalibrationInput levels;
  GeometryInput geometry;
  std::vector<NamedCapture> blacks;
  std::vector<Capture> sweep;
  std::vector<NamedCapture> charts;
  std::vector<NamedCapture> nests;  ///< open, or a part in it: the monitor patch is in view
};

Recording read_checked(const std::filesystem::path& dir, const StationConfig& config) {
  Recording recording = read_recording(dir);
  if (recording.station_hash != config.station_hash) {
    throw InputError((dir / "recording.yaml").string(), "was captured on another sensor or rig",
                     "station " + config.station_hash.substr(0, 16));
  }
  return recording;
}

void sort_in(const std::filesystem::path& dir, Recording&& recording, Gathered& gathered) {
  switch (recording.role) {
    case RecordingRole::dark:
      gathered.levels.darks.push_back(std::move(recording.capture));
      return;
    case RecordingRole::white:
      gathered.levels.whites.push_back(std::move(recording.capture));
      return;
    case RecordingRole::board:
      gathered.geometry.boards.push_back({dir.string(), std::move(recording.capture)});
      return;
    case RecordingRole::mirror:
      gathered.geometry.mirrors.push_back({dir.string(), std::move(recording.capture)});
      return;
    case RecordingRole::black:
      gathered.blacks.push_back({dir.string(), std::move(recording.capture)});
      return;
    case RecordingRole::ptc:
      gathered.sweep.push_back(std::move(recording.capture));
      return;
    case RecordingRole::chart:
      gathered.charts.push_back({dir.string(), std::move(recording.capture)});
      return;
    case RecordingRole::part:
      gathered.nests.push_back({dir.string(), std::move(recording.capture)});
      return;
  }
}

void gather_raised(const CalibrateOptions& options, const StationConfig& config,
                   Gathered& gathered) {
  for (const auto& [height_mm, folder] : options.raised_whites) {
    for (const auto& dir : find_recordings(folder)) {
      Recording recording = read_checked(dir, config);
      if (recording.role != RecordingRole::white) {
        throw InputError(dir.string(), "is no recording of the white reference", "role: white");
      }
      gathered.geometry.raised.push_back(
          {height_mm / 1000, {dir.string(), std::move(recording.capture)}});
    }
  }
}

Gathered gather(const CalibrateOptions& options, const StationConfig& config) {
  Gathered gathered;
  CalibrationInput& levels = gathered.levels;
  levels.geometry = make_geometry(config.rig, config.camera.sensor);
  levels.nominal = config.camera.noise;
  levels.white_reflectance = per_channel(options.white_reflectance);
  GeometryInput& geometry = gathered.geometry;
  geometry.pattern = options.board;
  geometry.pattern.square_m = options.square_mm / 1000;
  check_pattern(geometry.pattern);
  geometry.plate_m = {config.inspection.region_mm[0] / 1000, config.inspection.region_mm[1] / 1000};
  if (!options.geometry.empty()) {
    geometry.by_hand = read_hand_geometry(options.geometry, levels.geometry);
  }
  const auto folders = find_all_recordings(options.from);
  Progress progress("reading recordings", static_cast<int>(folders.size()));
  for (const auto& dir : folders) {
    sort_in(dir, read_checked(dir, config), gathered);
    progress.advance();
  }
  gather_raised(options, config, gathered);
  return gathered;
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

/// What a calibration finds besides noise, white and geometry.
struct Upkeep {
  std::optional<PhotonTransfer> sweep;
  std::vector<double> drift;  ///< per light against the last calibration; empty: none given
  std::optional<int> days_until_due;
};

/// Gain and read noise from the sweep where there is one: it spans the whole range.
void use_sweep(const Gathered& gathered, Calibration& calibration, Upkeep& upkeep) {
  if (gathered.sweep.empty()) return;
  upkeep.sweep = photon_transfer(gathered.sweep, calibration.sensor.black_level_dn);
  if (!upkeep.sweep->linear()) {
    throw InputError("photon-transfer sweep",
                     fmt::format("the camera is not linear: its signal deviates by {:.1f} % from "
                                 "its exposure times",
                                 upkeep.sweep->linearity_percent),
                     fmt::format("under {:.0f} %: raw counts, gamma and automatic exposure off",
                                 PhotonTransfer::kLinearLimit));
  }
  calibration.noise.gain_dn_per_e = upkeep.sweep->gain_dn_per_e;
}

/// Worst of several black recordings, per light.
void measure_stray(const Gathered& gathered, Calibration& calibration) {
  for (const NamedCapture& black : gathered.blacks) {
    Capture levelled = black.capture;  // shares the counts
    levelled.sensor = calibration.sensor;
    const int lights = static_cast<int>(calibration.white.size());
    const auto share =
        stray_share(to_radiance(levelled, calibration.noise, lights).lights, calibration);
    if (calibration.stray_share.empty()) calibration.stray_share.resize(share.size(), -1);
    for (std::size_t l = 0; l < share.size(); ++l)
      calibration.stray_share[l] = std::max(calibration.stray_share[l], share[l]);
  }
}

/// What the chart's patches looked like to the camera, for the report.
struct ChartSeen {
  ColourChart chart;
  std::vector<Eigen::Array3d> rgb;  ///< mean over the recordings
};

/// Camera RGB to XYZ from the recordings of the chart, where there are any.
std::optional<ChartSeen> calibrate_colour(const CalibrateOptions& options, const Gathered& gathered,
                                          Calibration& calibration) {
  if (gathered.charts.empty()) return std::nullopt;
  ChartSeen seen;
  seen.chart = options.chart.empty() ? classic_chart() : read_chart(options.chart);
  seen.rgb.assign(seen.chart.patches.size(), Eigen::Array3d::Zero());
  const double n = static_cast<double>(gathered.charts.size());
  for (const NamedCapture& chart : gathered.charts) {
    Capture levelled = chart.capture;  // shares the counts
    levelled.sensor = calibration.sensor;
    const int lights = static_cast<int>(calibration.white.size());
    try {
      const auto f = to_reflectance(to_radiance(levelled, calibration.noise, lights), calibration);
      const auto rgb = chart_rgb(f, calibration, seen.chart);
      for (std::size_t i = 0; i < rgb.size(); ++i)
        seen.rgb[i] += rgb[i] / n;
    } catch (const InputError& error) {
      throw InputError(chart.name, error.what());
    }
  }
  calibration.colour = fit_camera_colour(seen.rgb, seen.chart, options.colour_model);
  return seen;
}

/// The patch's own reflectance, of the last recording in which it is in view.
void measure_monitor(const Gathered& gathered, const StationConfig& config,
                     Calibration& calibration) {
  for (const NamedCapture& nest : gathered.nests) {
    if (!config.inspection.monitor) {
      throw InputError(nest.name, "is of a part or the open nest, which calibrates a monitor patch",
                       "inspection.monitor in the station file, or no such recording");
    }
    Capture levelled = nest.capture;  // shares the counts
    levelled.sensor = calibration.sensor;
    const int lights = static_cast<int>(calibration.white.size());
    try {
      calibration.patch_f = measure_patch(to_radiance(levelled, calibration.noise, lights).lights,
                                          calibration, *config.inspection.monitor);
    } catch (const InputError& error) {
      throw InputError(nest.name, error.what());
    }
  }
}

/// Geometry, with the white reference freed of its own radiance factor where that is known: first
/// with the angles of the rig as drawn, in the end with those found.
GeometryResult place(const CalibrateOptions& options, const Gathered& gathered,
                     Calibration& calibration) {
  if (options.white_factor.empty()) return calibrate_geometry(gathered.geometry, calibration);
  WhiteFactorTable table = read_white_factor(options.white_factor, calibration.white.size());
  table.sigma = options.white_factor_sigma;
  const StationGeometry drawn = calibration.geometry;
  apply_white_factor(table, drawn, calibration);
  const GeometryResult found = calibrate_geometry(gathered.geometry, calibration);
  apply_white_factor(table, drawn, calibration, true);
  apply_white_factor(table, calibration.geometry, calibration);
  return found;
}

void compare_with_last(const CalibrateOptions& options, const Calibration& calibration,
                       Upkeep& upkeep) {
  if (options.last.empty()) return;
  const Calibration last = read_calibration(options.last);
  if (last.station_hash != calibration.station_hash) {
    throw InputError(options.last.string(), "is of another sensor or rig",
                     "station " + calibration.station_hash.substr(0, 16));
  }
  upkeep.drift = lamp_drift(last, calibration);
}

bool drifted(const CalibrateOptions& options, const Upkeep& upkeep) {
  return std::any_of(upkeep.drift.begin(), upkeep.drift.end(),
                     [&](double d) { return std::abs(d) > options.most_drift; });
}

nlohmann::json place(const Eigen::Vector3d& position_W, const PlaceQuality& quality) {
  static constexpr std::array<const char*, 3> kSource{"nominal", "fitted", "by_hand"};
  return {{"position_mm", {1e3 * position_W.x(), 1e3 * position_W.y(), 1e3 * position_W.z()}},
          {"source", kSource.at(static_cast<std::size_t>(quality.source))},
          {"sigma_mm", 1e3 * quality.sigma_m}};
}

nlohmann::json camera_report(const Calibration& c, const GeometryResult& found) {
  nlohmann::json out = place(c.geometry.camera.position(), c.quality.camera);
  const PinholeCamera& camera = c.geometry.camera;
  const LensDistortion& d = camera.distortion;
  out["focal_px"] = camera.focal_px;
  out["centre_px"] = {camera.centre_px.x(), camera.centre_px.y()};
  out["distortion"] = {d.k1, d.k2, d.p1, d.p2, d.k3};
  if (found.camera) {
    out["rms_px"] = found.camera->rms_px;
    out["view_rms_px"] = found.camera->view_rms_px;
    out["intrinsics"] = found.camera->intrinsics ? "fitted" : "nominal";
    out["focal_sigma_px"] = found.camera->focal_sigma_px;
  }
  return out;
}

nlohmann::json lights_report(const Calibration& c, const GeometryResult& found) {
  nlohmann::json out = nlohmann::json::array();
  for (std::size_t l = 0; l < c.geometry.lights_W.size(); ++l) {
    const PlaceQuality quality = l < c.quality.lights.size() ? c.quality.lights[l] : PlaceQuality{};
    out.push_back(place(c.geometry.lights_W[l], quality));
    out.back()["residual_rms"] = quality.residual;
    if (found.lights) out.back()["highlight"] = found.lights->lights[l].from_highlight;
  }
  return out;
}

nlohmann::json colour_report(const CameraColour& colour, const ChartSeen& seen) {
  const std::vector<double> residuals = chart_residuals(colour, seen.rgb, seen.chart);
  nlohmann::json patches = nlohmann::json::array();
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    const Eigen::Array3d& xyz = seen.chart.patches[i].xyz;
    const Eigen::Array3d& rgb = seen.rgb[i];
    patches.push_back({{"name", seen.chart.patches[i].name},
                       {"rgb", {rgb[0], rgb[1], rgb[2]}},
                       {"xyz", {xyz[0], xyz[1], xyz[2]}},
                       {"de00", residuals[i]}});
  }
  nlohmann::json rows = nlohmann::json::array();
  for (Eigen::Index r = 0; r < 3; ++r) {
    rows.emplace_back(
        std::vector<double>(colour.to_xyz.row(r).begin(), colour.to_xyz.row(r).end()));
  }
  return {{"chart", colour.chart},
          {"chart_illuminant", colour.illuminant},
          {"illuminant", "D65"},
          {"observer_deg", 2},
          {"to_xyz", rows},
          {"de00_mean", colour.de00_mean},
          {"de00_max", colour.de00_max},
          {"patches", patches}};
}

void add_upkeep(nlohmann::json& out, const Calibration& c, const Upkeep& upkeep) {
  if (upkeep.sweep) {
    out["photon_transfer"] = {{"points", upkeep.sweep->points.size()},
                              {"gain_dn_per_electron", upkeep.sweep->gain_dn_per_e},
                              {"read_noise_dn", upkeep.sweep->read_noise_dn},
                              {"full_well_dn", upkeep.sweep->full_well_dn},
                              {"saturation_electrons", upkeep.sweep->saturation_e},
                              {"linearity_percent", upkeep.sweep->linearity_percent}};
  }
  if (!upkeep.drift.empty()) out["lamp_drift"] = upkeep.drift;
  if (!c.stray_share.empty()) out["stray_share"] = c.stray_share;
  out["white_sigma"] = c.white_sigma;
  if (!c.white_factor.empty()) out["white_factor"] = c.white_factor;
  for (const Eigen::Array3d& f : c.patch_f)
    out["monitor_patch_f"].push_back({f[0], f[1], f[2]});
  if (upkeep.days_until_due) {
    out["days_until_due"] = *upkeep.days_until_due;
    out["calibration_due"] = *upkeep.days_until_due < 0;
  }
}

nlohmann::json report(const Calibration& c, const Gathered& from, const GeometryResult& found) {
  nlohmann::json out = {{"schema", "brdfgate.calibration_report/1"},
                        {"hash", c.hash},
                        {"darks", from.levels.darks.size()},
                        {"whites", from.levels.whites.size()},
                        {"boards", from.geometry.boards.size()},
                        {"mirrors", from.geometry.mirrors.size()},
                        {"black_level_dn", c.sensor.black_level_dn},
                        {"read_noise_dn", c.noise.read_noise_dn},
                        {"gain_dn_per_electron", c.noise.gain_dn_per_e},
                        {"camera", camera_report(c, found)},
                        {"lights", lights_report(c, found)}};
  if (found.lights) {
    out["emission_exponent"] = found.lights->emission;
    out["vignetting"] = {found.lights->vignetting.x(), found.lights->vignetting.y()};
  }
  return out;
}

void print_place(const std::string& name, const Eigen::Vector3d& p, const PlaceQuality& quality) {
  if (quality.source == GeometrySource::nominal) {
    fmt::print("{}: as configured, not calibrated\n", name);
    return;
  }
  fmt::print("{}: at {:.2f}, {:.2f}, {:.2f} mm, +- {:.2f} mm, {}\n", name, 1e3 * p.x(), 1e3 * p.y(),
             1e3 * p.z(), 1e3 * quality.sigma_m,
             quality.source == GeometrySource::by_hand ? "measured by hand" : "fitted");
}

void print_summary(const Calibration& c, const Gathered& from, const GeometryResult& found,
                   const std::filesystem::path& file) {
  fmt::print(
      "{}: black level {:.2f} DN, read noise {:.3f} DN, gain {:.4f} DN per electron, from {} dark "
      "and {} white recordings\n",
      file.string(), c.sensor.black_level_dn, c.noise.read_noise_dn, c.noise.gain_dn_per_e,
      from.levels.darks.size(), from.levels.whites.size());
  print_place("camera", c.geometry.camera.position(), c.quality.camera);
  if (found.camera) {
    fmt::print("  {} boards, reprojection error {:.3f} px rms, {}\n",
               found.camera->view_rms_px.size(), found.camera->rms_px,
               found.camera->intrinsics ? "focal length and distortion fitted"
                                        : "focal length as configured (5 boards would fit it)");
  }
  for (std::size_t l = 0; l < c.geometry.lights_W.size(); ++l) {
    const PlaceQuality quality = l < c.quality.lights.size() ? c.quality.lights[l] : PlaceQuality{};
    print_place("light " + std::to_string(l + 1), c.geometry.lights_W[l], quality);
  }
}

void print_upkeep(const Calibration& c, const Upkeep& upkeep) {
  if (upkeep.sweep) {
    fmt::print(
        "photon transfer: {} exposures, full well at {:.0f} DN ({:.0f} electrons), linear "
        "within {:.2f} %\n",
        upkeep.sweep->points.size(), upkeep.sweep->full_well_dn, upkeep.sweep->saturation_e,
        upkeep.sweep->linearity_percent);
  }
  for (std::size_t l = 0; l < upkeep.drift.size(); ++l)
    fmt::print("light {}: {:+.2f} % since the last calibration\n", l + 1, 100 * upkeep.drift[l]);
  for (std::size_t l = 0; l < c.stray_share.size(); ++l)
    fmt::print("light {}: the black gauge shows {:.3f} % of white\n", l + 1,
               100 * c.stray_share[l]);
  for (std::size_t l = 0; l < c.patch_f.size(); ++l)
    fmt::print("light {}: the monitor patch reflects as a {:.3f} white\n", l + 1,
               EIGEN_PI * c.patch_f[l].mean());
  if (c.colour) {
    fmt::print("colour: {} ({}) to XYZ, D65, 2 deg; residual {:.2f} CIEDE2000 mean, {:.2f} max\n",
               c.colour->chart, c.colour->illuminant, c.colour->de00_mean, c.colour->de00_max);
  }
  fmt::print("white reference: {}, f uncertain by {:.1f} % in common\n",
             c.white_factor.empty() ? "taken for Lambertian" : c.white_factor, 100 * c.white_sigma);
  if (!upkeep.days_until_due) return;
  if (*upkeep.days_until_due < 0) {
    fmt::print("calibration_due: the white reference's certificate ended on {}\n",
               c.certificate.due);
  } else {
    fmt::print("white reference: certified for {} more days\n", *upkeep.days_until_due);
  }
}

/// Beginners get the two things that they must record; the rest is optional and said to be.
void add_options(CLI::App& command, CalibrateOptions& o) {
  o.session.add_to(command);
  command
      .add_option(
          "--from", o.from,
          "folders with dark, white, board, mirror, black, chart recordings, and of the open nest")
      ->required();
  command.add_option("--out", o.out, "calibration file to write (.exr)")->required();
  command
      .add_option("--white-reflectance", o.white_reflectance,
                  "certified, of the white plate: one figure, or red green blue")
      ->expected(1, 3)
      ->check(CLI::Range(0.5, 1.0));
  static const std::map<std::string, BoardKind> kinds{{"checker", BoardKind::checker},
                                                      {"charuco", BoardKind::charuco}};
  command.add_option("--board", o.board.kind, "pattern of the board: checker or charuco")
      ->transform(CLI::CheckedTransformer(kinds));
  command.add_option("--board-columns", o.board.squares_x, "squares along the board's x");
  command.add_option("--board-rows", o.board.squares_y, "squares along the board's y");
  command.add_option("--square-mm", o.square_mm, "side of a square");
  command.add_option("--geometry", o.geometry, "poses measured by hand (YAML) instead of fitted");
  command.add_option("--certificate", o.certificate.number, "number of the plate's certificate");
  command.add_option("--certificate-date", o.certificate.date, "YYYY-MM-DD");
  command.add_option("--certificate-due", o.certificate.due, "YYYY-MM-DD, when it ends");
  command.add_option("--last", o.last, "the calibration before: tells how the lamps drifted");
  command.add_option("--max-drift", o.most_drift, "of a lamp; beyond, the exit code is 1")
      ->check(CLI::Range(0.0, 10.0));
  command.add_option("--chart", o.chart, "file of the colour chart, unless the classic 24 patches");
  static const std::map<std::string, ColourModel> models{
      {"matrix", ColourModel::matrix}, {"root-polynomial", ColourModel::root_polynomial}};
  command.add_option("--colour-model", o.colour_model, "matrix or root-polynomial")
      ->transform(CLI::CheckedTransformer(models));
  command.add_option("--white-factor", o.white_factor,
                     "CSV of the white plate's own radiance factor: light,theta_h_deg,factor");
  command.add_option("--white-factor-sigma", o.white_factor_sigma, "its relative uncertainty")
      ->check(CLI::Range(0.0, 0.5));
  command.add_option("--raised-white", o.raised_whites,
                     "height in mm and folder of the white plate on a spacer");
}

}  // namespace

void add_calibrate(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<CalibrateOptions>();
  CLI::App* command = tool.add_subcommand(
      "calibrate", "noise, white reference and geometry from calibration recordings");
  add_options(*command, *options);
  command->callback([options, &exit_code] {
    if (options->white_reflectance.size() == 2) {
      throw InputError("--white-reflectance", "two figures", "one, or three: red green blue");
    }
    for (const auto& [date, where] : {std::pair(options->certificate.date, "--certificate-date"),
                                      std::pair(options->certificate.due, "--certificate-due")}) {
      if (!date.empty()) check_date(date, where);
    }
    const StationConfig config = load_config(options->session);
    const Gathered gathered = gather(*options, config);
    Calibration calibration = calibrate(gathered.levels);
    Upkeep upkeep;
    use_sweep(gathered, calibration, upkeep);
    const GeometryResult found = place(*options, gathered, calibration);
    measure_stray(gathered, calibration);
    measure_monitor(gathered, config, calibration);
    const auto chart = calibrate_colour(*options, gathered, calibration);
    calibration.station_hash = config.station_hash;
    calibration.created = utc_now();
    calibration.certificate = options->certificate;
    upkeep.days_until_due =
        days_until_due(calibration.certificate, calibration.created.substr(0, 10));
    compare_with_last(*options, calibration, upkeep);
    calibration.hash = write_calibration(options->out, calibration);
    if (options->session.json) {
      nlohmann::json out = report(calibration, gathered, found);
      add_upkeep(out, calibration, upkeep);
      if (chart) out["colour"] = colour_report(*calibration.colour, *chart);
      fmt::print("{}\n", out.dump(2));
    } else {
      print_summary(calibration, gathered, found, options->out);
      print_upkeep(calibration, upkeep);
    }
    exit_code = drifted(*options, upkeep) ? kExitNo : kExitYes;
  });
}

}  // namespace brdfgate
