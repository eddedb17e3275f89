#include "model/judge.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

#include "model/rule_values.hpp"

namespace brdfgate {
namespace {

/// Four significant digits, as people read them.
std::string number(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", v);
  return text;
}

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g %%", 100 * share);
  return text;
}

std::string signed_sigmas(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%+.1f sigma", v);
  return text;
}

std::string signed_percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%+.3g %%", 100 * share);
  return text;
}

std::string channel_name(int channel, int channels) {
  if (channels == 1) return "the mono channel";
  return std::string("channel ") + "RGB"[channel % 3];
}

constexpr double kUnknownReading = std::numeric_limits<double>::quiet_NaN();

/// True unless the value is known to be within the limit: NaN and infinities are not.
bool beyond(double value, double limit) {
  return !(std::isfinite(value) && value <= limit);
}

bool is_finite(const ClusterObservation& seen) {
  return seen.monitored.allFinite() && seen.monitored_noise.allFinite() &&
         seen.residual.allFinite() && seen.residual_noise.allFinite();
}

class Judge {
 public:
  Judge(const Recipe* recipe, const JudgeSettings& settings)
      : recipe_(recipe), settings_(recipe != nullptr ? recipe->settings : settings) {}

  Judgement operator()(std::vector<ClusterResult>& clusters,
                       const std::vector<std::optional<ClusterObservation>>& observed,
                       const PartFacts& facts) {
    if (!std::isfinite(facts.coverage)) {
      find(Reason::coverage, "the part's coverage of the inspected region is not known");
    } else if (facts.coverage < settings_.min_coverage) {
      find(Reason::part_absent, "no part: " + percent(facts.coverage) +
                                    " of the inspected region is not fixture, a part covers " +
                                    percent(settings_.min_coverage) + " or more");
      return conclude();
    }
    judge_light(facts);
    judge_lamps(facts);
    judge_calibration(facts.calibration);
    if (recipe_ == nullptr) {
      find(Reason::calibration_or_recipe, "no recipe is in force");
    } else if (recipe_->clusters.empty()) {
      find(Reason::calibration_or_recipe, "recipe '" + recipe_->name + "' has no clusters");
    } else if (facts.unknown_share > kForeignPartShare) {
      name(clusters);
      find(Reason::pose_or_face, "no region looks like the taught part (" +
                                     percent(facts.unknown_share) +
                                     " of it unknown): wrong face, wrong part or out of view");
    } else {
      name(clusters);
      judge_pose(facts);
      judge_regions(facts);
      for (std::size_t i = 0; i < recipe_->clusters.size(); ++i) {
        const bool there = in_place(i, facts);
        if (there) judge_cluster(i, clusters, observed);
        judge_cluster_rules(i, there, clusters, observed);
      }
      judge_part_rules(facts);
    }
    return conclude();
  }

 private:
  void find(Reason reason, std::string text) {
    judgement_.reason_bits |= bit(reason);
    judgement_.findings.push_back({reason, std::move(text)});
  }

  Judgement conclude() {
    judgement_.verdict = verdict_of(judgement_.reason_bits);
    return std::move(judgement_);
  }

  void name(std::vector<ClusterResult>& clusters) const {
    for (std::size_t i = 0; i < std::min(clusters.size(), recipe_->clusters.size()); ++i)
      clusters[i].name = recipe_->clusters[i].name;
  }

  void judge_light(const PartFacts& facts) {
    if (beyond(facts.ambient, settings_.max_ambient)) {
      find(Reason::ambient, std::isfinite(facts.ambient)
                                ? "ambient light is " + percent(facts.ambient) +
                                      " of white, over its limit " + percent(settings_.max_ambient)
                                : "the ambient light is not known");
    }
    if (beyond(facts.clipped, settings_.max_clipped)) {
      find(Reason::clipped, std::isfinite(facts.clipped)
                                ? percent(facts.clipped) +
                                      " of the part is clipped, over its limit " +
                                      percent(settings_.max_clipped)
                                : "the clipped share is not known");
    }
  }

  void judge_lamps(const PartFacts& facts) {
    for (std::string& text : drifted_lamps(facts))
      find(Reason::calibration_or_recipe, std::move(text));
  }

