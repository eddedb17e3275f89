#include <cmath>
#include <limits>
#include <random>

#include "catch.hpp"
#include "model/gauge_study.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;

namespace {

/// The worked example of AIAG, MSA 4th ed., chapter III B (its figure "Gage repeatability and
/// reproducibility data collection sheet"): ten parts, three appraisers, three trials.
constexpr double kAiag[3][3][10] = {
    {{0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36},
     {0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25},
     {0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31}},
    {{0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68},
     {0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62},
     {0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50}},
    {{0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49},
     {-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77},
     {-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16}}};

GrrInput aiag() {
  GrrInput input;
  for (int part = 0; part < 10; ++part) {
    Eigen::ArrayXXd values(3, 3);
    for (int o = 0; o < 3; ++o) {
      for (int t = 0; t < 3; ++t)
        values(o, t) = kAiag[o][t][part];
    }
    input.values.push_back(values);
  }
  return input;
}

/// A study drawn from known deviations.
GrrInput drawn(int parts, int operators, int trials, std::array<double, 4> sigma,
               std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Eigen::ArrayXd of_operator(operators);
  for (double& x : of_operator)
    x = sigma[1] * normal(random);
  GrrInput input;
  for (int p = 0; p < parts; ++p) {
    const double part = sigma[3] * normal(random);
    Eigen::ArrayXXd values(operators, trials);
    for (int o = 0; o < operators; ++o) {
      const double cell = part + of_operator[o] + sigma[2] * normal(random);
      for (int t = 0; t < trials; ++t)
        values(o, t) = cell + sigma[0] * normal(random);
    }
    input.values.push_back(values);
  }
  return input;
}

}  // namespace

TEST_CASE("The worked example of AIAG's manual comes out: average and range", "[gauge]") {
  const GrrResult r = grr_average_range(aiag());
  CHECK(r.ev == Approx(0.20188).margin(2e-5));
  CHECK(r.av == Approx(0.22963).margin(1e-4));  // its constants have four digits
  CHECK(r.grr == Approx(0.30575).margin(5e-5));
  CHECK(r.pv == Approx(1.10456).margin(2e-4));
  CHECK(r.tv == Approx(1.14610).margin(2e-4));
  CHECK(r.grr_share == Approx(0.2668).margin(1e-4));
  CHECK(r.ndc == Approx(5.094).margin(2e-3));
}

TEST_CASE("The worked example of AIAG's manual comes out: analysis of variance", "[gauge]") {
  GrrInput input = aiag();
  input.tolerance = 4;
  const GrrResult r = grr_anova(input);
  REQUIRE(r.table.size() == 5);
  CHECK(r.table[0].source == "operator");
  CHECK(r.table[0].dof == 2);
  CHECK(r.table[0].ss == Approx(3.1673).margin(1e-4));
  CHECK(r.table[1].dof == 9);
  CHECK(r.table[1].ss == Approx(88.3619).margin(1e-4));
  CHECK(r.table[2].dof == 18);
  CHECK(r.table[2].ss == Approx(0.3590).margin(1e-4));
  CHECK(r.table[2].f == Approx(0.434).margin(1e-3));
  CHECK(r.table[3].dof == 60);
  CHECK(r.table[3].ss == Approx(2.7589).margin(1e-4));
  CHECK(r.table[4].ss == Approx(94.6471).margin(1e-3));
  CHECK(r.interaction == 0);  // not significant: pooled
  CHECK(r.ev == Approx(0.199933).margin(2e-6));
  CHECK(r.av == Approx(0.226838).margin(2e-6));
  CHECK(r.grr == Approx(0.302373).margin(2e-6));
  CHECK(r.pv == Approx(1.042327).margin(2e-6));
  CHECK(r.grr_share == Approx(0.279).margin(1e-3));
  CHECK(r.ndc == Approx(4.861).margin(1e-3));
  CHECK(*r.tolerance_share == Approx(6 * 0.302373 / 4).margin(1e-5));
}

TEST_CASE("d2, d2* and the tail of F are those of the tables", "[gauge]") {
  // AIAG appendix C: d2 (last row) and d2* of one subgroup (first row).
  const std::vector<std::array<double, 3>> rows{{2, 1.12838, 1.41421}, {3, 1.69257, 1.91155},
                                                {4, 2.05875, 2.23887}, {5, 2.32593, 2.48124},
                                                {8, 2.84720, 2.96288}, {10, 3.07751, 3.17905}};
  for (const auto& row : rows) {
    const int n = static_cast<int>(row[0]);
    CAPTURE(n);
    CHECK(d2(n) == Approx(row[1]).margin(1e-5));
    CHECK(d2_star(n, 1) == Approx(row[2]).margin(1e-5));
    CHECK(d2_star(n, 1000000) == Approx(row[1]).margin(2e-5));
  }
  // Snedecor and Cochran: upper 5 % and 1 % points of F.
  CHECK(f_upper_tail(4.965, 1, 10) == Approx(0.05).margin(1e-4));
  CHECK(f_upper_tail(3.326, 5, 10) == Approx(0.05).margin(1e-4));
  CHECK(f_upper_tail(10.044, 1, 10) == Approx(0.01).margin(1e-5));
  CHECK(f_upper_tail(2.0, 1e9, 1e9) == Approx(0).margin(1e-9));
  CHECK(f_upper_tail(1.0, 7, 7) == Approx(0.5).margin(1e-12));
  CHECK(f_upper_tail(0, 3, 4) == 1);
}

