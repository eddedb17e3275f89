#include <cmath>

#include "support/judge_case.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

TEST_CASE("A good part passes, with its names, deviations and ratios filled in", "[judge]") {
  JudgedCase c = good_case();
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
      {"a weight far off", [](JudgedCase& c) { c.observed[0]->monitored[2] += 3; }, bit(Reason::t2),
       "in cluster 'body': direction 3 is off by +"},
      {"a weight of the last channel far off",
       [](JudgedCase& c) { c.observed[1]->monitored[6] -= 9; }, bit(Reason::t2),
       "in cluster 'print': direction 7 is off by -"},
      {"an unexplained highlight", [](JudgedCase& c) { c.observed[1]->residual(7, 1) += 5; },
       bit(Reason::spe), "in channel G at theta_h 4.011 deg"},
      {"another colour", [](JudgedCase& c) { c.clusters[0].lab[2] = 20; }, bit(Reason::colour),
       "cluster 'body': colour is"},
      {"too glossy", [](JudgedCase& c) { c.clusters[1].gloss_gu[1] = 69; }, bit(Reason::gloss),
       "cluster 'print': gloss at 60 deg is 69 GU, taught 60"},
      {"too matt", [](JudgedCase& c) { c.clusters[1].gloss_gu[1] = 51; }, bit(Reason::gloss),
       "over its limit 8"},
      {"the print missing", [](JudgedCase& c) { c.clusters[1].present = false; },
       bit(Reason::missing_cluster), "cluster 'print' is missing"},
      {"the print not even measured", [](JudgedCase& c) { c.clusters.pop_back(); },
       bit(Reason::missing_cluster), "cluster 'print' is missing"},
      {"the print elsewhere", [](JudgedCase& c) { c.facts.in_place = {1, 0.4}; },
       bit(Reason::missing_cluster), "cluster 'print' is missing from its place: 40 % of it"},
      {"half the print missing", [](JudgedCase& c) { c.clusters[1].area_share = 0.1; },
       bit(Reason::missing_cluster), "covers 10 % of the part, taught 20 %"},
      {"a stain of no taught material", [](JudgedCase& c) { c.facts.unknown_share = 0.01; },
       bit(Reason::unknown_region), "1 % of the part matches no taught cluster"},
      {"two defects",
       [](JudgedCase& c) {
         c.facts.defects = {{"darker", {1, 2}, 0.5, 2}, {"duller", {10, -5}, 2.25, 1.5}};
       },
       bit(Reason::local_defect), "2 local defects; the largest: duller, 2.25 mm at (10, -5) mm"},
      {"two things at once",
       [](JudgedCase& c) {
         c.facts.unknown_share = 0.01;
         c.clusters[0].lab[2] = 20;
       },
       ReasonBits(bit(Reason::unknown_region) | bit(Reason::colour)), "colour"},
  });
}

