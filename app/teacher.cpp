#include "app/teacher.hpp"

#include <cstdio>

#include "app/utc_time.hpp"
#include "model/error.hpp"
#include "model/readings.hpp"
#include "model/reconstruction.hpp"
#include "model/teaching_checks.hpp"

namespace brdfgate {
namespace {

/// A part of which more than this share fits no cluster of the first part is of another kind.
constexpr double kForeignShare = 0.10;
/// A strict recipe needs this many parts; fewer teach with a warning.
constexpr int kStrictParts = 10;

/// With fewer than this many times the bins that judging takes, a move within range may take too
/// many of them: 4 mm and 4 degrees took a quarter of a disc's.
constexpr double kRoomForMoves = 1.5;

void require_usable(const std::string& name, const Inspection& seen) {
  // The same reason as a missing recipe's, but no part may be taught under a drifted lamp.
  for (const std::string& text : drifted_lamps(seen.facts))
    throw InputError(name, "cannot teach: " + text, "lamps as calibrated");
  const PartResult& part = seen.result;
  constexpr ReasonBits kOnlyNoRecipe = bit(Reason::calibration_or_recipe);
  for (const Finding& finding : part.findings) {
    const ReasonBits reason = bit(finding.reason);
    if ((reason & kNotJudgedBits) != 0 && reason != kOnlyNoRecipe) {
      throw InputError(name, "cannot teach: " + finding.text, "a good part, well lit and in place");
    }
  }
}

double unknown_share(const Regions& regions) {
  const int unknown = cv::countNonZero(regions.label == kUnknown);
  const int part = cv::countNonZero(regions.label != kNotPart);
  return part == 0 ? 0 : double(unknown) / part;
}

void add_warnings(Recipe& recipe) {
  if (recipe.parts >= kStrictParts) return;
  std::string text = "taught from " + std::to_string(recipe.parts) +
                     " part(s); a strict recipe needs " + std::to_string(kStrictParts);
  if (recipe.parts < 3) text += "; part-to-part variation is the configured floor, not measured";
  recipe.warnings.push_back(std::move(text));
}

void warn_of_few_bins(const std::string& cluster, std::size_t bins, Recipe& recipe) {
  const int needed = recipe.settings.min_bins;
  if (static_cast<double>(bins) >= kRoomForMoves * needed) return;
  recipe.warnings.push_back("cluster '" + cluster + "' was seen in " + std::to_string(bins) +
                            " angular bins and it takes " + std::to_string(needed) +
                            " to judge it: a part that lies elsewhere within range may show fewer "
                            "and is then not judged (coverage)");
}

std::string outlying_text(const std::string& part, const std::string& cluster,
                          const OutlyingPart& found) {
  char numbers[96];
  std::snprintf(numbers, sizeof numbers, " is off by %+.1f %% (%+.1f sigma, T2 %.0f)",
                100 * found.shift.change, found.shift.sigmas, found.t2);
  return part + ": not like the other parts in cluster '" + cluster + "': " + found.shift.name +
         numbers + "; if it is not good, teach again without it";
}

}  // namespace

void Teacher::add(const std::string& name, const Capture& capture) {
  const Inspection part = inspector_.inspect(capture, draft_ ? &*draft_ : nullptr);
  require_usable(name, part);
  if (!draft_) begin(name, part);
  keep(name, part);
  names_.push_back(name);
  ++parts_;
}

std::vector<TaughtCluster> Teacher::clusters() const {
  return draft_ ? draft_->recipe.clusters : std::vector<TaughtCluster>{};
}

void Teacher::begin(const std::string& name, const Inspection& first) {
  Recipe recipe;
  recipe.calibration_hash = inspector_.calibration().hash;
  recipe.basis_checksum = inspector_.basis().info().checksum;
  recipe.components = inspector_.basis().info().components;
  recipe.channels = inspector_.calibration().sensor.channels();
  recipe.settings = inspector_.judge_settings();
  recipe.part_height_mm = inspector_.part_height_mm();
  for (const ClusterResult& cluster : first.result.clusters) {
    if (!cluster.valid.weights) {
      throw InputError(
          name, cluster.name + " covers only " + std::to_string(cluster.bins) + " angular bins",
          std::to_string(recipe.settings.min_bins) + " or more");
    }
    TaughtCluster taught;
    taught.name = cluster.index == 0 ? "body" : "region " + std::to_string(cluster.index);
    taught.mean = cluster.weights;
    taught.area_share = cluster.area_share;
    if (!cluster.valid.gloss) {
      remarks_.push_back("cluster '" + taught.name +
                         "' is too small or too one-sided to see a highlight: no cell near its "
                         "mirror direction, gloss and roughness are extrapolated (coverage " +
                         std::to_string(static_cast<int>(100 * cluster.coverage)) +
                         " % of the bins)");
    }
    recipe.clusters.push_back(std::move(taught));
  }
  if (recipe.clusters.empty()) throw InputError(name, "no material was found on it");
  recipe.layout = make_layout(first.reflectance, inspector_.map().cells, first.result.regions);
  draft_ = inspector_.bring_into_force(std::move(recipe));
  samples_.resize(draft_->recipe.clusters.size());
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    draft_->frames[i] = frame_of(first.samples[i]);
    weight_sums_.push_back(Eigen::MatrixXd::Zero(draft_->recipe.clusters[i].mean.rows(),
                                                 draft_->recipe.clusters[i].mean.cols()));
  }
}

