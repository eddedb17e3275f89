#include <Eigen/LU>
#include <cmath>

#include "catch.hpp"
#include "model/limits.hpp"
#include "model/teaching_checks.hpp"
#include "support/gaussian_parts.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

TEST_CASE("A part that the others would not pass is pointed out, a good one is not",
          "[teaching_checks]") {
  GaussianParts good(31);
  good.monitored = 1;
  auto parts = good.parts(20);
  const JudgeSettings settings;
  CHECK(outlying_parts(parts, teach_observed(parts, settings), settings).empty());
  parts[7].monitored[1] += 3;
  const auto found = outlying_parts(parts, teach_observed(parts, settings), settings);
  REQUIRE(found.size() == 1);
  CHECK(found[0].part == 7);
  CHECK(found[0].t2 > 100);
  CHECK(found[0].shift.name == "direction 2");
  CHECK(found[0].shift.change > 1);
  parts.resize(kLeastPartsToCompare - 1);
  CHECK(outlying_parts(parts, teach_observed(parts, settings), settings).empty());
}

/// Good parts whose three levels move together by 50 % and apart by 2 %; gloss and roughness
/// deviate as they like.
std::vector<ClusterObservation> pigmented(int n, std::uint64_t seed) {
  GaussianParts good(seed);
  std::vector<ClusterObservation> parts = good.parts(n);
  for (ClusterObservation& part : parts) {
    const double common = 0.5 * good.normal();
    part.levels = 3;
    part.monitored.resize(5);
    for (int c = 0; c < 3; ++c)
      part.monitored[c] = common + 0.02 * good.normal();
    part.monitored[3] = 2 * good.normal();
    part.monitored[4] = 0.3 * good.normal();
    part.monitored_noise.setZero(5, 5);
  }
  return parts;
}

TEST_CASE("Levels are taught as channels that move together", "[teaching_checks]") {
  const JudgeSettings settings;
  const double floor = settings.change_floor;
  const auto parts = pigmented(12, 41);
  Eigen::MatrixXd monitored(12, 5);
  for (Eigen::Index i = 0; i < 12; ++i)
    monitored.row(i) = parts[static_cast<std::size_t>(i)].monitored.transpose();
  const Eigen::MatrixXd s = shrunk_covariance(monitored, 3);
  const TaughtCluster taught = teach_observed(parts, settings);
  const Eigen::MatrixXd floored = s + floor * floor * Eigen::MatrixXd::Identity(5, 5);
  CHECK((taught.monitored_covariance - floored).norm() < 1e-12 * floored.norm());
  const double rate = split_rate(settings.false_reject_rate, 1).per_statistic;
  CHECK(taught.t2_limit == Approx(t2_limit(s, 12, floor, rate, 3)));
  CHECK(taught.t2_limit != Approx(t2_limit(s, 12, floor, rate, 0)).epsilon(0.01));
}

TEST_CASE("A good part of another colour is pointed out", "[teaching_checks]") {
  const JudgeSettings settings;
  auto parts = pigmented(12, 42);
  TaughtCluster taught = teach_observed(parts, settings);
  taught.directions.names = {"diffuse level R", "diffuse level G", "diffuse level B", "gloss level",
                             "roughness"};
  CHECK(outlying_parts(parts, taught, settings).empty());
  parts[5].monitored.head(3) += Eigen::Vector3d(0.2, -0.2, 0);
  const auto found = outlying_parts(parts, taught, settings);
  REQUIRE(found.size() == 1);
  CHECK(found[0].part == 5);
}

TEST_CASE("More parts of the same spread would reject smaller changes", "[teaching_checks]") {
  GaussianParts good(32);
  good.monitored = 1;
  const JudgeSettings settings;
  const TaughtCluster taught = teach_observed(good.parts(10), settings);
  const auto reach = reach_of(taught, settings, 1, 50);
  REQUIRE(reach.size() == 3);
  for (const Reach& r : reach) {
    CHECK(r.with_more < 0.9 * r.now);
    CHECK(r.with_more > 0);
  }
  // A part that far out along one direction alone is just at the limit.
  ClusterObservation seen = good.part();
  seen.monitored = taught.monitored_mean;
  seen.monitored_noise.setZero();
  const Eigen::Index i = 1;
  const Eigen::MatrixXd inverse = (taught.monitored_covariance * 1.1).inverse();
  seen.monitored[i] += std::sqrt(taught.t2_limit / inverse(i, i));
  CHECK(deviation(taught, seen).t2 == Approx(taught.t2_limit).epsilon(1e-6));
  CHECK(reach[1].now >= std::sqrt(taught.t2_limit / inverse(i, i)));
}