TEST_CASE("What cannot be measured is not judged, and says why", "[judge]") {
  check_rows({
      {"too much light", [](JudgedCase& c) { c.facts.ambient = 0.06; }, bit(Reason::ambient),
       "ambient light is 6 % of white, over its limit 5 %"},
      {"clipped", [](JudgedCase& c) { c.facts.clipped = 0.03; }, bit(Reason::clipped),
       "3 % of the part is clipped"},
      {"a lamp that drifted",
       [](JudgedCase& c) {
         c.facts.max_lamp_drift = 0.05;
         c.facts.lamp_drift = {0.02, -0.06};
       },
       bit(Reason::calibration_or_recipe), "light 2 drifted by -6 %, over its limit 5 %"},
      {"a lamp of which nothing is known",
       [](JudgedCase& c) {
         c.facts.max_lamp_drift = 0.05;
         c.facts.lamp_drift = {kNaN, 0};
       },
       bit(Reason::calibration_or_recipe), "light 1 cannot be checked"},
      {"few bins", [](JudgedCase& c) { c.clusters[1].bins = 19; }, bit(Reason::coverage),
       "cluster 'print' was seen in 19 angular bins"},
      {"shifted", [](JudgedCase& c) { c.facts.shift_mm = {4, -3.1}; }, bit(Reason::pose_or_face),
       "5.061 mm from its taught place, over its limit 5 mm"},
      {"turned", [](JudgedCase& c) { c.facts.rotation_deg = -5.5; }, bit(Reason::pose_or_face),
       "turned by -5.5 deg in its plane"},
      {"tilted", [](JudgedCase& c) { c.facts.tilt_deg = {0.2, -1.6}; }, bit(Reason::tilt),
       "tilted by (0.2, -1.6) deg, over its limit 1.5 deg"},
      {"nowhere to be found", [](JudgedCase& c) { c.facts.pose_problem = "no match"; },
       bit(Reason::pose_or_face), "no match"},
      {"no part",
       [](JudgedCase& c) {
         c.facts.coverage = 0.01;
         c.facts.ambient = 0.5;
         c.clusters.clear();
         c.observed.clear();
       },
       bit(Reason::part_absent), "no part"},
      {"another part",
       [](JudgedCase& c) {
         c.facts.unknown_share = 0.95;
         for (ClusterResult& cluster : c.clusters)
           cluster.present = false;
       },
       bit(Reason::pose_or_face), "wrong face, wrong part or out of view"},
      {"another part, one-cluster recipe",
       [](JudgedCase& c) {
         c.recipe.clusters.resize(1);
         c.clusters.resize(1);
         c.clusters[0].present = false;
         c.facts.unknown_share = 1;
       },
       bit(Reason::pose_or_face), "no region looks like the taught part"},
      {"no recipe", [](JudgedCase& c) { c.in_force = false; }, bit(Reason::calibration_or_recipe),
       "no recipe is in force"},
      {"an empty recipe", [](JudgedCase& c) { c.recipe.clusters.clear(); },
       bit(Reason::calibration_or_recipe), "has no clusters"},
      {"a draft of a recipe",
       [](JudgedCase& c) {
         TaughtCluster draft;
         draft.name = "body";
         draft.mean = c.recipe.clusters[0].mean;
         c.recipe.clusters[0] = draft;
       },
       bit(Reason::calibration_or_recipe), "cluster 'body' has no taught limits"},
      {"a reject beside it",
       [](JudgedCase& c) {
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
  JudgedCase c = good_case();
  c.facts.calibration = {row.days, row.grace};
  const Judgement judged = c.judged();
  CHECK((judged.verdict == Verdict::pass) == row.judged);
  CHECK((judged.reason_bits == bit(Reason::calibration_or_recipe)) == !row.judged);
  if (!row.judged)
    CHECK_THAT(judged.findings.at(0).text, Catch::Contains("the calibration was due"));
}

TEST_CASE("A number that is not finite anywhere is never a pass", "[judge]") {
  using Spoil = std::function<void(JudgedCase&, double)>;
  const std::vector<std::pair<const char*, Spoil>> spoils{
      {"ambient", [](JudgedCase& c, double v) { c.facts.ambient = v; }},
      {"clipped", [](JudgedCase& c, double v) { c.facts.clipped = v; }},
      {"unknown share", [](JudgedCase& c, double v) { c.facts.unknown_share = v; }},
      {"coverage", [](JudgedCase& c, double v) { c.facts.coverage = v; }},
      {"a weight", [](JudgedCase& c, double v) { c.clusters[0].weights(4, 2) = v; }},
      {"a weight's deviation",
       [](JudgedCase& c, double v) { c.clusters[0].weight_sigmas(0, 0) = v; }},
      {"a monitored weight", [](JudgedCase& c, double v) { c.observed[1]->monitored[0] = v; }},
      {"its noise", [](JudgedCase& c, double v) { c.observed[1]->monitored_noise(1, 1) = v; }},
      {"a residual", [](JudgedCase& c, double v) { c.observed[0]->residual(5, 0) = v; }},
      {"a residual's noise",
       [](JudgedCase& c, double v) { c.observed[0]->residual_noise.setConstant(v); }},
      {"gloss", [](JudgedCase& c, double v) { c.clusters[1].gloss_gu[1] = v; }},
      {"gloss at 85", [](JudgedCase& c, double v) { c.clusters[1].gloss_gu[2] = v; }},
      {"colour", [](JudgedCase& c, double v) { c.clusters[1].lab[0] = v; }},
      {"shift", [](JudgedCase& c, double v) { c.facts.shift_mm[1] = v; }},
      {"rotation", [](JudgedCase& c, double v) { c.facts.rotation_deg = v; }},
      {"tilt", [](JudgedCase& c, double v) { c.facts.tilt_deg[0] = v; }},
      {"tilt about y", [](JudgedCase& c, double v) { c.facts.tilt_deg[1] = v; }},
      {"area", [](JudgedCase& c, double v) { c.clusters[1].area_share = v; }},
      {"a taught mean",
       [](JudgedCase& c, double v) { c.recipe.clusters[0].monitored_mean[0] = v; }},
      {"a taught limit", [](JudgedCase& c, double v) { c.recipe.clusters[0].t2_limit = v; }},
      {"a taught SPE limit", [](JudgedCase& c, double v) { c.recipe.clusters[0].spe_limit = v; }},
  };
  for (const auto& [what, spoil] : spoils) {
    for (const double value : {kNaN, kInf, -kInf}) {
      JudgedCase c = good_case();
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
  JudgedCase c = good_case();
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
  JudgedCase c = good_case();
  c.clusters[0].valid.colour = c.clusters[0].valid.gloss = false;
  c.clusters[0].lab = {0, 0, 0};
  c.clusters[0].gloss_gu = {0, 0, 0};
  CHECK(c.judged().verdict == Verdict::pass);
  CHECK(c.clusters[0].delta_e00 == 0);
}

TEST_CASE("Without a recipe the station's own limits for light hold", "[judge]") {
  JudgedCase c = good_case();
  c.in_force = false;
  c.station.max_ambient = 1e-4;
  CHECK(c.judged().reason_bits == (bit(Reason::ambient) | bit(Reason::calibration_or_recipe)));
  c.in_force = true;  // the recipe's are its own
  CHECK(c.judged().verdict == Verdict::pass);
}

TEST_CASE("The worst cluster is the one farthest beyond its limit", "[judge]") {
  JudgedCase c = good_case();
  c.observed[1]->monitored[0] += 2;
  CHECK(c.judged().worst_cluster == 1);
  c.observed[0]->monitored[0] += 5;
  CHECK(c.judged().worst_cluster == 0);
}
