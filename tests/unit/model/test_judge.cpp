#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "catch.hpp"
#include "model/judge.hpp"
#include "support/gaussian_parts.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::GaussianParts;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

/// A two-cluster recipe and a good part of its kind, to be spoilt one thing at a time.
struct Case {
  Recipe recipe;
  bool in_force = true;
  JudgeSettings station;
  std::vector<ClusterResult> clusters;
  std::vector<std::optional<ClusterObservation>> observed;
  PartFacts facts;
  double gloss_sigma = 0;  ///< of the readings

  Judgement judged() {
    for (ClusterResult& cluster : clusters) {
      for (std::size_t i = 0; i < 3; ++i) {
        cluster.readings.gloss[i] = {cluster.gloss_gu[i], gloss_sigma, i == 1};
        cluster.readings.aspecular[2].lab[i] = {cluster.lab[Eigen::Index(i)], 0, true};
      }
    }
    return judge(in_force ? &recipe : nullptr, station, clusters, observed, facts);
  }
};

Case good_case() {
  static const Case made = [] {
    Case c;
    c.recipe.name = "lid";
    c.recipe.components = 5;
    GaussianParts good(21);
    for (const char* name : {"body", "print"}) {
      TaughtCluster taught = teach_observed(good.parts(10), c.recipe.settings);
      taught.name = name;
      taught.area_share = name == std::string("body") ? 0.8 : 0.2;
      taught.gloss_gu = {30, 60, 80};
      taught.lab = {50, 20, 10};
      c.recipe.clusters.push_back(taught);
      const ClusterObservation seen = good.part();
      ClusterResult cluster;
      cluster.index = static_cast<int>(c.clusters.size());
      cluster.present = true;
      cluster.bins = 40;
      cluster.area_share = taught.area_share;
      cluster.weights = seen.weights;
      cluster.weight_sigmas = Eigen::MatrixXd::Constant(5, 3, 0.1);
      cluster.valid = {true, true, true, true, true};
      cluster.gloss_gu = {30, 62, 80};
      cluster.lab = {50, 20.5, 10};
      c.clusters.push_back(cluster);
      c.observed.emplace_back(seen);
    }
    c.facts.coverage = 0.7;
    c.facts.ambient = 0.001;
    return c;
  }();
  return made;
}

struct Row {
  const char* what;
  std::function<void(Case&)> spoil;
  ReasonBits bits;
  const char* text;
};

void check_rows(const std::vector<Row>& rows) {
  for (const Row& row : rows) {
    Case c = good_case();
    row.spoil(c);
    const Judgement j = c.judged();
    INFO(row.what);
    CHECK(j.reason_bits == row.bits);
    CHECK(j.verdict == verdict_of(row.bits));
    ReasonBits said = 0;
    std::string texts;
    for (const Finding& finding : j.findings) {
      said |= bit(finding.reason);
      texts += finding.text + "\n";
    }
    CHECK(said == j.reason_bits);
    INFO(texts);
    CHECK(contains(texts, row.text));
  }
}

}  // namespace

TEST_CASE("A good part passes, with its names, deviations and ratios filled in", "[judge]") {
  Case c = good_case();
  const Judgement j = c.judged();
  CHECK(j.verdict == Verdict::pass);
  CHECK(j.reason_bits == 0);
  CHECK(j.findings.empty());
  CHECK(c.clusters[0].name == "body");
  CHECK(c.clusters[1].name == "print");
  for (const ClusterResult& cluster : c.clusters) {
    CHECK(cluster.deviation.t2 > 0);
    CHECK(cluster.deviation.t2 < cluster.deviation.t2_limit);
    CHECK(cluster.deviation.spe < cluster.deviation.spe_limit);
    CHECK(cluster.delta_e00 == Approx(delta_e00({50, 20, 10}, {50, 20.5, 10})));
  }
  const auto ratio = [&](int i) {
    return c.clusters[static_cast<std::size_t>(i)].deviation.t2 /
           c.clusters[static_cast<std::size_t>(i)].deviation.t2_limit;
  };
  CHECK(j.t2_ratio == Approx(std::max(ratio(0), ratio(1))));
  CHECK(j.t2_ratio < 1);
}

