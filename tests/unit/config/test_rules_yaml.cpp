#include <string>

#include "catch.hpp"
#include "config/rules_yaml.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

/// Body and print; light 1's highlight was seen at 55 degrees on the body alone.
std::vector<TaughtCluster> two_clusters() {
  std::vector<TaughtCluster> clusters(2);
  const char* names[] = {"body", "print"};
  for (std::size_t i = 0; i < 2; ++i) {
    TaughtCluster& c = clusters[i];
    c.name = names[i];
    c.parts = 10;
    c.gloss_gu = {30, 60, 80};
    c.lab = {50, 20, 10};
    c.area_share = i == 0 ? 0.8 : 0.2;
    c.directions.frame = {{7}, {i == 0 ? 1 : 2}, {{0.01, 0.96, 1.5}}};
  }
  return clusters;
}

RuleSet read(const std::string& rules) {
  static const std::vector<TaughtCluster> clusters = two_clusters();
  return read_rule_set(YamlNode::load_text(rules, "r.yaml"), &clusters);
}

std::string with(const std::string& rule) {
  return "rules:\n  - {" + rule + "}\n";
}

}  // namespace

TEST_CASE("Rules are read with their defaults", "[rules_yaml]") {
  const RuleSet set = read(
      "guard: 2\n"
      "rules:\n"
      "  - {reading: gloss_60_gu, cluster: body, tolerance: 5, unit: GU, measured: true}\n"
      "  - {reading: delta_e00, high: 1}\n"
      "  - {reading: area_share, cluster: 1, low: 0.15, high: 0.25, guard: 0}\n"
      "  - {reading: l_star, cluster: all, low: 40}\n"
      "  - {reading: defects, kind: darker, high: 2}\n");
  CHECK(set.guard == 2);
  REQUIRE(set.rules.size() == 5);
  const Rule& gloss = set.rules[0];
  CHECK(gloss.reading == RuleReading::gloss_60_gu);
  CHECK(gloss.cluster == 0);
  CHECK(gloss.tolerance == 5.0);
  CHECK(gloss.measured);
  CHECK_FALSE(gloss.guard);
  CHECK(set.rules[1].cluster == kEveryCluster);
  CHECK(set.rules[1].high == 1);
  CHECK(std::isinf(set.rules[1].low));
  CHECK_FALSE(set.rules[1].measured);
  CHECK(set.rules[2].cluster == 1);
  CHECK(set.rules[2].guard == 0.0);
  CHECK(set.rules[3].cluster == kEveryCluster);
  CHECK(set.rules[4].kind == "darker");
  CHECK(read("rules: []\n").rules.empty());
  CHECK(read("rules: []\n").guard == kDefaultGuard);
}

TEST_CASE("Rules come back from YAML as they were", "[rules_yaml]") {
  const std::vector<TaughtCluster> clusters = two_clusters();
  for (const char* rules :
       {"reading: gloss_60_gu, cluster: print, tolerance: 5.125, guard: 3",
        "reading: aspecular_15_l_star, low: 0.1, high: 70.5", "reading: tilt_deg, high: 1",
        "reading: defect_size_mm, kind: colour, high: 1.5",
        "reading: gloss_60_gu, cluster: body, low: 50, measured: true"}) {
    const RuleSet set = read("guard: 1.9\n" + with(rules));
    YAML::Emitter out;
    write_rule_set(out, set, clusters);
    const RuleSet again = read(out.c_str());
    CAPTURE(rules, out.c_str());
    CHECK(again.guard == set.guard);
    REQUIRE(again.rules.size() == 1);
    const Rule &a = set.rules[0], &b = again.rules[0];
    CHECK(a.reading == b.reading);
    CHECK(a.cluster == b.cluster);
    CHECK(a.kind == b.kind);
    CHECK(a.low == b.low);
    CHECK(a.high == b.high);
    CHECK(a.tolerance == b.tolerance);
    CHECK(a.guard == b.guard);
    CHECK(a.measured == b.measured);
  }
}