TEST_CASE("Both methods find the deviations that a large study was drawn from", "[gauge]") {
  // Enough of everything that the estimates' own scatter is a few percent.
  const std::array<double, 4> sigma{0.5, 0.8, 0.6, 2.0};
  const GrrResult r = grr_anova(drawn(150, 60, 3, sigma, 7));
  CHECK(r.ev == Approx(0.5).epsilon(0.03));
  CHECK(r.av == Approx(0.8).epsilon(0.25));
  CHECK(r.interaction == Approx(0.6).epsilon(0.05));
  CHECK(r.pv == Approx(2.0).epsilon(0.15));
  const GrrResult range = grr_average_range(drawn(150, 60, 3, {0.5, 0.8, 0, 2.0}, 8));
  CHECK(range.ev == Approx(0.5).epsilon(0.03));
  CHECK(range.pv == Approx(2.0).epsilon(0.25));
}

TEST_CASE("One operator is a study of parts and repeatability", "[gauge]") {
  GrrInput input;
  for (const double part : {0.0, 10.0})
    input.values.push_back(Eigen::ArrayXXd::Constant(1, 2, part));
  input.values[0](0, 1) = 2;
  input.values[1](0, 1) = 12;
  // By hand: within SS = 2 + 2 over 2 dof, MS 2; between SS = 2 * (5^2 + 5^2) = 100 over 1.
  const GrrResult r = grr_anova(input);
  CHECK(r.ev == Approx(std::sqrt(2.0)));
  CHECK(r.av == 0);
  CHECK(r.pv == Approx(std::sqrt((100.0 - 2) / 2)));
  CHECK(r.ndc == Approx(1.41 * r.pv / r.ev));
  CHECK(r.table.size() == 3);
  CHECK_FALSE(r.tolerance_share);
  CHECK(grr_average_range(input).ev == Approx(2 / d2(2)));
  // Readings that never differ are perfect, not undefined.
  for (auto& part : input.values)
    part = part(0, 0);
  CHECK(std::isinf(grr_anova(input).ndc));
  CHECK(grr_anova(input).grr_share == 0);
}

TEST_CASE("A type 1 study is booklet 10's and VDA 5's", "[gauge]") {
  // Mean 10.02, s 0.02 by construction.
  Type1Input input{{10.00, 10.02, 10.04}, 2, 10.0, 0};
  const Type1Result r = type1_study(input);
  CHECK(r.count == 3);
  CHECK(r.mean == Approx(10.02));
  CHECK(r.s == Approx(0.02));
  CHECK(r.cg == Approx(0.2 * 2 / (6 * 0.02)));
  CHECK(*r.bias == Approx(0.02));
  CHECK(*r.cgk == Approx((0.1 * 2 - 0.02) / (3 * 0.02)));
  CHECK(*r.bias_t == Approx(std::sqrt(3.0)));
  CHECK(*r.q_ms == Approx(4 * std::sqrt(0.0004 + 0.0004 / 3) / 2));
  CHECK(r.capable());
  // At the least tolerance Cg is just 1.33.
  input.tolerance = r.least_tolerance;
  CHECK(type1_study(input).cg == Approx(1.33));
  // A bias of a tenth of the tolerance leaves nothing; more is negative.
  input.tolerance = 0.2;
  CHECK(*type1_study(input).cgk == Approx(0).margin(1e-9));
  input.reference = 9.0;
  CHECK(*type1_study(input).cgk < 0);
  CHECK_FALSE(type1_study(input).capable());
  input.reference.reset();
  const Type1Result repeat_only = type1_study(input);
  CHECK_FALSE(repeat_only.cgk);
  CHECK_FALSE(repeat_only.q_ms);
  input.values = {3, 3, 3};
  CHECK(std::isinf(type1_study(input).cg));
}

TEST_CASE("Studies that cannot be are refused by name", "[gauge]") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto type1 = [](std::vector<double> values, double tolerance) {
    return input_error([&] { return type1_study({std::move(values), tolerance, {}, 0}); });
  };
  CHECK(contains(type1({1}, 1), "1 value(s)"));
  CHECK(contains(type1({1, nan}, 1), "not finite"));
  CHECK(contains(type1({1, 2}, 0), "tolerance"));
  GrrInput input = aiag();
  input.values[3] = Eigen::ArrayXXd::Zero(3, 2);
  for (const auto& study : {&grr_anova, &grr_average_range}) {
    CHECK(
        contains(input_error([&] { return study(input); }), "part 4: 3 operator(s) with 2 trial"));
    GrrInput bad = aiag();
    bad.values[1](2, 2) = nan;
    CHECK(contains(input_error([&] { return study(bad); }), "part 2: a value that is not finite"));
    bad = aiag();
    bad.values.resize(1);
    CHECK(contains(input_error([&] { return study(bad); }), "1 part(s)"));
    bad = aiag();
    bad.tolerance = -1;
    CHECK(contains(input_error([&] { return study(bad); }), "tolerance"));
  }
  CHECK(contains(input_error([] { return d2(1); }), "2 to 200"));
}