TEST_CASE("Each thing wrong with a part is rejected under its own bit, in words", "[judge]") {
  check_rows({
      {"a weight far off", [](Case& c) { c.observed[0]->monitored[2] += 3; }, bit(Reason::t2),
       "in cluster 'body': direction 3 is off by +"},
      {"a weight of the last channel far off", [](Case& c) { c.observed[1]->monitored[6] -= 9; },
       bit(Reason::t2), "in cluster 'print': direction 7 is off by -"},
      {"an unexplained highlight", [](Case& c) { c.observed[1]->residual(7, 1) += 5; },
       bit(Reason::spe), "in channel G at theta_h 4.011 deg"},
      {"another colour", [](Case& c) { c.clusters[0].lab[2] = 20; }, bit(Reason::colour),
       "cluster 'body': colour is"},
      {"too glossy", [](Case& c) { c.clusters[1].gloss_gu[1] = 69; }, bit(Reason::gloss),
       "cluster 'print': gloss at 60 deg is 69 GU, taught 60"},
      {"too matt", [](Case& c) { c.clusters[1].gloss_gu[1] = 51; }, bit(Reason::gloss),
       "over its limit 8"},
      {"the print missing", [](Case& c) { c.clusters[1].present = false; },
       bit(Reason::missing_cluster), "cluster 'print' is missing"},
      {"the print not even measured", [](Case& c) { c.clusters.pop_back(); },
       bit(Reason::missing_cluster), "cluster 'print' is missing"},
      {"the print elsewhere", [](Case& c) { c.facts.in_place = {1, 0.4}; },
       bit(Reason::missing_cluster), "cluster 'print' is missing from its place: 40 % of it"},
      {"half the print missing", [](Case& c) { c.clusters[1].area_share = 0.1; },
       bit(Reason::missing_cluster), "covers 10 % of the part, taught 20 %"},
      {"a stain of no taught material", [](Case& c) { c.facts.unknown_share = 0.01; },
       bit(Reason::unknown_region), "1 % of the part matches no taught cluster"},
      {"two defects",
       [](Case& c) {
         c.facts.defects = {{"darker", {1, 2}, 0.5, 2}, {"duller", {10, -5}, 2.25, 1.5}};
       },
       bit(Reason::local_defect), "2 local defects; the largest: duller, 2.25 mm at (10, -5) mm"},
      {"two things at once",
       [](Case& c) {
         c.facts.unknown_share = 0.01;
         c.clusters[0].lab[2] = 20;
       },
       ReasonBits(bit(Reason::unknown_region) | bit(Reason::colour)), "colour"},
  });
}