  void judge_pose(const PartFacts& facts) {
    const double shift = std::hypot(facts.shift_mm[0], facts.shift_mm[1]);
    if (!facts.pose_problem.empty()) find(Reason::pose_or_face, facts.pose_problem);
    if (beyond(shift, settings_.max_shift_mm)) {
      find(Reason::pose_or_face, "the part lies " + number(shift) +
                                     " mm from its taught place, over its limit " +
                                     number(settings_.max_shift_mm) + " mm");
    }
    if (beyond(std::abs(facts.rotation_deg), settings_.max_rotation_deg)) {
      find(Reason::pose_or_face, "the part is turned by " + number(facts.rotation_deg) +
                                     " deg in its plane, over its limit " +
                                     number(settings_.max_rotation_deg) + " deg");
    }
    if (!rules().has(RuleReading::tilt_deg, kEveryCluster) &&
        (beyond(std::abs(facts.tilt_deg[0]), settings_.max_tilt_deg) ||
         beyond(std::abs(facts.tilt_deg[1]), settings_.max_tilt_deg))) {
      find(Reason::tilt, "the part is tilted by (" + number(facts.tilt_deg[0]) + ", " +
                             number(facts.tilt_deg[1]) + ") deg, over its limit " +
                             number(settings_.max_tilt_deg) + " deg");
    }
  }

  /// False, with a finding, for a cluster that its taught place does not show.
  bool in_place(std::size_t i, const PartFacts& facts) {
    if (i >= facts.in_place.size() || facts.in_place[i] >= kLeastInPlace) return true;
    find(Reason::missing_cluster, "cluster '" + recipe_->clusters[i].name +
                                      "' is missing from its place: " + percent(facts.in_place[i]) +
                                      " of it shows it");
    return false;
  }

  void judge_calibration(const CalibrationAge& age) {
    if (!age.expired()) return;
    find(Reason::calibration_or_recipe,
         "the calibration was due " + std::to_string(-*age.days_until_due) +
             " days ago, over its grace of " + std::to_string(age.grace_days) + " days");
  }

  void judge_regions(const PartFacts& facts) {
    if (!std::isfinite(facts.unknown_share)) {
      find(Reason::coverage, "the share of unknown cells is not known");
    } else if (facts.unknown_share > settings_.unknown_share_limit &&
               !rules().has(RuleReading::unknown_share, kEveryCluster)) {
      find(Reason::unknown_region, percent(facts.unknown_share) +
                                       " of the part matches no taught cluster, over its limit " +
                                       percent(settings_.unknown_share_limit));
    }
    std::vector<Defect> defects = facts.defects;
    std::erase_if(defects, [this](const Defect& d) { return rules().has_defects_of(d.kind); });
    if (defects.empty()) return;
    const auto largest =
        std::max_element(defects.begin(), defects.end(),
                         [](const Defect& a, const Defect& b) { return a.size_mm < b.size_mm; });
    find(Reason::local_defect,
         std::to_string(defects.size()) +
             (defects.size() == 1 ? " local defect: " : " local defects; the largest: ") +
             largest->kind + ", " + number(largest->size_mm) + " mm at (" +
             number(largest->at_mm[0]) + ", " + number(largest->at_mm[1]) + ") mm");
  }

  void judge_cluster(std::size_t i, std::vector<ClusterResult>& clusters,
                     const std::vector<std::optional<ClusterObservation>>& observed) {
    const TaughtCluster& taught = recipe_->clusters[i];
    const std::string quoted = "cluster '" + taught.name + "'";
    if (i >= clusters.size() || !clusters[i].present) {
      return find(Reason::missing_cluster, quoted + " is missing");
    }
    ClusterResult& cluster = clusters[i];
    const bool draft = taught.parts == 0;
    if (!draft && !rules().has(RuleReading::area_share, static_cast<int>(i)))
      judge_area(cluster, taught, quoted);
    if (cluster.bins < settings_.min_bins) {
      return find(Reason::coverage, quoted + " was seen in " + std::to_string(cluster.bins) +
                                        " angular bins, it takes " +
                                        std::to_string(settings_.min_bins) + " to judge it");
    }
    if (!cluster.valid.weights || !cluster.weights.allFinite() ||
        !cluster.weight_sigmas.allFinite()) {
      return find(Reason::outside_basis, quoted + " has no valid weights");
    }
    if (draft || !usable(taught)) {
      return find(Reason::calibration_or_recipe, quoted + " has no taught limits");
    }
    if (i >= observed.size() || !observed[i] || !is_finite(*observed[i])) {
      return find(Reason::outside_basis, quoted + " could not be compared with the taught parts");
    }
    judge_weights(i, cluster, taught, *observed[i]);
    judge_readings(i, cluster, taught, *observed[i]);
  }