void Teacher::keep(const std::string& name, const Inspection& part) {
  if (parts_ > 0 && unknown_share(part.result.regions) > kForeignShare) {
    throw InputError(
        name,
        "is of another kind than the first part: a tenth of it or more matches none of "
        "the taught materials",
        "good parts of one kind");
  }
  shift_mm_ += Eigen::Vector2d(part.result.shift_mm[0], part.result.shift_mm[1]);
  rotation_deg_ += part.result.rotation_deg;
  defects_.push_back(part.evidence.lights.empty() ? inspector_.evidence_of(part, *draft_)
                                                  : part.evidence);
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    const ClusterResult& cluster = part.result.clusters.at(i);
    if (!cluster.valid.weights) {
      throw InputError(name,
                       "is of another kind than the first part: " +
                           draft_->recipe.clusters[i].name + " is missing",
                       "good parts of one kind");
    }
    samples_[i].push_back({part.samples[i], part.linear[i], cluster.area_share});
    weight_sums_[i] += cluster.weights;
  }
}

Recipe Teacher::recipe(const std::string& name, int id) const {
  if (parts_ == 0 || !draft_)
    throw InputError(name, "nothing was taught", "at least one good part");
  Recipe recipe = draft_->recipe;
  recipe.id = id;
  recipe.name = name;
  recipe.created = utc_now();
  recipe.parts = parts_;
  recipe.warnings = remarks_;
  recipe.layout.taught.shift_m = 1e-3 * shift_mm_ / parts_;
  recipe.layout.taught.rotation = rotation_deg_ / parts_ * double(EIGEN_PI) / 180;
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    const std::string cluster_name = recipe.clusters[i].name;
    Weights mean;
    mean.c = weight_sums_[i] / parts_ / std::sqrt(double(inspector_.basis().info().observations));
    const BrdfPtr brdf = make_brdf(inspector_.shared_basis(), mean);
    ObservedParts observed = observe_parts(inspector_.basis(), *brdf, samples_[i]);
    TaughtCluster taught =
        teach_observed(observed.parts, recipe.settings, static_cast<int>(samples_.size()));
    taught.directions = std::move(observed.directions);
    for (const OutlyingPart& part : outlying_parts(observed.parts, taught, recipe.settings))
      recipe.warnings.push_back(outlying_text(names_[std::size_t(part.part)], cluster_name, part));
    warn_of_few_bins(cluster_name, taught.directions.frame.id.size(), recipe);
    taught.name = cluster_name;
    taught.mean = weight_sums_[i] / double(parts_);
    for (const TeachSample& part : samples_[i])
      taught.area_share += part.area_share / double(parts_);
    const ClusterReadings readings = inspector_.readings().read(mean);
    for (std::size_t j = 0; j < 3; ++j) {
      taught.gloss_gu[j] = readings.gloss[j].value;
      if (recipe.channels == 3)
        taught.lab[static_cast<Eigen::Index>(j)] = readings.at_45_0().lab[j].value;
    }
    recipe.clusters[i] = std::move(taught);
  }
  recipe.defects =
      teach_defects(defects_, inspector_.defect_blocks(), recipe.settings.false_reject_rate);
  for (const TaughtCluster& first : draft_->recipe.clusters)
    recipe.defects.material.push_back(first.mean);
  add_warnings(recipe);
  return recipe;
}

}  // namespace brdfgate
