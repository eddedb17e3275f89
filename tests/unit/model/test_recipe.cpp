#include <cmath>
#include <limits>

#include "catch.hpp"
#include "model/limits.hpp"
#include "model/recipe.hpp"
#include "model/verdict.hpp"
#include "support/gaussian_parts.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::GaussianParts;
using brdfgate::test::input_error;

namespace {

struct Rejects {
  double t2 = 0, spe = 0;
};

/// Share of good parts beyond the limits, over several recipes of N parts each.
Rejects false_rejects(int parts, double rate) {
  constexpr int kRecipes = 8, kFresh = 400;
  JudgeSettings settings;
  settings.false_reject_rate = rate / split_rate(1, 1).per_statistic;
  Rejects rejects;
  for (int recipe = 0; recipe < kRecipes; ++recipe) {
    GaussianParts good(static_cast<std::uint64_t>(1000 * parts + recipe));
    good.monitored = 2;
    good.bins = 16;
    const TaughtCluster taught = teach_observed(good.parts(parts), settings);
    for (int i = 0; i < kFresh; ++i) {
      const Deviation d = deviation(taught, good.part());
      rejects.t2 += d.t2 > d.t2_limit ? 1.0 / (kRecipes * kFresh) : 0;
      rejects.spe += d.spe > d.spe_limit ? 1.0 / (kRecipes * kFresh) : 0;
    }
  }
  return rejects;
}

}  // namespace

TEST_CASE("At the 1 % setting about 1 % of good parts are rejected, taught from 10, 25 or 50",
          "[recipe]") {
  for (const int parts : {10, 25, 50}) {
    const Rejects rejects = false_rejects(parts, 0.01);
    CAPTURE(parts, rejects.t2, rejects.spe);
    CHECK(rejects.t2 > 0.002);
    CHECK(rejects.t2 < 0.03);
    CHECK(rejects.spe > 0.002);
    CHECK(rejects.spe < 0.03);
  }
}

TEST_CASE("A taught cluster holds the parts' means, and never less spread than the floors",
          "[recipe]") {
  GaussianParts good(5);
  const auto parts = good.parts(12);
  JudgeSettings settings;
  const TaughtCluster taught = teach_observed(parts, settings);
  Eigen::MatrixXd mean = Eigen::MatrixXd::Zero(5, 3);
  for (const ClusterObservation& part : parts)
    mean += part.weights / 12;
  CHECK(taught.parts == 12);
  CHECK((taught.mean - mean).norm() < 1e-12);
  CHECK((taught.monitored_mean - leading_weights(mean, 3)).norm() < 1e-12);
  CHECK(taught.monitored_mean[4] == Approx(mean(1, 1)));  // channel by channel
  CHECK(taught.bin_id.size() == 40);
  CHECK(taught.bin_residual.rows() == 40);
  CHECK(taught.bin_residual_sigma.minCoeff() >= 0.004);
  const double floor = settings.change_floor;
  CHECK(taught.monitored_covariance.diagonal().minCoeff() >= floor * floor);

  good.weight_deviation = 0;
  good.pattern_deviation = good.bin_deviation = 0;
  const TaughtCluster still = teach_observed(good.parts(12), settings);
  CHECK((still.monitored_covariance - floor * floor * Eigen::MatrixXd::Identity(9, 9)).norm() <
        1e-12);
  CHECK(still.bin_residual_sigma.maxCoeff() == Approx(0.004));
  CHECK(still.spe_limit == kLeastSpeLimit);
}

TEST_CASE("One or two parts teach a prior spread and the known noise alone", "[recipe]") {
  JudgeSettings settings;
  settings.false_reject_rate = 0.01 / split_rate(1, 1).per_statistic;
  for (const int n : {1, 2}) {
    GaussianParts good(9);
    good.noise_deviation = 0.03;
    const TaughtCluster taught = teach_observed(good.parts(n), settings);
    CAPTURE(n);
    CHECK((taught.monitored_covariance -
           (0.002 * 0.002 + 0.03 * 0.03 + 0.03 * 0.03) * Eigen::MatrixXd::Identity(9, 9))
              .norm() < 1e-12);
    CHECK(taught.bin_residual_sigma.maxCoeff() == Approx(std::hypot(0.02, 0.03)));
    CHECK(taught.t2_limit == Approx(21.67).epsilon(0.06));
    CHECK(taught.spe_limit == kSpeLimitOfFew);
  }
}

TEST_CASE("Bins that fewer than half of the parts saw are not taught", "[recipe]") {
  GaussianParts good(6);
  auto parts = good.parts(8);
  for (std::size_t i = 0; i < 5; ++i) {  // bin 49 seen by three of eight
    parts[i].bin_id.pop_back();
    parts[i].angles.pop_back();
    parts[i].residual.conservativeResize(39, Eigen::NoChange);
    parts[i].residual_noise.conservativeResize(39, Eigen::NoChange);
  }
  const TaughtCluster taught = teach_observed(parts, {});
  CHECK(taught.bin_id.size() == 39);
  CHECK(taught.bin_id.back() == 48);
  // The order in which a part lists its bins does not matter.
  auto turned = parts;
  for (ClusterObservation& part : turned) {
    std::reverse(part.bin_id.begin(), part.bin_id.end());
    part.residual = part.residual.colwise().reverse().eval();
    part.residual_noise = part.residual_noise.colwise().reverse().eval();
  }
  const TaughtCluster again = teach_observed(turned, {});
  CHECK(again.bin_id == taught.bin_id);
  CHECK((again.bin_residual - taught.bin_residual).norm() < 1e-12);
  CHECK(again.spe_limit == Approx(taught.spe_limit).epsilon(1e-9));
}

TEST_CASE("Teaching refuses parts that do not fit together and settings that mean nothing",
          "[recipe]") {
  GaussianParts good(7);
  const auto parts = good.parts(3);
  const auto teach = [](std::vector<ClusterObservation> p, JudgeSettings s = {}) {
    return input_error([&] { return teach_observed(p, s); });
  };
  CHECK(contains(teach({}), "no parts"));
  auto other = parts;
  other[1].weights.conservativeResize(4, 3);
  CHECK(contains(teach(other), "part 2: 4 components"));
  other = parts;
  other[2].residual(3, 1) = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(teach(other), "part 3: holds a number that is not finite"));
  other = parts;
  other[0].bin_id.clear();
  CHECK(contains(teach(other), "0 bins"));
  JudgeSettings bad;
  bad.false_reject_rate = 0;
  CHECK(contains(teach(parts, bad), "false_reject_rate"));
  bad = {};
  bad.change_floor = std::numeric_limits<double>::infinity();
  CHECK(contains(teach(parts, bad), "change_floor"));
}