TEST_CASE("What cannot be measured is not judged, and says why", "[judge]") {
  check_rows({
      {"too much light", [](Case& c) { c.facts.ambient = 0.06; }, bit(Reason::ambient),
       "ambient light is 6 % of white, over its limit 5 %"},
      {"clipped", [](Case& c) { c.facts.clipped = 0.03; }, bit(Reason::clipped),
       "3 % of the part is clipped"},
      {"a lamp that drifted",
       [](Case& c) {
         c.facts.max_lamp_drift = 0.05;
         c.facts.lamp_drift = {0.02, -0.06};
       },
       bit(Reason::calibration_or_recipe), "light 2 drifted by -6 %, over its limit 5 %"},
      {"a lamp of which nothing is known",
       [](Case& c) {
         c.facts.max_lamp_drift = 0.05;
         c.facts.lamp_drift = {kNaN, 0};
       },
       bit(Reason::calibration_or_recipe), "light 1 cannot be checked"},
      {"few bins", [](Case& c) { c.clusters[1].bins = 19; }, bit(Reason::coverage),
       "cluster 'print' was seen in 19 angular bins"},
      {"shifted", [](Case& c) { c.facts.shift_mm = {4, -3.1}; }, bit(Reason::pose_or_face),
       "5.061 mm from its taught place, over its limit 5 mm"},
      {"turned", [](Case& c) { c.facts.rotation_deg = -5.5; }, bit(Reason::pose_or_face),
       "turned by -5.5 deg in its plane"},
      {"tilted", [](Case& c) { c.facts.tilt_deg = {0.2, -1.6}; }, bit(Reason::tilt),
       "tilted by (0.2, -1.6) deg, over its limit 1.5 deg"},
      {"nowhere to be found", [](Case& c) { c.facts.pose_problem = "no match"; },
       bit(Reason::pose_or_face), "no match"},
      {"no part",
       [](Case& c) {
         c.facts.coverage = 0.01;
         c.facts.ambient = 0.5;
         c.clusters.clear();
         c.observed.clear();
       },
       bit(Reason::part_absent), "no part"},
      {"another part",
       [](Case& c) {
         c.facts.unknown_share = 0.95;
         for (ClusterResult& cluster : c.clusters)
           cluster.present = false;
       },
       bit(Reason::pose_or_face), "wrong face, wrong part or out of view"},
      {"another part, one-cluster recipe",
       [](Case& c) {
         c.recipe.clusters.resize(1);
         c.clusters.resize(1);
         c.clusters[0].present = false;
         c.facts.unknown_share = 1;
       },
       bit(Reason::pose_or_face), "no region looks like the taught part"},
      {"no recipe", [](Case& c) { c.in_force = false; }, bit(Reason::calibration_or_recipe),
       "no recipe is in force"},
      {"an empty recipe", [](Case& c) { c.recipe.clusters.clear(); },
       bit(Reason::calibration_or_recipe), "has no clusters"},
      {"a draft of a recipe",
       [](Case& c) {
         TaughtCluster draft;
         draft.name = "body";
         draft.mean = c.recipe.clusters[0].mean;
         c.recipe.clusters[0] = draft;
       },
       bit(Reason::calibration_or_recipe), "cluster 'body' has no taught limits"},
      {"a reject beside it",
       [](Case& c) {
         c.facts.ambient = 0.06;
         c.clusters[0].lab[2] = 20;
       },
       ReasonBits(bit(Reason::ambient) | bit(Reason::colour)), "colour is"},
  });
}

TEST_CASE("A calibration that is due is used until its grace ends, then nothing is judged",
          "[judge]") {
  struct Row {
    std::optional<int> days;
    int grace;
    bool judged;
  };
  const auto row = GENERATE(Row{std::nullopt, 0, true}, Row{5, 0, true}, Row{0, 0, true},
                            Row{-1, 0, false}, Row{-30, 30, true}, Row{-31, 30, false});
  Case c = good_case();
  c.facts.calibration = {row.days, row.grace};
  const Judgement judged = c.judged();
  CHECK((judged.verdict == Verdict::pass) == row.judged);
  CHECK((judged.reason_bits == bit(Reason::calibration_or_recipe)) == !row.judged);
  if (!row.judged)
    CHECK_THAT(judged.findings.at(0).text, Catch::Contains("the calibration was due"));
}

