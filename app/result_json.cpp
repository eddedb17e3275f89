#include "app/result_json.hpp"

#include <cmath>
#include <fstream>

#include "app/rules_json.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

using nlohmann::json;

/// JSON has no NaN: a value that could not be had is null.
json finite(double v) {
  return std::isfinite(v) ? json(v) : json(nullptr);
}

/// Channel by channel, then component.
json by_channel(const Eigen::MatrixXd& m) {
  json channels = json::array();
  for (Eigen::Index ch = 0; ch < m.cols(); ++ch) {
    json column = json::array();
    for (Eigen::Index i = 0; i < m.rows(); ++i)
      column.push_back(finite(m(i, ch)));
    channels.push_back(std::move(column));
  }
  return channels;
}

json as_list(const Eigen::VectorXd& values) {
  json list = json::array();
  for (const double v : values)
    list.push_back(finite(v));
  return list;
}

json as_list(const std::vector<double>& values) {
  return as_list(Eigen::VectorXd(
      Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()))));
}

/// {20, 60, 85}: what `of` says of each gloss.
template <typename Of>
json by_gloss_angle(const ClusterReadings& r, Of&& of) {
  return {{"20", of(r.gloss[0])}, {"60", of(r.gloss[1])}, {"85", of(r.gloss[2])}};
}

json bounds(const std::array<double, 2>& b) {
  return {finite(b[0]), finite(b[1])};
}

json lab_json(const ColourReading& colour, double Reading::* field) {
  return {finite(colour.lab[0].*field), finite(colour.lab[1].*field), finite(colour.lab[2].*field)};
}

/// Haze, the aspecular colours and the flop (ASTM D4039, E2194).
json appearance_to_json(const ClusterReadings& r) {
  json aspecular = json::object();
  for (std::size_t i = 0; i < kAspecularDeg.size(); ++i) {
    aspecular[std::to_string(std::lround(kAspecularDeg[i]))] = {
        {"lab", lab_json(r.aspecular[i], &Reading::value)},
        {"lab_sigma", lab_json(r.aspecular[i], &Reading::sigma)},
        {"lightness_sigma", finite(r.aspecular[i].lab[0].sigma)},
        {"measured", r.aspecular[i].lab[0].measured}};
  }
  return {{"aspecular_deg", aspecular},         {"flop_index", finite(r.flop.value)},
          {"flop_sigma", finite(r.flop.sigma)}, {"flop_measured", r.flop.measured},
          {"haze_gu", finite(r.haze.value)},    {"haze_sigma_gu", finite(r.haze.sigma)},
          {"haze_measured", r.haze.measured}};
}

/// Uncertainties, and whether the rig looked there: nothing without weights.
void add_readings(json& out, const ClusterResult& c) {
  if (!c.valid.weights) return;
  const ClusterReadings& r = c.readings;
  out["gloss_sigma_gu"] = by_gloss_angle(r, [](const Reading& g) { return finite(g.sigma); });
  out["gloss_interval_gu"] =
      by_gloss_angle(r, [](const Reading& g) { return bounds(g.interval_by_factor()); });
  out["gloss_measured"] = by_gloss_angle(r, [](const Reading& g) { return json(g.measured); });
  out["lab_sigma"] = lab_json(r.at_45_0(), &Reading::sigma);
  out["lab_measured"] = r.at_45_0().lab[0].measured;
  out["appearance"] = appearance_to_json(r);
}