  const RuleSet& rules() const { return recipe_->rules; }

  /// Keeps an outcome; what does not pass is found.
  void keep(RuleOutcome outcome) {
    if (outcome.verdict != Verdict::pass) find(outcome.reason, outcome.text);
    judgement_.rules.push_back(std::move(outcome));
  }

  void judge_cluster_rules(std::size_t i, bool there, const std::vector<ClusterResult>& clusters,
                           const std::vector<std::optional<ClusterObservation>>& observed) {
    const TaughtCluster& taught = recipe_->clusters[i];
    const int index = static_cast<int>(i);
    const bool comparable = i < observed.size() && observed[i] && is_finite(*observed[i]);
    there = there && i < clusters.size() && clusters[i].present;
    for (const Rule& rule : rules().rules) {
      if (!rule.is_about(rule.reading, index) || rule_reading_info(rule.reading).of_part) continue;
      RuleValue value;
      if (there) {
        value =
            cluster_value(rule.reading, clusters[i], taught, comparable ? &*observed[i] : nullptr);
      }
      RuleOutcome outcome =
          judge_rule(rule, rules().guard, value, "cluster '" + taught.name + "': ");
      outcome.cluster = index;
      outcome.cluster_name = taught.name;
      if (there) {
        keep(std::move(outcome));
      } else {  // found already, as what it is
        outcome.reason = Reason::missing_cluster;
        outcome.text = "cluster '" + taught.name + "' is missing";
        judgement_.rules.push_back(std::move(outcome));
      }
    }
  }

  void judge_part_rules(const PartFacts& facts) {
    for (const Rule& rule : rules().rules) {
      if (!rule_reading_info(rule.reading).of_part) continue;
      keep(judge_rule(rule, rules().guard, part_value(rule.reading, facts, rule.kind),
                      "the part: "));
    }
  }

  static bool usable(const TaughtCluster& taught) {
    return std::isfinite(taught.t2_limit) && taught.t2_limit > 0 &&
           std::isfinite(taught.spe_limit) && taught.spe_limit > 0;
  }

  void judge_area(const ClusterResult& cluster, const TaughtCluster& taught,
                  const std::string& quoted) {
    const double drop = taught.area_share - cluster.area_share;
    if (!std::isfinite(drop)) {
      find(Reason::coverage, quoted + ": its share of the part is not known");
    } else if (drop > settings_.area_share_limit) {
      find(Reason::missing_cluster, quoted + " covers " + percent(cluster.area_share) +
                                        " of the part, taught " + percent(taught.area_share) +
                                        ": the drop is over its limit " +
                                        percent(settings_.area_share_limit));
    }
  }

  void judge_weights(std::size_t i, ClusterResult& cluster, const TaughtCluster& taught,
                     const ClusterObservation& seen) {
    cluster.deviation = deviation(taught, seen);
    const Deviation& d = cluster.deviation;
    const std::string in_cluster = " in cluster '" + taught.name + "'";
    if (!std::isfinite(d.t2) || !std::isfinite(d.spe)) {
      return find(
          Reason::outside_basis,
          "T2 or SPE could not be computed" + in_cluster +
              ": nothing comparable to the taught parts was seen, or a value is not finite");
    }
    keep_ratios(static_cast<int>(i), d);
    if (d.t2 > d.t2_limit) {
      const MonitoredShift shift = largest_shift(taught, seen);
      find(Reason::t2, "T2 = " + number(d.t2) + " over its limit " + number(d.t2_limit) +
                           in_cluster + ": " + shift.name + " is off by " +
                           signed_percent(shift.change) + " (" + signed_sigmas(shift.sigmas) + ")");
    }
    if (d.spe > d.spe_limit) {
      const ResidualShift shift = largest_residual(taught, seen);
      find(Reason::spe, "SPE = " + number(d.spe) + " over its limit " + number(d.spe_limit) +
                            in_cluster + ": what the monitored changes do not explain is " +
                            signed_sigmas(shift.sigmas) + " in " +
                            channel_name(shift.channel, seen.channels()) + " at theta_h " +
                            number(shift.angles.theta_h * 180 / EIGEN_PI) + " deg");
    }
  }