TEST_CASE("A number that is not finite anywhere is never a pass", "[judge]") {
  using Spoil = std::function<void(Case&, double)>;
  const std::vector<std::pair<const char*, Spoil>> spoils{
      {"ambient", [](Case& c, double v) { c.facts.ambient = v; }},
      {"clipped", [](Case& c, double v) { c.facts.clipped = v; }},
      {"unknown share", [](Case& c, double v) { c.facts.unknown_share = v; }},
      {"coverage", [](Case& c, double v) { c.facts.coverage = v; }},
      {"a weight", [](Case& c, double v) { c.clusters[0].weights(4, 2) = v; }},
      {"a weight's deviation", [](Case& c, double v) { c.clusters[0].weight_sigmas(0, 0) = v; }},
      {"a monitored weight", [](Case& c, double v) { c.observed[1]->monitored[0] = v; }},
      {"its noise", [](Case& c, double v) { c.observed[1]->monitored_noise(1, 1) = v; }},
      {"a residual", [](Case& c, double v) { c.observed[0]->residual(5, 0) = v; }},
      {"a residual's noise",
       [](Case& c, double v) { c.observed[0]->residual_noise.setConstant(v); }},
      {"gloss", [](Case& c, double v) { c.clusters[1].gloss_gu[1] = v; }},
      {"gloss at 85", [](Case& c, double v) { c.clusters[1].gloss_gu[2] = v; }},
      {"colour", [](Case& c, double v) { c.clusters[1].lab[0] = v; }},
      {"shift", [](Case& c, double v) { c.facts.shift_mm[1] = v; }},
      {"rotation", [](Case& c, double v) { c.facts.rotation_deg = v; }},
      {"tilt", [](Case& c, double v) { c.facts.tilt_deg[0] = v; }},
      {"tilt about y", [](Case& c, double v) { c.facts.tilt_deg[1] = v; }},
      {"area", [](Case& c, double v) { c.clusters[1].area_share = v; }},
      {"a taught mean", [](Case& c, double v) { c.recipe.clusters[0].monitored_mean[0] = v; }},
      {"a taught limit", [](Case& c, double v) { c.recipe.clusters[0].t2_limit = v; }},
      {"a taught SPE limit", [](Case& c, double v) { c.recipe.clusters[0].spe_limit = v; }},
  };
  for (const auto& [what, spoil] : spoils) {
    for (const double value : {kNaN, kInf, -kInf}) {
      Case c = good_case();
      spoil(c, value);
      const Judgement j = c.judged();
      CAPTURE(what, value);
      CHECK(j.verdict == Verdict::not_judged);
      CHECK_FALSE(j.findings.empty());
      CHECK(std::isfinite(j.t2_ratio));
      CHECK(std::isfinite(j.spe_ratio));
    }
  }
}

TEST_CASE("A cluster whose weights are not valid is never a pass", "[judge]") {
  Case c = good_case();
  c.clusters[1].valid.weights = false;
  CHECK(c.judged().verdict == Verdict::not_judged);
  c = good_case();
  c.observed[1].reset();
  CHECK(c.judged().verdict == Verdict::not_judged);
  c = good_case();
  c.observed.pop_back();
  CHECK(c.judged().verdict == Verdict::not_judged);
}

TEST_CASE("Readings that are not valid are not held against the part", "[judge]") {
  Case c = good_case();
  c.clusters[0].valid.colour = c.clusters[0].valid.gloss = false;
  c.clusters[0].lab = {0, 0, 0};
  c.clusters[0].gloss_gu = {0, 0, 0};
  CHECK(c.judged().verdict == Verdict::pass);
  CHECK(c.clusters[0].delta_e00 == 0);
}

TEST_CASE("Without a recipe the station's own limits for light hold", "[judge]") {
  Case c = good_case();
  c.in_force = false;
  c.station.max_ambient = 1e-4;
  CHECK(c.judged().reason_bits == (bit(Reason::ambient) | bit(Reason::calibration_or_recipe)));
  c.in_force = true;  // the recipe's are its own
  CHECK(c.judged().verdict == Verdict::pass);
}

TEST_CASE("The worst cluster is the one farthest beyond its limit", "[judge]") {
  Case c = good_case();
  c.observed[1]->monitored[0] += 2;
  CHECK(c.judged().worst_cluster == 1);
  c.observed[0]->monitored[0] += 5;
  CHECK(c.judged().worst_cluster == 0);
}

namespace {

Rule rule_of(RuleReading reading, double high, int cluster = kEveryCluster) {
  Rule rule;
  rule.reading = reading;
  rule.high = high;
  rule.cluster = cluster;
  return rule;
}

Rule tolerance_of(RuleReading reading, double tolerance, int cluster = kEveryCluster) {
  Rule rule;
  rule.reading = reading;
  rule.tolerance = tolerance;
  rule.cluster = cluster;
  return rule;
}

}  // namespace

