#include <cmath>

#include "support/judge_case.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

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
  const auto with = [](const Rule& rule, const std::function<void(JudgedCase&)>& spoil = {}) {
    return [rule, spoil](JudgedCase& c) {
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
       with(rule_of(R::residual_rms, 0.1),
            [](JudgedCase& c) { c.clusters[1].raw.residual_rms = 0.3; }),
       bit(Reason::spe), "residual_rms is 0.3 ln"},
      {"unknown cells",
       with(rule_of(R::unknown_share, 1e-4), [](JudgedCase& c) { c.facts.unknown_share = 2e-4; }),
       bit(Reason::unknown_region), "the part: unknown_share is 0.0002, over its limit 0.0001"},
      {"too many defects",
       with(rule_of(R::defects, 1),
            [](JudgedCase& c) { c.facts.defects = {{"darker", {}, 1, 2}, {"duller", {}, 1, 2}}; }),
       bit(Reason::local_defect), "the part: defects is 2, over its limit 1 by 1"},
      {"too large a defect",
       with(rule_of(R::defect_size_mm, 1),
            [](JudgedCase& c) {
              c.facts.defects = {{"darker", {}, 0.5, 2}, {"duller", {}, 1.25, 2}};
            }),
       bit(Reason::local_defect), "defect_size_mm is 1.25 mm"},
      {"too much of them",
       with(rule_of(R::defect_area_mm2, 3),
            [](JudgedCase& c) { c.facts.defects = {{"darker", {}, 2, 2}, {"duller", {}, 2, 2}}; }),
       bit(Reason::local_defect), "defect_area_mm2 is 6.283 mm2"},
      {"a tilted part is not judged",
       with(rule_of(R::tilt_deg, 0.5), [](JudgedCase& c) { c.facts.tilt_deg = {0.1, -0.7}; }),
       bit(Reason::tilt), "tilt_deg is 0.7 deg"},
      {"colour where none is known",
       with(rule_of(R::delta_e00, 5), [](JudgedCase& c) { c.clusters[0].valid.colour = false; }),
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
    std::function<void(JudgedCase&)> spoil;
    Rule rule;
    bool passes;
  };
  const auto colour = [](JudgedCase& c) { c.clusters[0].lab[2] = 14; };  // dE00 2.4
  const auto matt = [](JudgedCase& c) { c.clusters[1].gloss_gu[1] = 50; };
  const auto stain = [](JudgedCase& c) { c.facts.defects = {{"darker", {1, 2}, 0.5, 2}}; };
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
      {"area", [](JudgedCase& c) { c.clusters[1].area_share = 0.15; },
       tolerance_of(R::area_share, 0.06, 1), true},
      {"unknown cells", [](JudgedCase& c) { c.facts.unknown_share = 0.005; },
       rule_of(R::unknown_share, 0.01), true},
      {"tilt", [](JudgedCase& c) { c.facts.tilt_deg = {1.8, 0}; }, rule_of(R::tilt_deg, 2), true},
      {"defects of all kinds", stain, rule_of(R::defects, 1), true},
      {"defects' size", stain, rule_of(R::defect_size_mm, 1), true},
      {"defects of this kind", stain, darker, true},
      {"defects of another kind", stain, duller, false},
  };
  for (const Row& row : rows) {
    CAPTURE(row.what);
    JudgedCase c = good_case();
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
  using Spoil = std::function<void(JudgedCase&, double)>;
  const std::vector<std::pair<R, Spoil>> rows{
      {R::gloss_20_gu, [](JudgedCase& c, double v) { c.clusters[1].gloss_gu[0] = v; }},
      {R::gloss_60_gu, [](JudgedCase& c, double v) { c.clusters[1].gloss_gu[1] = v; }},
      {R::l_star, [](JudgedCase& c, double v) { c.clusters[0].lab[0] = v; }},
      {R::delta_e00, [](JudgedCase& c, double v) { c.clusters[0].lab[1] = v; }},
      {R::area_share, [](JudgedCase& c, double v) { c.clusters[1].area_share = v; }},
      {R::residual_rms, [](JudgedCase& c, double v) { c.clusters[0].raw.residual_rms = v; }},
      {R::unknown_share, [](JudgedCase& c, double v) { c.facts.unknown_share = v; }},
      {R::tilt_deg, [](JudgedCase& c, double v) { c.facts.tilt_deg[1] = v; }},
      {R::tilt_deg, [](JudgedCase& c, double v) { c.facts.tilt_sigma_deg[0] = v; }},
      {R::defect_size_mm,
       [](JudgedCase& c, double v) {
         c.facts.defects = {{"darker", {}, v, 2}, {"darker", {}, 1, 2}};
       }},
  };
  for (const auto& [reading, spoil] : rows) {
    for (const double value : {kNaN, kInf}) {
      CAPTURE(rule_reading_info(reading).name, value);
      JudgedCase c = good_case();
      c.recipe.rules.rules = {any(reading)};
      CHECK(c.judged().verdict == Verdict::pass);
      spoil(c, value);
      CHECK(c.judged().verdict == Verdict::not_judged);
    }
  }
}

TEST_CASE("A rule within the uncertainty of its reading is not judged", "[judge][rules]") {
  JudgedCase c = good_case();
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
  JudgedCase c = good_case();
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
  JudgedCase c = good_case();
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
  JudgedCase c = good_case();
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
