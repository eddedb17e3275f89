#include "app/inspector.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "model/camera_colour.hpp"
#include "model/error.hpp"
#include "model/judge.hpp"
#include "model/lamp_monitor.hpp"
#include "model/light_health.hpp"
#include "model/mapping.hpp"
#include "model/reconstruction.hpp"
#include "model/tilted_registration.hpp"

namespace brdfgate {
namespace {

constexpr double kDegree = EIGEN_PI / 180;

/// A highlight counts as seen when the peak of light 1 lies inside the view and stands at least
/// this far above what light 2 sees (in-peak over off-peak).
constexpr double kHighlightRatio = 2.0;

cv::Mat cells_that_are_not_part(const std::vector<Reflectance>& r, const CellGeometry& cells,
                                const FixtureAppearance& fixture) {
  cv::Mat outside;
  cv::bitwise_not(cells.inside, outside);
  return outside | fixture_cells(r, fixture);
}

/// Per cluster: share of the cells that its taught label covers that have it; 1 where none does.
std::vector<double> shares_in_place(const Regions& regions, const cv::Mat& taught) {
  std::vector<double> shares;
  for (int k = 0; k < regions.clusters; ++k) {
    const cv::Mat place = taught == k;
    const int cells = cv::countNonZero(place);
    const int found = cv::countNonZero(place & (regions.label == k));
    shares.push_back(cells > 0 ? double(found) / cells : 1);
  }
  return shares;
}

double clipped_share(const std::vector<Reflectance>& r, const cv::Mat& part) {
  const int cells = cv::countNonZero(part);
  if (cells == 0) return 0;
  cv::Mat clipped = cv::Mat::zeros(part.size(), CV_8U);
  for (const Reflectance& light : r)
    clipped |= (light.mask & kClipped);
  return double(cv::countNonZero(clipped & part)) / cells;
}

/// Fewer tiles of the body say nothing of its pose.
constexpr int kPoseTiles = 40;

/// As many cells of bare fixture tell the ambient light's level.
constexpr int kFixtureCells = 500;
/// A part is not taken for darker than this when ambient light is told from it.
constexpr double kDarkestAlbedo = 0.02;

/// As estimated, in radians and metres.
PartPose lie_of(const PartResult& part) {
  return {part.tilt_deg[0] * kDegree, part.tilt_deg[1] * kDegree, part.height_mm * 1e-3};
}

/// Shift and rotation as told by the plane, without what the tilt makes of them.
void take_tilt_out(PartResult& part, const TaughtLayout& layout, const Eigen::Vector3d& eye_W) {
  if (layout.empty()) return;
  const PlanarPose& taught = layout.taught;
  const PlanarPose seen{1e-3 * Eigen::Vector2d(part.shift_mm[0], part.shift_mm[1]) + taught.shift_m,
                        part.rotation_deg * kDegree + taught.rotation};
  const PlanarPose own = without_tilt(layout, seen, lie_of(part), eye_W);
  const Eigen::Vector2d shift = 1e3 * (own.shift_m - taught.shift_m);
  part.shift_mm = {shift.x(), shift.y()};
  part.rotation_deg = (own.rotation - taught.rotation) / kDegree;
}

struct PeakSight {
  bool inside = false;      ///< a bin around theta_h = 0 was seen under light 1
  bool stands_out = false;  ///< and it is brighter than light 2's median by kHighlightRatio
};

double luminance(const Bin& bin, int channels) {
  return channels == 1 ? bin.f[0] : 0.2126 * bin.f[0] + 0.7152 * bin.f[1] + 0.0722 * bin.f[2];
}

PeakSight look_for_peak(const BinnedSamples& samples) {
  PeakSight sight;
  double peak = 0;
  std::vector<double> off_peak;
  for (const Bin& bin : samples.bins) {
    if (bin.light == 1 && bin.angles.theta_h < kPeakThetaH) {
      sight.inside = true;
      peak = std::max(peak, luminance(bin, samples.channels));
    } else if (bin.light == 2) {
      off_peak.push_back(luminance(bin, samples.channels));
    }
  }
  if (off_peak.empty()) return sight;
  std::nth_element(off_peak.begin(), off_peak.begin() + off_peak.size() / 2, off_peak.end());
  sight.stands_out = sight.inside && peak > kHighlightRatio * off_peak[off_peak.size() / 2];
  return sight;
}

/// @param on_frame  what the weights were estimated from
void add_readings(ClusterResult& cluster, const ClusterReadings& readings,
                  const BinnedSamples& on_frame, bool colour_known) {
  const PeakSight peak = look_for_peak(on_frame);
  cluster.readings = readings;
  for (std::size_t i = 0; i < readings.gloss.size(); ++i)
    cluster.gloss_gu[i] = readings.gloss[i].value;
  cluster.valid.gloss = peak.inside;
  cluster.valid.measured = is_gloss_measured(on_frame, 60);
  cluster.valid.highlight = peak.stands_out;
  if (cluster.channels == 3 && colour_known) {
    for (std::size_t i = 0; i < 3; ++i)
      cluster.lab[static_cast<Eigen::Index>(i)] = readings.at_45_0().lab[i].value;
    cluster.valid.colour = true;
  }
}

/// What local residuals are told from: the material that they were taught against, or, where none
/// were, the clusters' means.
std::vector<BrdfPtr> defect_materials(const Recipe& recipe,
                                      const std::shared_ptr<const Basis>& basis) {
  const double to_c = 1 / std::sqrt(double(basis->info().observations));
  std::vector<BrdfPtr> materials;
  for (std::size_t i = 0; i < recipe.clusters.size(); ++i) {
    Weights weights;
    weights.c = to_c * (i < recipe.defects.material.size() ? recipe.defects.material[i]
                                                           : recipe.clusters[i].mean);
    materials.push_back(make_brdf(basis, weights));
  }
  return materials;
}

/// A rule on colour where none is known would leave every part not judged.
void check_colour_rules(const Recipe& recipe, bool known, const std::string& where) {
  const std::vector<Rule>& rules = recipe.rules.rules;
  for (std::size_t i = 0; i < rules.size() && !known; ++i) {
    const RuleReadingInfo& info = rule_reading_info(rules[i].reading);
    if (!info.is_colour()) continue;
    throw InputError(where + " (rules.rules[" + std::to_string(i) + "].reading)",
                     info.name + " is a reading of colour, and this station knows none",
                     "a colour camera with a chart in its calibration (or declared linear sRGB), "
                     "or no such rule");
  }
}

}  // namespace

Inspector::Inspector(const StationConfig& config, std::shared_ptr<const Basis> basis,
                     Calibration calibration)
    : settings_(config.inspection),
      judge_(config.judge),
      basis_(std::move(basis)),
      calibration_(std::move(calibration)) {
  if (calibration_.station_hash != config.station_hash) {
    throw InputError(config.files.calibration.string(),
                     "station_hash " + calibration_.station_hash.substr(0, 16) +
                         " belongs to another sensor or rig",
                     config.station_hash.substr(0, 16) + " (run brdfgate calibrate)");
  }
  const cv::Size2d region(settings_.region_mm[0] * 1e-3, settings_.region_mm[1] * 1e-3);
  geometry_ = in_part_frame(calibration_.geometry, {.height_m = settings_.part_height_mm * 1e-3});
  map_.cells = cell_geometry(geometry_, calibration_.sensor, region);
  map_.bins = make_bin_map(map_.cells);
  white_levels_ = white_levels(calibration_);
  blocks_ = std::make_shared<DefectBlocks>(geometry_, map_.cells);
  readings_ = std::make_shared<ReadingRows>(basis_, calibration_.colour);
  estimator_ = make_estimator({settings_.method, settings_.eta}, basis_);
  if (settings_.monitor) {
    patch_ = patch_cells(calibration_.geometry, calibration_.sensor, *settings_.monitor);
  }
}

RecipeInForce Inspector::bring_into_force(Recipe recipe) const {
  const std::string where = "recipe '" + recipe.name + "'";
  if (recipe.basis_checksum != basis_->info().checksum) {
    throw InputError(where,
                     "basis_checksum " + recipe.basis_checksum.substr(0, 16) + " is another basis",
                     basis_->info().checksum.substr(0, 16) + " (teach again)");
  }
  if (recipe.calibration_hash != calibration_.hash) {
    throw InputError(
        where,
        "calibration_hash " + recipe.calibration_hash.substr(0, 16) + " is another calibration",
        calibration_.hash.substr(0, 16) + " (teach again)");
  }
  if (recipe.part_height_mm != settings_.part_height_mm) {
    throw InputError(
        where,
        fmt::format("part_height_mm {} is another height of the part", recipe.part_height_mm),
        fmt::format("{} as in inspection.part_height_mm (teach again)", settings_.part_height_mm));
  }
  check_colour_rules(recipe, colour_known() && recipe.channels == 3, where);
  RecipeInForce force{std::move(recipe), {}, {}, {}, {}, {}};
  const TaughtLayout& layout = force.recipe.layout;
  if (!layout.empty()) force.taught_labels = expected_labels(layout, layout.taught, map_.cells);
  if (std::ranges::any_of(force.recipe.rules.rules,
                          [](const Rule& r) { return r.tolerance.has_value(); })) {
    force.repeat_rows = std::make_shared<ReadingRows>(basis_, calibration_.colour, 0);
  }
  const double to_c = 1 / std::sqrt(double(basis_->info().observations));
  for (TaughtCluster& cluster : force.recipe.clusters) {
    Weights mean;
    mean.c = cluster.mean * to_c;
    cluster.readings = readings_->read(mean);
    TaughtAppearance look{Eigen::ArrayXXd(map_.bins.bins(), cluster.mean.cols())};
    for (Eigen::Index ch = 0; ch < cluster.mean.cols(); ++ch) {
      const Eigen::VectorXd c = cluster.mean.col(ch) * to_c;
      look.log_f.col(ch) = basis_->reconstruct(c, map_.bins.mean_angles).array().max(1e-6).log();
    }
    for (int bin = 0; bin < map_.bins.bins(); ++bin) {
      if (map_.bins.light[bin] != 2) look.log_f.row(bin) = std::numeric_limits<double>::quiet_NaN();
    }
    force.appearance.push_back(std::move(look));
    for (const int id : cluster.directions.frame.id) {
      if (id < 0 || id >= map_.bins.bins()) {
        throw InputError(where, "bin " + std::to_string(id) + " is none of the station's",
                         "0 to " + std::to_string(map_.bins.bins() - 1));
      }
    }
    force.frames.push_back(cluster.directions.frame);
  }
  force.defect_material = defect_materials(force.recipe, basis_);
  return force;
}

ClusterResult Inspector::measure_cluster(const BinnedSamples& samples, int index,
                                         int min_bins) const {
  ClusterResult cluster;
  cluster.index = index;
  cluster.name = "cluster " + std::to_string(index);
  cluster.channels = samples.channels;
  cluster.bins = static_cast<int>(samples.bins.size());
  cluster.coverage = double(cluster.bins) / std::max(1, map_.bins.bins());
  cluster.present = true;
  // Too few bins to judge are too few to train an estimator for.
  if (cluster.bins < min_bins) return cluster;
  const int observations = basis_->info().observations;
  cluster.raw = estimator_->estimate(samples);
  cluster.method = estimator_->name();
  cluster.validity = validity(*basis_, cluster.raw);
  cluster.weights = cluster.raw.in_prior_sigmas(observations);
  cluster.weight_sigmas = cluster.raw.sigmas_in_prior_sigmas(observations);
  cluster.valid.weights = cluster.bins >= min_bins && cluster.weights.allFinite();
  return cluster;
}

BrdfPtr Inspector::seen_colour(const Weights& weights) const {
  const BrdfPtr camera = make_brdf(basis_, weights);
  return calibration_.colour ? in_linear_srgb(camera, *calibration_.colour) : camera;
}

bool Inspector::colour_known() const {
  if (settings_.colour == ColourSource::none) return false;
  return calibration_.colour || settings_.colour == ColourSource::linear_srgb_d65;
}

const JudgeSettings& Inspector::settings_for(const RecipeInForce* recipe) const {
  return recipe != nullptr ? recipe->recipe.settings : judge_;
}

cv::Mat Inspector::place(Inspection& part, const cv::Mat& not_part, const Recipe& recipe) const {
  if (recipe.layout.empty()) return {};
  const Registration found = register_part(recipe.layout, part.reflectance, map_.cells, not_part);
  const PlanarPose& taught = recipe.layout.taught;
  const Eigen::Vector2d shift = 1e3 * (found.pose.shift_m - taught.shift_m);
  part.result.shift_mm = {shift.x(), shift.y()};
  part.result.rotation_deg = (found.pose.rotation - taught.rotation) / kDegree;
  if (found.agreement < kLeastAgreement) {
    part.facts.pose_problem =
        "the taught outline and regions were not found: wrong face, wrong part or out of view";
  }
  return expected_labels(recipe.layout, found.pose, map_.cells);
}

Regions Inspector::regions_of(Inspection& part, const RecipeInForce* recipe) const {
  const std::vector<Reflectance>& r = part.reflectance;
  const cv::Mat not_part = cells_that_are_not_part(r, map_.cells, settings_.fixture);
  const int cells = static_cast<int>(not_part.total()) - cv::countNonZero(not_part);
  const double coverage = double(cells) / std::max(1, cv::countNonZero(map_.cells.inside));
  if (coverage < settings_for(recipe).min_coverage) {
    const cv::Mat nothing(not_part.size(), CV_8U, cv::Scalar(kNotPart));
    return {nothing, recipe != nullptr ? static_cast<int>(recipe->appearance.size()) : 0, coverage};
  }
  if (recipe == nullptr) return find_regions(r, map_.cells, not_part, settings_.max_clusters);
  const cv::Mat taught = place(part, not_part, recipe->recipe);
  part.taught_labels = taught;
  Regions regions = assign_regions(r, map_.bins, not_part, recipe->appearance,
                                   recipe->recipe.settings.assign_tolerance, taught);
  if (!taught.empty()) part.facts.in_place = shares_in_place(regions, taught);
  return regions;
}

PartPose Inspector::pose_of(Inspection& part) const {
  PartResult& result = part.result;
  result.tilt_sigma_deg.fill(settings_.fixture_tilt_sigma_deg);
  result.height_sigma_mm = settings_.fixture_height_sigma_mm;
  const cv::Mat body = result.regions.label == 0;
  const PosePrior prior{settings_.fixture_tilt_sigma_deg * kDegree,
                        settings_.fixture_height_sigma_mm * 1e-3};
  if (prior.tilt_sigma == 0 || result.regions.clusters == 0) return {};
  const PoseSamples samples = pose_samples(part.reflectance, geometry_, map_.cells, body);
  if (static_cast<int>(samples.lines.size()) < kPoseTiles) return {};
  const PoseEstimate found = estimate_pose(*basis_, samples, prior);
  result.tilt_deg = {found.pose.tilt_x / kDegree, found.pose.tilt_y / kDegree};
  for (std::size_t i = 0; i < 2; ++i)
    result.tilt_sigma_deg[i] =
        std::sqrt(found.covariance(Eigen::Index(i), Eigen::Index(i))) / kDegree;
  result.height_mm = found.pose.height_m * 1e3;
  result.height_sigma_mm = std::sqrt(found.covariance(2, 2)) * 1e3;
  return found.pose;
}

void Inspector::measure_clusters(Inspection& part, const RecipeInForce* recipe) const {
  const Regions& regions = part.result.regions;
  const int part_cells = std::max(1, cv::countNonZero(regions.label != kNotPart));
  const JudgeSettings& settings = settings_for(recipe);
  const PartPose pose = pose_of(part);
  if (pose.none()) {
    part.samples = bin_all(part.reflectance, map_, regions);
  } else {
    part.samples = bin_all(part.reflectance, map_, regions, {geometry_, pose});
  }
  for (int i = 0; i < regions.clusters; ++i) {
    const auto index = static_cast<std::size_t>(i);
    const BinnedSamples& samples = part.samples[index];
    part.linear.emplace_back();
    if (!samples.bins.empty()) part.linear.back() = ridge(*basis_, samples, settings_.eta);
    const bool framed = recipe != nullptr && !recipe->frames[index].id.empty() &&
                        static_cast<int>(samples.bins.size()) >= settings.min_bins;
    const BinnedSamples on_frame =
        framed ? onto_frame(*basis_, samples, part.linear.back(), recipe->frames[index]) : samples;
    ClusterResult cluster = measure_cluster(on_frame, i, settings.min_bins);
    cluster.bins = static_cast<int>(samples.bins.size());
    cluster.coverage = double(cluster.bins) / std::max(1, map_.bins.bins());
    cluster.valid.weights = cluster.valid.weights && cluster.bins >= settings.min_bins;
    if (cluster.valid.weights) {
      add_readings(cluster, readings_->read(cluster.raw, samples), on_frame, colour_known());
      if (recipe != nullptr && recipe->repeat_rows)
        cluster.repeat = repeatability(*recipe->repeat_rows, cluster.raw, on_frame);
    }
    cluster.pixels = cv::countNonZero(regions.label == i);
    cluster.present = cluster.pixels > 0;
    cluster.area_share = double(cluster.pixels) / part_cells;
    part.observed.emplace_back();
    const bool comparable = std::any_of(on_frame.bins.begin(), on_frame.bins.end(),
                                        [](const Bin& bin) { return bin.pixels > 0; });
    if (cluster.valid.weights && framed && comparable &&
        recipe->recipe.clusters[index].directions.size() > 0) {
      part.observed.back() = observe_along(recipe->recipe.clusters[index].directions, *basis_,
                                           on_frame, part.linear.back());
    }
    part.result.clusters.push_back(std::move(cluster));
  }
}

ClusterReadings Inspector::repeatability(const ReadingRows& rows, const Weights& weights,
                                         const BinnedSamples& on_frame) const {
  Weights noisy = weights;
  noisy.covariance = noise_covariance(basis_->rows(on_frame.directions()), on_frame, settings_.eta);
  noisy.channel_correlation.resize(0, 0);  // pixels' noise has none
  return rows.read(noisy);
}

DefectEvidence Inspector::evidence_of(const Inspection& part, const RecipeInForce& recipe) const {
  const PartResult& seen = part.result;
  return defect_evidence(part.reflectance, home_labels(seen.regions, part.taught_labels), *blocks_,
                         lie_of(seen), recipe.defect_material, recipe.taught_labels);
}

double Inspector::ambient_level(const Radiance& ambient, const std::vector<Reflectance>& r,
                                const cv::Mat& on_part) const {
  // The bare fixture around the part is Lambertian and known; the part itself is the second best
  // witness.
  const cv::Mat fixture = fixture_cells(r, settings_.fixture);
  if (cv::countNonZero(fixture) >= kFixtureCells) {
    return ambient_share(ambient, calibration_, fixture, settings_.fixture.reflectance);
  }
  const cv::Scalar f = cv::mean(r[1].value, on_part);
  const Eigen::Array3d albedo = EIGEN_PI * Eigen::Array3d(f[0], f[1], f[2]);
  const cv::Mat cells = cv::countNonZero(on_part) > 0 ? on_part : map_.cells.inside;
  return ambient_share(ambient, calibration_, cells, albedo.max(kDarkestAlbedo));
}

void Inspector::to_reflectance(const RadianceSet& radiance, Inspection& part) const {
  std::vector<Eigen::Array3d> lamps;
  if (settings_.monitor) {
    part.facts.max_lamp_drift = settings_.monitor->max_drift;
    const auto expected = patch_reflectance(*settings_.monitor, calibration_);
    for (const LampLevel& lamp : lamp_levels(radiance.lights, calibration_, patch_, expected)) {
      const double drift = lamp.drift();
      part.facts.lamp_drift.push_back(drift);
      // Beyond the limit it is rather the patch that is covered than the lamp that drifted.
      const bool trusted = std::abs(drift) <= part.facts.max_lamp_drift;
      lamps.push_back(trusted ? lamp.ratio : Eigen::Array3d::Ones());
    }
  }
  const PartPlane plane{.height_m = settings_.part_height_mm * 1e-3};
  part.reflectance = brdfgate::to_reflectance(radiance, calibration_, plane, lamps);
}

Inspection Inspector::measure(const Capture& capture, const RecipeInForce* recipe) const {
  const RadianceSet radiance = to_radiance(capture, calibration_);
  Inspection part;
  to_reflectance(radiance, part);
  part.result.regions = regions_of(part, recipe);
  const Regions& regions = part.result.regions;
  const cv::Mat on_part = regions.label != kNotPart;
  part.facts.coverage = regions.coverage;
  part.facts.ambient = ambient_level(radiance.ambient, part.reflectance, on_part);
  part.facts.clipped = clipped_share(part.reflectance, on_part);
  part.facts.unknown_share =
      double(cv::countNonZero(regions.label == kUnknown)) / std::max(1, cv::countNonZero(on_part));
  measure_clusters(part, recipe);
  if (recipe != nullptr) {
    take_tilt_out(part.result, recipe->recipe.layout, geometry_.camera.position());
    part.evidence = evidence_of(part, *recipe);
    part.facts.defects = find_defects(part.evidence, *blocks_, recipe->recipe.defects,
                                      recipe->defect_material, recipe->recipe.settings);
  }
  part.facts.tilt_deg = part.result.tilt_deg;
  part.facts.tilt_sigma_deg = part.result.tilt_sigma_deg;
  part.facts.shift_mm = part.result.shift_mm;
  part.facts.rotation_deg = part.result.rotation_deg;
  part.result.calibration_hash = calibration_.hash;
  part.result.ambient = part.facts.ambient;
  part.result.clipped = part.facts.clipped;
  part.result.defects = part.facts.defects;
  part.result.lamp_drift = part.facts.lamp_drift;
  part.result.white_sigma = calibration_.white_sigma;
  return part;
}

void Inspector::judge(Inspection& part, const RecipeInForce* recipe) const {
  Judgement judgement = brdfgate::judge(recipe != nullptr ? &recipe->recipe : nullptr, judge_,
                                        part.result.clusters, part.observed, part.facts);
  part.result.verdict = judgement.verdict;
  part.result.reason_bits = judgement.reason_bits;
  part.result.findings = std::move(judgement.findings);
  part.result.t2_ratio = judgement.t2_ratio;
  part.result.spe_ratio = judgement.spe_ratio;
  part.result.worst_cluster = judgement.worst_cluster;
  part.result.rules = std::move(judgement.rules);
}

std::string Inspector::light_fault(const Capture& capture) const {
  const Capture seen = levelled(capture, calibration_);
  return brdfgate::light_fault(see_lights(seen, calibration_.sensor.black_level_dn, white_levels_));
}

Inspection Inspector::inspect(const Capture& capture, const RecipeInForce* recipe,
                              const CalibrationAge& age) const {
  if (const std::string fault = light_fault(capture); !fault.empty()) {
    Inspection blind;
    blind.result.verdict = Verdict::not_judged;
    blind.result.calibration_hash = calibration_.hash;
    blind.result.reason_bits = bit(Reason::hardware);
    blind.result.findings = {{Reason::hardware, fault}};
    return blind;
  }
  Inspection part = measure(capture, recipe);
  part.facts.calibration = age;
  judge(part, recipe);
  return part;
}

}  // namespace brdfgate