TEST_CASE("The recipe's rules reject or do not judge under the reading's bit, in words",
          "[judge][rules]") {
  using R = RuleReading;
  const auto with = [](const Rule& rule, const std::function<void(Case&)>& spoil = {}) {
    return [rule, spoil](Case& c) {
      c.recipe.rules.rules.push_back(rule);
      if (spoil) spoil(c);
    };
  };
  check_rows({
      {"colour, of every cluster", with(rule_of(R::delta_e00, 0.2)), bit(Reason::colour),
       "cluster 'print': delta_e00 is"},
      {"a lightness", with(rule_of(R::l_star, 49)), bit(Reason::colour),
       "l_star is 50 L* (sigma 0), over its limit 49 L* by 1 L*"},
      {"gloss around the taught one", with(tolerance_of(R::gloss_60_gu, 1.5, 1)),
       bit(Reason::gloss),
       "gloss_60_gu is 62 GU (sigma 0), over its limit 61.5 GU (taught 60 + 1.5) by 0.5 GU"},
      {"gloss at 20", with(rule_of(R::gloss_20_gu, 20, 0)), bit(Reason::gloss),
       "cluster 'body': gloss_20_gu is 30 GU"},
      {"an area", with(rule_of(R::area_share, 0.75, 0)), bit(Reason::missing_cluster),
       "area_share is 0.8, over its limit 0.75 by 0.05"},
      {"a residual",
       with(rule_of(R::residual_rms, 0.1), [](Case& c) { c.clusters[1].raw.residual_rms = 0.3; }),
       bit(Reason::spe), "residual_rms is 0.3 ln"},
      {"unknown cells",
       with(rule_of(R::unknown_share, 1e-4), [](Case& c) { c.facts.unknown_share = 2e-4; }),
       bit(Reason::unknown_region), "the part: unknown_share is 0.0002, over its limit 0.0001"},
      {"too many defects",
       with(rule_of(R::defects, 1),
            [](Case& c) { c.facts.defects = {{"darker", {}, 1, 2}, {"duller", {}, 1, 2}}; }),
       bit(Reason::local_defect), "the part: defects is 2, over its limit 1 by 1"},
      {"too large a defect",
       with(rule_of(R::defect_size_mm, 1),
            [](Case& c) { c.facts.defects = {{"darker", {}, 0.5, 2}, {"duller", {}, 1.25, 2}}; }),
       bit(Reason::local_defect), "defect_size_mm is 1.25 mm"},
      {"too much of them",
       with(rule_of(R::defect_area_mm2, 3),
            [](Case& c) { c.facts.defects = {{"darker", {}, 2, 2}, {"duller", {}, 2, 2}}; }),
       bit(Reason::local_defect), "defect_area_mm2 is 6.283 mm2"},
      {"a tilted part is not judged",
       with(rule_of(R::tilt_deg, 0.5), [](Case& c) { c.facts.tilt_deg = {0.1, -0.7}; }),
       bit(Reason::tilt), "tilt_deg is 0.7 deg"},
      {"colour where none is known",
       with(rule_of(R::delta_e00, 5), [](Case& c) { c.clusters[0].valid.colour = false; }),
       bit(Reason::calibration_or_recipe), "this station knows no colour"},
      {"haze of what has none", with(rule_of(R::haze_gu, 5, 0)), bit(Reason::outside_basis),
       "haze_gu is not known: haze is defined for over 70 GU"},
  });
}

