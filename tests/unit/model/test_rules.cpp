#include <limits>
#include <set>
#include <string>

#include "catch.hpp"
#include "model/appearance.hpp"
#include "model/rule_values.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using brdfgate::test::contains;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

Rule between(double low, double high) {
  Rule rule;
  rule.reading = RuleReading::l_star;
  rule.low = low;
  rule.high = high;
  return rule;
}

RuleValue value_of(double value, std::optional<double> sigma = {}) {
  RuleValue seen;
  seen.value = value;
  seen.sigma = sigma;
  return seen;
}

}  // namespace

TEST_CASE("A rule passes, rejects or does not judge by the guard band", "[rules]") {
  struct Row {
    const char* what;
    double low, high, value;
    std::optional<double> sigma;
    double guard;
    Verdict verdict;
    const char* text;
  };
  const Row rows[] = {
      {"inside", 10, 20, 15, 1.0, 2, Verdict::pass, ""},
      {"on the guard band's edge", 10, 20, 18, 1.0, 2, Verdict::pass, ""},
      {"in the guard band, inside", 10, 20, 18.5, 1.0, 2, Verdict::not_judged,
       "l_star is 18.5 L* (sigma 1), within its limit 20 L* by 1.5 L*: too near to tell, its guard "
       "band of 2 sigmas spans 16.5 to 20.5 L*"},
      {"in the guard band, outside", 10, 20, 21.5, 1.0, 2, Verdict::not_judged,
       "beyond its limit 20 L* by 1.5 L*"},
      {"beyond it", 10, 20, 22.5, 1.0, 2, Verdict::reject,
       "l_star is 22.5 L* (sigma 1), over its limit 20 L* by 2.5 L*"},
      {"below", 10, 20, 7.5, 1.0, 2, Verdict::reject, "under its limit 10 L* by 2.5 L*"},
      {"below, in the band", 10, 20, 8.5, 1.0, 2, Verdict::not_judged, "its limit 10 L*"},
      {"no guard", 10, 20, 20, 1.0, 0, Verdict::pass, ""},
      {"no guard, just beyond", 10, 20, 20.001, 1.0, 0, Verdict::reject, "over its limit"},
      {"no sigma is known: as it is", 10, 20, 20, {}, 2, Verdict::pass, ""},
      {"no sigma is known, beyond", 10, 20, 20.5, {}, 2, Verdict::reject, "over its limit"},
      {"limits too near for the uncertainty", 10, 12, 11, 1.0, 2, Verdict::not_judged,
       "wider than its limits are apart"},
      {"one-sided", -kInf, 20, -3, 1.0, 2, Verdict::pass, ""},
      {"one-sided below", 10, kInf, 1e6, 1.0, 2, Verdict::pass, ""},
      {"not a number", -kInf, 20, kNaN, 1.0, 2, Verdict::not_judged, "is not known"},
      {"infinite", 10, kInf, kInf, 1.0, 2, Verdict::not_judged, "is not known"},
      {"a sigma that is none", 10, 20, 15, kNaN, 2, Verdict::not_judged, "is not known"},
      {"an infinite sigma", 10, 20, 15, kInf, 2, Verdict::not_judged, "is not known"},
      {"a sigma below 0", 10, 20, 15, -1.0, 2, Verdict::not_judged, "is not known"},
      {"a sigma that is none, not asked for", 10, 20, 15, kNaN, 0, Verdict::pass, ""},
  };
  for (const Row& row : rows) {
    Rule rule = between(row.low, row.high);
    rule.guard = row.guard;
    const RuleOutcome out = judge_rule(rule, 99, value_of(row.value, row.sigma), "here: ");
    CAPTURE(row.what, out.text);
    CHECK(out.verdict == row.verdict);
    CHECK(contains(out.text, row.text));
    CHECK(out.text.empty() == (out.verdict == Verdict::pass));
    if (!out.text.empty()) CHECK(out.text.rfind("here: ", 0) == 0);
    if (out.verdict != Verdict::pass) CHECK(verdict_of(bit(out.reason)) == out.verdict);
  }
}

TEST_CASE("Gloss errs by factors, and so does its guard band", "[rules]") {
  Rule rule = between(0, 120);
  rule.reading = RuleReading::gloss_85_gu;
  // 50 GU, +-77 %: with 1.65 sigmas 14 to 178 GU, where additively it would be 113.5 at most.
  const RuleOutcome out = judge_rule(rule, 1.65, value_of(50, 38.5), "");
  CHECK(out.verdict == Verdict::not_judged);
  CHECK(contains(out.text, "spans 14.03 to 178.1 GU"));
  rule.high = 179;
  CHECK(judge_rule(rule, 1.65, value_of(50, 38.5), "").verdict == Verdict::pass);
  rule.high = 14;
  CHECK(judge_rule(rule, 1.65, value_of(50, 38.5), "").verdict == Verdict::reject);
  rule.high = 15;
  CHECK(judge_rule(rule, 1.65, value_of(50, 38.5), "").verdict == Verdict::not_judged);
  rule.low = -kInf;
  CHECK(judge_rule(rule, 1.65, value_of(0, 1.0), "").verdict == Verdict::pass);
}

TEST_CASE("The set's guard holds where a rule has none of its own", "[rules]") {
  const RuleValue seen = value_of(18.5, 1.0);
  CHECK(judge_rule(between(10, 20), 1, seen, "").verdict == Verdict::pass);
  CHECK(judge_rule(between(10, 20), 2, seen, "").verdict == Verdict::not_judged);
  CHECK(RuleSet().guard == 1.65);
}