TEST_CASE("Rules that cannot be meant are refused where they stand", "[rules_yaml]") {
  struct Row {
    const char* rules;
    const char* place;  ///< line:column (path)
    const char* complaint;
  };
  const Row rows[] = {
      {"reading: glos_60_gu, high: 1", "r.yaml:2:15 (rules[0].reading)", "did you mean"},
      {"reading: gloss, high: 1", "r.yaml:2:15", "expected one of"},
      {"high: 1", "(rules[0].reading)", "missing"},
      {"reading: delta_e00", "r.yaml:2:5 (rules[0])", "no limit; expected low, high or both"},
      {"reading: l_star", "r.yaml:2:5", "or tolerance"},
      {"reading: l_star, low: 60, high: 50", "r.yaml:2:28 (rules[0].low)",
       "60 is over high: 50; expected low <= high"},
      {"reading: area_share, low: 20", "r.yaml:2:32 (rules[0].low)",
       "'20'; expected 0..1, a share: 20 % is 0.2"},
      {"reading: gloss_60_gu, high: 1e9", "(rules[0].high)", "expected 0..2000 GU"},
      {"reading: gloss_60_gu, high: .nan", "(rules[0].high)", "number"},
      {"reading: gloss_60_gu, high: bright", "(rules[0].high)", "number"},
      {"reading: gloss_60_gu, tolerance: -5", "r.yaml:2:39 (rules[0].tolerance)",
       "-5 is out of range"},
      {"reading: gloss_60_gu, tolerance: 5, high: 70", "(rules[0].tolerance)",
       "beside low or high"},
      {"reading: delta_e00, tolerance: 1", "(rules[0].tolerance)", "has no taught value"},
      {"reading: defects, tolerance: 1", "(rules[0].tolerance)", "has no taught value"},
      {"reading: l_star, cluster: lid, high: 1", "r.yaml:2:32 (rules[0].cluster)",
       "no cluster 'lid'; expected one of all, 'body' (0), 'print' (1)"},
      {"reading: l_star, cluster: 2, high: 1", "(rules[0].cluster)", "no cluster '2'"},
      {"reading: l_star, cluster: -1, high: 1", "(rules[0].cluster)", "no cluster '-1'"},
      {"reading: tilt_deg, cluster: body, high: 1", "(rules[0].cluster)", "is of the part"},
      {"reading: l_star, kind: darker, high: 1", "(rules[0].kind)", "has no kinds"},
      {"reading: defects, kind: drker, high: 1", "(rules[0].kind)", "did you mean 'darker'"},
      {"reading: gloss_60_gu, high: 1, unit: '%'", "(rules[0].unit)", "expected GU"},
      {"reading: defect_size_mm, high: 1, unit: um", "(rules[0].unit)", "expected mm"},
      {"reading: l_star, high: 60, guard: -1", "(rules[0].guard)", "-1 is out of range"},
      {"reading: l_star, high: 60, guard: 11", "(rules[0].guard)", "0..10"},
      {"reading: l_star, high: 60, measured: often", "(rules[0].measured)", "true or false"},
      {"reading: l_star, hihg: 60", "(rules[0]", "expected"},
      {"reading: l_star, high: 60, hi: 3", "(rules[0].hi)", "unknown key"},
      {"reading: gloss_20_gu, high: 60, measured: true", "r.yaml:2:48 (rules[0].measured)",
       "this rig does not look where gloss_20_gu of cluster 'body' is told from"},
      {"reading: gloss_60_gu, high: 60, measured: true", "(rules[0].measured)",
       "of cluster 'print'"},
      {"reading: haze_gu, high: 10", "r.yaml:2:15 (rules[0].reading)",
       "cluster 'body': haze is defined for over 70 GU at 60 degrees (ASTM D4039), taught 60 GU"},
  };
  for (const Row& row : rows) {
    const std::string error = input_error([&] { return read(with(row.rules)); });
    CAPTURE(row.rules, error);
    CHECK(contains(error, "r.yaml:"));
    CHECK(contains(error, row.place));
    CHECK(contains(error, row.complaint));
  }
  CHECK(contains(input_error([] { return read("rules: 3\n"); }), "r.yaml:1:8 (rules)"));
  CHECK(
      contains(input_error([] { return read("guard: two\nrules: []\n"); }), "r.yaml:1:8 (guard)"));
  CHECK(contains(input_error([] { return read("gard: 2\nrules: []\n"); }), "did you mean 'guard'"));
}

TEST_CASE("Rules that no value meets together are refused at the later one", "[rules_yaml]") {
  struct Row {
    const char* first;
    const char* second;
    bool contradict;
  };
  const Row rows[] = {
      {"reading: l_star, high: 40", "reading: l_star, low: 50", true},
      {"reading: l_star, high: 40", "reading: l_star, low: 40", false},
      {"reading: l_star, high: 40", "reading: a_star, low: 50", false},
      {"reading: l_star, cluster: 0, high: 40", "reading: l_star, cluster: print, low: 50", false},
      {"reading: l_star, high: 40", "reading: l_star, cluster: print, low: 50", true},
      // taught 60 +- 5
      {"reading: gloss_60_gu, tolerance: 5", "reading: gloss_60_gu, low: 66", true},
      {"reading: gloss_60_gu, tolerance: 5", "reading: gloss_60_gu, low: 64", false},
      {"reading: gloss_60_gu, tolerance: 5", "reading: gloss_60_gu, tolerance: 1", false},
      {"reading: tilt_deg, high: 1", "reading: tilt_deg, low: 2", true},
      {"reading: defects, kind: darker, high: 1", "reading: defects, kind: duller, low: 2", false},
      {"reading: defects, kind: darker, high: 1", "reading: defects, kind: darker, low: 2", true},
  };
  for (const Row& row : rows) {
    const std::string text =
        "rules:\n  - {" + std::string(row.first) + "}\n  - {" + row.second + "}\n";
    const std::string error = input_error([&] { return read(text); });
    CAPTURE(text, error);
    CHECK(contains(error, "r.yaml:3:5 (rules[1])") == row.contradict);
    CHECK(contains(error, "contradicts the rule at r.yaml:2:5 (rules[0])") == row.contradict);
    CHECK((error == "(no error)") == !row.contradict);
  }
}

TEST_CASE("Before teaching, what depends on the clusters is left unchecked", "[rules_yaml]") {
  const TempDir dir;
  const auto file =
      dir.write("rules.yaml",
                "schema: brdfgate.rules/1\nrules:\n"
                "  - {reading: gloss_20_gu, cluster: lid, high: 60, measured: true}\n");
  CHECK(read_rules_file(file, nullptr).rules.size() == 1);
  const std::vector<TaughtCluster> clusters = two_clusters();
  CHECK(contains(input_error([&] { return read_rules_file(file, &clusters); }),
                 "rules.yaml:3:37 (rules[0].cluster): no cluster 'lid'"));
  // A draft has names; its taught values and bins come later.
  std::vector<TaughtCluster> draft(1);
  draft[0].name = "lid";
  CHECK(read_rules_file(file, &draft).rules[0].cluster == 0);
  const auto other = dir.write("other.yaml", "schema: brdfgate.recipe/2\nrules: []\n");
  CHECK(contains(input_error([&] { return read_rules_file(other, nullptr); }),
                 "other.yaml:1:9 (schema)"));
}