TEST_CASE("A rule stands instead of the settings' limit on its reading and cluster",
          "[judge][rules]") {
  using R = RuleReading;
  struct Row {
    const char* what;
    std::function<void(Case&)> spoil;
    Rule rule;
    bool passes;
  };
  const auto colour = [](Case& c) { c.clusters[0].lab[2] = 14; };  // dE00 2.4
  const auto matt = [](Case& c) { c.clusters[1].gloss_gu[1] = 50; };
  const auto stain = [](Case& c) { c.facts.defects = {{"darker", {1, 2}, 0.5, 2}}; };
  Rule darker = rule_of(R::defects, 1);
  darker.kind = "darker";
  Rule duller = darker;
  duller.kind = "duller";
  const Row rows[] = {
      {"colour", colour, rule_of(R::delta_e00, 4), true},
      {"colour of another cluster", colour, rule_of(R::delta_e00, 4, 1), false},
      {"another reading of colour", colour, rule_of(R::l_star, 60), false},
      {"gloss", matt, tolerance_of(R::gloss_60_gu, 12, 1), true},
      {"gloss at another angle", matt, tolerance_of(R::gloss_20_gu, 12, 1), false},
      {"area", [](Case& c) { c.clusters[1].area_share = 0.15; },
       tolerance_of(R::area_share, 0.06, 1), true},
      {"unknown cells", [](Case& c) { c.facts.unknown_share = 0.005; },
       rule_of(R::unknown_share, 0.01), true},
      {"tilt", [](Case& c) { c.facts.tilt_deg = {1.8, 0}; }, rule_of(R::tilt_deg, 2), true},
      {"defects of all kinds", stain, rule_of(R::defects, 1), true},
      {"defects' size", stain, rule_of(R::defect_size_mm, 1), true},
      {"defects of this kind", stain, darker, true},
      {"defects of another kind", stain, duller, false},
  };
  for (const Row& row : rows) {
    CAPTURE(row.what);
    Case c = good_case();
    row.spoil(c);
    CHECK(c.judged().verdict != Verdict::pass);
    c.recipe.rules.rules = {row.rule};
    CHECK((c.judged().verdict == Verdict::pass) == row.passes);
  }
}

TEST_CASE("No rule makes a pass of what is not known", "[judge][rules]") {
  const auto any = [](RuleReading reading) {
    const RuleReadingInfo& info = rule_reading_info(reading);
    Rule rule = rule_of(reading, info.most);
    rule.low = info.least;
    return rule;
  };
  using R = RuleReading;
  using Spoil = std::function<void(Case&, double)>;
  const std::vector<std::pair<R, Spoil>> rows{
      {R::gloss_20_gu, [](Case& c, double v) { c.clusters[1].gloss_gu[0] = v; }},
      {R::gloss_60_gu, [](Case& c, double v) { c.clusters[1].gloss_gu[1] = v; }},
      {R::l_star, [](Case& c, double v) { c.clusters[0].lab[0] = v; }},
      {R::delta_e00, [](Case& c, double v) { c.clusters[0].lab[1] = v; }},
      {R::area_share, [](Case& c, double v) { c.clusters[1].area_share = v; }},
      {R::residual_rms, [](Case& c, double v) { c.clusters[0].raw.residual_rms = v; }},
      {R::unknown_share, [](Case& c, double v) { c.facts.unknown_share = v; }},
      {R::tilt_deg, [](Case& c, double v) { c.facts.tilt_deg[1] = v; }},
      {R::tilt_deg, [](Case& c, double v) { c.facts.tilt_sigma_deg[0] = v; }},
      {R::defect_size_mm,
       [](Case& c, double v) { c.facts.defects = {{"darker", {}, v, 2}, {"darker", {}, 1, 2}}; }},
  };
  for (const auto& [reading, spoil] : rows) {
    for (const double value : {kNaN, kInf}) {
      CAPTURE(rule_reading_info(reading).name, value);
      Case c = good_case();
      c.recipe.rules.rules = {any(reading)};
      CHECK(c.judged().verdict == Verdict::pass);
      spoil(c, value);
      CHECK(c.judged().verdict == Verdict::not_judged);
    }
  }
}