TEST_CASE("A tolerance is around the taught value, with the uncertainty of the change", "[rules]") {
  Rule rule;
  rule.reading = RuleReading::gloss_60_gu;
  rule.tolerance = 5;
  RuleValue seen = value_of(66, 10.0);
  seen.taught = 60;
  // The value's own uncertainty counts unless that of the change is known.
  CHECK(judge_rule(rule, 1, seen, "").verdict == Verdict::not_judged);
  seen.change_sigma = 0.5;
  CHECK(judge_rule(rule, 1, seen, "").verdict == Verdict::reject);
  // A change that is better known than the value.
  seen.change = 3;
  const RuleOutcome out = judge_rule(rule, 1, seen, "");
  CHECK(out.verdict == Verdict::pass);
  CHECK(out.value == 63);
  CHECK(out.low == 55);
  CHECK(out.high == 65);
  CHECK(out.sigma == 0.5);
  // An absolute limit takes the value as it is.
  CHECK(judge_rule(between(0, 65.5), 0, seen, "").verdict == Verdict::reject);
  seen.taught = kNaN;
  CHECK(judge_rule(rule, 1, seen, "").verdict == Verdict::not_judged);
}

TEST_CASE("What a rule demands measured is not judged where it is extrapolated", "[rules]") {
  Rule rule = between(10, 20);
  RuleValue seen = value_of(15);
  seen.measured = false;
  CHECK(judge_rule(rule, 1, seen, "").verdict == Verdict::pass);
  rule.measured = true;
  const RuleOutcome out = judge_rule(rule, 1, seen, "");
  CHECK(out.verdict == Verdict::not_judged);
  CHECK(out.reason == Reason::coverage);
  CHECK(contains(out.text, "extrapolated by the basis"));
  seen.measured = true;
  CHECK(judge_rule(rule, 1, seen, "").verdict == Verdict::pass);
  // Nor is it rejected on an extrapolated value.
  seen.measured = false;
  seen.value = 50;
  CHECK(judge_rule(rule, 1, seen, "").verdict == Verdict::not_judged);
}

TEST_CASE("Every reading has a name of its own, a range and a reason", "[rules]") {
  std::set<std::string> names;
  REQUIRE(rule_reading_names().size() == std::size_t(kRuleReadings));
  for (int i = 0; i < kRuleReadings; ++i) {
    const RuleReadingInfo& info = rule_reading_info(static_cast<RuleReading>(i));
    CHECK(names.insert(info.name).second);
    CHECK(info.least < info.most);
    CHECK_FALSE((info.of_part && info.relative));
  }
  const auto name = [](RuleReading r) { return rule_reading_info(r).name; };
  CHECK(name(RuleReading::aspecular_15_l_star) == "aspecular_15_l_star");
  CHECK(name(RuleReading::aspecular_110_b_star) == "aspecular_110_b_star");
  CHECK(name(RuleReading::flop_index) == "flop_index");
  CHECK(name(RuleReading::tilt_deg) == "tilt_deg");
  CHECK(rule_reading_info(RuleReading::tilt_deg).reason == Reason::tilt);
}

TEST_CASE("What can be measured is told from the bins of the taught parts", "[rules]") {
  TaughtCluster taught;
  taught.parts = 10;
  const auto bin = [&](int light, double theta_h, double theta_d) {
    BinFrame& frame = taught.directions.frame;
    frame.id.push_back(int(frame.id.size()));
    frame.light.push_back(light);
    frame.directions.push_back({theta_h, theta_d, EIGEN_PI / 2});
  };
  CHECK(can_be_measured(RuleReading::gloss_60_gu, taught));  // nothing is known
  bin(2, 0.01, 1.05);
  CHECK_FALSE(can_be_measured(RuleReading::gloss_60_gu, taught));
  bin(1, 0.01, 0.96);  // 55 degrees
  CHECK(can_be_measured(RuleReading::gloss_60_gu, taught));
  CHECK_FALSE(can_be_measured(RuleReading::gloss_20_gu, taught));
  CHECK_FALSE(can_be_measured(RuleReading::gloss_85_gu, taught));
  CHECK_FALSE(can_be_measured(RuleReading::haze_gu, taught));
  CHECK_FALSE(can_be_measured(RuleReading::l_star, taught));
  CHECK_FALSE(can_be_measured(RuleReading::flop_index, taught));
  CHECK_FALSE(can_be_measured(RuleReading::delta_e00, taught));
  taught.directions.names = {level_name(0, 3), level_name(1, 3), level_name(2, 3)};
  CHECK(can_be_measured(RuleReading::delta_e00, taught));
  CHECK(can_be_measured(RuleReading::area_share, taught));
  const HalfDiff at = to_half_diff(aspecular_directions(45));
  taught.directions.frame.directions[0] = at;
  CHECK(can_be_measured(RuleReading::l_star, taught));
  const int asp45 = static_cast<int>(RuleReading::aspecular_15_l_star) + 6;
  CHECK(rule_reading_info(static_cast<RuleReading>(asp45)).name == "aspecular_45_l_star");
  CHECK(can_be_measured(static_cast<RuleReading>(asp45), taught));
  CHECK_FALSE(can_be_measured(RuleReading::aspecular_15_l_star, taught));
}
