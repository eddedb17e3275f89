#include "app/calibration_summary.hpp"

#include <fmt/core.h>

#include <array>

namespace brdfgate {
namespace {

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

void add_upkeep(nlohmann::json& out, const CalibrationOutcome& upkeep) {
  const Calibration& c = upkeep.calibration;
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

nlohmann::json found_json(const Calibration& c, const CalibrationRecordings& from,
                          const GeometryResult& found) {
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

void print_summary(const Calibration& c, const CalibrationRecordings& from,
                   const GeometryResult& found, const std::filesystem::path& file) {
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

void print_upkeep(const CalibrationOutcome& upkeep) {
  const Calibration& c = upkeep.calibration;
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

}  // namespace

nlohmann::json calibration_json(const CalibrationOutcome& outcome,
                                const CalibrationRecordings& from) {
  nlohmann::json out = found_json(outcome.calibration, from, outcome.geometry);
  add_upkeep(out, outcome);
  if (outcome.chart) out["colour"] = colour_report(*outcome.calibration.colour, *outcome.chart);
  out["warnings"] = outcome.warnings;
  return out;
}

void print_calibration(const CalibrationOutcome& outcome, const CalibrationRecordings& from,
                       const std::filesystem::path& file) {
  print_summary(outcome.calibration, from, outcome.geometry, file);
  print_upkeep(outcome);
  for (const std::string& warning : outcome.warnings)
    fmt::print("warning: {}\n", warning);
}

}  // namespace brdfgate