TEST_CASE("A rule within the uncertainty of its reading is not judged", "[judge][rules]") {
  Case c = good_case();
  c.gloss_sigma = 2;  // of 62 GU
  c.recipe.rules.rules = {rule_of(RuleReading::gloss_60_gu, 65)};
  const Judgement j = c.judged();
  CHECK(j.reason_bits == bit(Reason::coverage));
  CHECK(contains(j.findings.at(0).text, "its guard band of 1.65 sigmas spans 58.79 to 65.39 GU"));
  c.recipe.rules.guard = 1;
  CHECK(c.judged().verdict == Verdict::pass);
  // A tolerance counts what noise alone does, six times over, against the mean of ten parts.
  c.recipe.rules.rules = {tolerance_of(RuleReading::gloss_60_gu, 3)};
  CHECK(c.judged().verdict == Verdict::not_judged);
  c.clusters[0].repeat.gloss[1].sigma = c.clusters[1].repeat.gloss[1].sigma = 0.1;
  const Judgement again = c.judged();
  CHECK(again.verdict == Verdict::pass);
  CHECK(again.rules.at(0).sigma == Approx(0.6 * std::sqrt(1.1)));
}

TEST_CASE("A reading that rules demand measured is not judged where it is extrapolated",
          "[judge][rules]") {
  Case c = good_case();
  Rule rule = rule_of(RuleReading::gloss_20_gu, 100);
  c.recipe.rules.rules = {rule};
  CHECK(c.judged().verdict == Verdict::pass);
  rule.measured = true;
  c.recipe.rules.rules = {rule};
  CHECK(c.judged().reason_bits == bit(Reason::coverage));
  rule.reading = RuleReading::gloss_60_gu;
  c.recipe.rules.rules = {rule};
  CHECK(c.judged().verdict == Verdict::pass);
}

TEST_CASE("A missing cluster is rejected as missing, and its rules are not judged",
          "[judge][rules]") {
  Case c = good_case();
  c.recipe.rules.rules = {rule_of(RuleReading::gloss_60_gu, 100)};
  c.clusters[1].present = false;
  const Judgement j = c.judged();
  CHECK(j.reason_bits == bit(Reason::missing_cluster));
  REQUIRE(j.rules.size() == 2);
  CHECK(j.rules[0].verdict == Verdict::pass);
  CHECK(j.rules[1].verdict == Verdict::not_judged);
  CHECK(j.rules[1].cluster_name == "print");
}

TEST_CASE("A colour rule's uncertainty is what noise does to the compared levels",
          "[judge][rules]") {
  Case c = good_case();
  TaughtCluster& taught = c.recipe.clusters[0];
  taught.directions.names = {level_name(0, 3), level_name(1, 3), level_name(2, 3)};
  c.recipe.rules.rules = {rule_of(RuleReading::delta_e00, 50, 0),
                          tolerance_of(RuleReading::l_star, 40, 0)};
  ClusterObservation& seen = *c.observed[0];
  seen.monitored = taught.monitored_mean;
  seen.monitored_noise.setZero();
  // The same 1 % in all channels: L* moves by dL/dY Y 1 %.
  seen.monitored_noise.topLeftCorner<3, 3>().setConstant(1e-4);
  const Judgement j = c.judged();
  REQUIRE(j.rules.size() == 2);
  const double n = 1 + 1.0 / taught.parts, y = lab_to_xyz(taught.lab)[1];
  const double expected = 116.0 / 3 * std::cbrt(y) * 0.01 * std::sqrt(n);
  CHECK(j.rules[0].value == Approx(0).margin(1e-6));
  CHECK(j.rules[1].value == Approx(50));
  CHECK(j.rules[1].sigma == Approx(expected).epsilon(0.01));
  const double one_percent = 0.01 * std::sqrt(n);
  const Lab brighter =
      linear_srgb_to_lab(xyz_to_linear_srgb(lab_to_xyz(taught.lab)) * (1 + one_percent));
  CHECK(j.rules[0].sigma == Approx(delta_e00(taught.lab, brighter)).epsilon(0.02));
}
