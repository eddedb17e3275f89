#include <Eigen/LU>
#include <cmath>

#include "catch.hpp"
#include "model/teaching_checks.hpp"
#include "support/gaussian_parts.hpp"

using namespace brdfgate;
using brdfgate::test::GaussianParts;

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
