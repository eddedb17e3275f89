// A good part and its recipe, to be spoilt one thing at a time and judged.
#pragma once

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "catch.hpp"
#include "model/judge.hpp"
#include "support/gaussian_parts.hpp"
#include "support/input_error.hpp"

namespace brdfgate::test {

inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
inline constexpr double kInf = std::numeric_limits<double>::infinity();

/// A two-cluster recipe and a good part of its kind, to be spoilt one thing at a time.
struct JudgedCase {
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

inline JudgedCase good_case() {
  static const JudgedCase made = [] {
    JudgedCase c;
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

struct SpoiltRow {
  const char* what;
  std::function<void(JudgedCase&)> spoil;
  ReasonBits bits;
  const char* text;
};

inline void check_rows(const std::vector<SpoiltRow>& rows) {
  for (const SpoiltRow& row : rows) {
    JudgedCase c = good_case();
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

}  // namespace brdfgate::test