  void keep_ratios(int index, const Deviation& d) {
    const double t2 = d.t2 / d.t2_limit, spe = d.spe / d.spe_limit;
    if (std::max(t2, spe) > std::max(judgement_.t2_ratio, judgement_.spe_ratio)) {
      judgement_.worst_cluster = index;
    }
    judgement_.t2_ratio = std::max(judgement_.t2_ratio, t2);
    judgement_.spe_ratio = std::max(judgement_.spe_ratio, spe);
  }

  void judge_readings(std::size_t i, ClusterResult& cluster, const TaughtCluster& taught,
                      const ClusterObservation& seen) {
    const std::string quoted = "cluster '" + taught.name + "'";
    const int index = static_cast<int>(i);
    if (cluster.valid.colour) {
      cluster.delta_e00 =
          delta_e00(taught.lab, compared_colour(taught, seen).value_or(cluster.lab));
    }
    if (cluster.valid.colour && !rules().has(RuleReading::delta_e00, index)) {
      judge_reading(Reason::colour, cluster.delta_e00, settings_.colour_limit_de00,
                    quoted + ": colour is " + number(cluster.delta_e00) +
                        " dE00 from the taught one, over its limit " +
                        number(settings_.colour_limit_de00),
                    quoted + ": its colour is not a finite number");
    }
    if (cluster.valid.gloss && !rules().has(RuleReading::gloss_60_gu, index)) {
      const double change = cluster.gloss_gu[1] - taught.gloss_gu[1];
      const bool finite = std::all_of(cluster.gloss_gu.begin(), cluster.gloss_gu.end(),
                                      [](double gloss) { return std::isfinite(gloss); });
      judge_reading(Reason::gloss, finite ? std::abs(change) : kUnknownReading,
                    settings_.gloss_limit_gu,
                    quoted + ": gloss at 60 deg is " + number(cluster.gloss_gu[1]) +
                        " GU, taught " + number(taught.gloss_gu[1]) +
                        ": the change is over its limit " + number(settings_.gloss_limit_gu),
                    quoted + ": its gloss is not a finite number");
    }
  }

  void judge_reading(Reason reason, double value, double limit, const std::string& over,
                     const std::string& unknown) {
    if (!std::isfinite(value)) return find(Reason::outside_basis, unknown);
    if (value > limit) find(reason, over);
  }

  const Recipe* recipe_;
  const JudgeSettings& settings_;
  Judgement judgement_;
};

}  // namespace

std::vector<std::string> drifted_lamps(const PartFacts& facts) {
  std::vector<std::string> out;
  for (std::size_t l = 0; l < facts.lamp_drift.size(); ++l) {
    const double drift = facts.lamp_drift[l];
    const std::string lamp = "calibration: light " + std::to_string(l + 1);
    if (!std::isfinite(drift)) {
      out.push_back(lamp +
                    " cannot be checked: the monitor patch is covered, dirty, clipped or out of "
                    "view");
    } else if (std::abs(drift) > facts.max_lamp_drift) {
      out.push_back(lamp + " drifted by " + (drift > 0 ? "+" : "") + percent(drift) +
                    ", over its limit " + percent(facts.max_lamp_drift) +
                    " (lamp or patch: clean it, then calibrate)");
    }
  }
  return out;
}

Judgement judge(const Recipe* recipe, const JudgeSettings& settings,
                std::vector<ClusterResult>& clusters,
                const std::vector<std::optional<ClusterObservation>>& observed,
                const PartFacts& facts) {
  return Judge(recipe, settings)(clusters, observed, facts);
}

}  // namespace brdfgate