json cluster_to_json(const ClusterResult& c, const std::string& brdf_file) {
  json out = {
      {"index", c.index},
      {"name", c.name},
      {"pixels", c.pixels},
      {"bins", c.bins},
      {"area_share", finite(c.area_share)},
      {"coverage", finite(c.coverage)},
      {"valid",
       {{"weights", c.valid.weights},
        {"highlight", c.valid.highlight},
        {"gloss", c.valid.gloss},
        {"colour", c.valid.colour},
        {"measured", c.valid.measured},
        {"within_basis", !c.validity.outside_basis()}}},
      {"method", c.method},
      {"components", c.weights.rows()},
      {"weights", by_channel(c.weights)},
      {"weight_sigmas", by_channel(c.weight_sigmas)},
      {"weights_seen", by_channel(c.validity.seen)},
      {"mahalanobis_ratio", as_list(c.validity.mahalanobis_ratio)},
      {"misfit_ratio", as_list(c.validity.misfit_ratio)},
      {"t2", finite(c.deviation.t2)},
      {"t2_limit", finite(c.deviation.t2_limit)},
      {"spe", finite(c.deviation.spe)},
      {"spe_limit", finite(c.deviation.spe_limit)},
      {"residual_rms", finite(c.raw.residual_rms)},
      {"gloss_gu",
       {{"20", finite(c.gloss_gu[0])},
        {"60", finite(c.gloss_gu[1])},
        {"85", finite(c.gloss_gu[2])}}},
      {"lab", {finite(c.lab[0]), finite(c.lab[1]), finite(c.lab[2])}},
      {"delta_e00", finite(c.delta_e00)},
  };
  add_readings(out, c);
  if (!brdf_file.empty()) out["brdf"] = brdf_file;
  return out;
}

json defects_to_json(const std::vector<Defect>& defects) {
  json out = json::array();
  for (const Defect& d : defects) {
    out.push_back({{"kind", d.kind},
                   {"at_mm", {finite(d.at_mm[0]), finite(d.at_mm[1])}},
                   {"size_mm", finite(d.size_mm)},
                   {"score", finite(d.score)},
                   {"change_ln", finite(d.change)}});
  }
  return out;
}

}  // namespace

std::string to_text(Verdict verdict) {
  switch (verdict) {
    case Verdict::pass:
      return "pass";
    case Verdict::reject:
      return "reject";
    case Verdict::not_judged:
      return "not_judged";
    case Verdict::none:
      break;
  }
  return "none";
}

json part_to_json(const std::string& recording, const PartResult& r, const CycleTimes& times,
                  const std::vector<std::string>& brdf_files) {
  json reasons = json::array();
  for (const Finding& f : r.findings)
    reasons.push_back(f.text);
  json clusters = json::array();
  for (std::size_t i = 0; i < r.clusters.size(); ++i) {
    clusters.push_back(
        cluster_to_json(r.clusters[i], i < brdf_files.size() ? brdf_files[i] : std::string()));
  }
  return {{"recording", recording},
          {"calibration", r.calibration_hash},
          {"verdict", to_text(r.verdict)},
          {"reasons", std::move(reasons)},
          {"reason_bits", r.reason_bits},
          {"t2_ratio", finite(r.t2_ratio)},
          {"spe_ratio", finite(r.spe_ratio)},
          {"tilt_deg", {finite(r.tilt_deg[0]), finite(r.tilt_deg[1])}},
          {"shift_mm", {finite(r.shift_mm[0]), finite(r.shift_mm[1])}},
          {"rotation_deg", finite(r.rotation_deg)},
          {"tilt_sigma_deg", {finite(r.tilt_sigma_deg[0]), finite(r.tilt_sigma_deg[1])}},
          {"height_mm", finite(r.height_mm)},
          {"height_sigma_mm", finite(r.height_sigma_mm)},
          {"ambient", finite(r.ambient)},
          {"lamp_drift", as_list(r.lamp_drift)},
          {"white_sigma", finite(r.white_sigma)},
          {"acquisition_ms", finite(times.acquisition_ms)},
          {"processing_ms", finite(times.processing_ms)},
          {"defects", defects_to_json(r.defects)},
          {"rules", rule_outcomes_to_json(r.rules)},
          {"clusters", std::move(clusters)}};
}

json result_document(std::vector<json> parts) {
  return {{"schema", "brdfgate.result/1"}, {"parts", std::move(parts)}};
}

void write_text_file(const std::filesystem::path& file, const std::string& text) {
  const std::filesystem::path temporary = file.string() + ".tmp";
  {
    std::ofstream out(temporary, std::ios::binary | std::ios::trunc);
    out << text;
    out.flush();
    if (!out)
      throw InputError(temporary.string(), "cannot be written",
                       "a writable folder with free space");
  }
  std::error_code failed;
  std::filesystem::rename(temporary, file, failed);
  if (failed) throw InputError(file.string(), "cannot be replaced: " + failed.message());
}

}  // namespace brdfgate
