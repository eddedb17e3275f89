#include <Eigen/LU>
#include <cmath>

#include "catch.hpp"
#include "model/verdict.hpp"
#include "support/gaussian_parts.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using brdfgate::test::GaussianParts;

TEST_CASE("Not judged outweighs reject outweighs pass, bit by bit", "[verdict]") {
  CHECK(verdict_of(0) == Verdict::pass);
  for (int i = 0; i < 16; ++i) {
    const auto one = static_cast<ReasonBits>(1u << i);
    CAPTURE(i);
    CHECK(verdict_of(one) == (i < 7 ? Verdict::reject : Verdict::not_judged));
    CHECK(verdict_of(one | bit(Reason::t2)) == (i < 7 ? Verdict::reject : Verdict::not_judged));
    CHECK(verdict_of(one | bit(Reason::ambient)) == Verdict::not_judged);
  }
  CHECK((kRejectBits | kNotJudgedBits) == 0xFFFF);
  CHECK((kRejectBits & kNotJudgedBits) == 0);
  CHECK(bit(Reason::t2) == 1);
  CHECK(bit(Reason::calibration_or_recipe) == 0x8000);
}

namespace {

TaughtCluster two_weights() {
  TaughtCluster taught;
  taught.parts = 4;
  taught.directions.names = {"gloss level", "roughness"};
  taught.monitored_mean = Eigen::Vector2d(1, 2);
  taught.monitored_covariance = Eigen::Vector2d(0.16, 0.04).asDiagonal();
  taught.t2_limit = 10;
  taught.bin_id = {3, 5, 8};
  taught.bin_residual = Eigen::Vector3d(0.1, 0.2, 0.3);
  taught.bin_residual_sigma = Eigen::Vector3d(0.2, 0.2, 0.4);
  taught.spe_limit = 2;
  return taught;
}

ClusterObservation two_seen() {
  ClusterObservation seen;
  seen.monitored = Eigen::Vector2d(1.3, 1.0);
  seen.monitored_noise = Eigen::Vector2d(0.05, 0.2).asDiagonal();
  seen.bin_id = {8, 4, 3};
  seen.angles = {{0.3, 0, 0}, {0.2, 0, 0}, {0.1, 0, 0}};
  seen.residual = Eigen::Vector3d(1.3, 99, 0.4);
  seen.residual_noise = Eigen::Vector3d(0.3, 0, 0.1);
  return seen;
}

}  // namespace

TEST_CASE("T^2 and SPE are what their formulas say, worked by hand", "[verdict]") {
  const Deviation d = deviation(two_weights(), two_seen());
  // S = 1.25 S_taught + S_measured = diag(0.25, 0.25); d = (0.3, -1).
  CHECK(d.t2 == Approx(0.09 / 0.25 + 1 / 0.25));
  CHECK(d.t2_limit == 10);
  // Bins 8 and 3 are taught, bin 4 is not: 1^2 / (1.25 * 0.16 + 0.3), 0.3^2 / (1.25 * 0.04 + 0.1).
  CHECK(d.spe == Approx((1 / 0.5 + 0.09 / 0.15) / 2));
  CHECK(d.spe_limit == 2);
  const MonitoredShift shift = largest_shift(two_weights(), two_seen());
  CHECK(shift.name == "roughness");
  CHECK(shift.change == Approx(std::exp(-1.0) - 1));
  CHECK(shift.sigmas == Approx(-2));
  const ResidualShift residual = largest_residual(two_weights(), two_seen());
  CHECK(residual.angles.theta_h == 0.3);
  CHECK(residual.sigmas == Approx(1 / std::sqrt(0.5)));
}

TEST_CASE("A part's colour is the taught one, changed as its diffuse levels are", "[verdict]") {
  TaughtCluster taught;
  const Eigen::Array3d rgb(0.4, 0.2, 0.1);
  taught.lab = linear_srgb_to_lab(rgb);
  taught.directions.names = {"diffuse level R", "diffuse level G", "diffuse level B", "roughness"};
  taught.monitored_mean = Eigen::Vector4d(0.01, 0, 0, 0);
  ClusterObservation seen;
  seen.monitored = Eigen::Vector4d(0.01 + std::log(1.1), std::log(0.9), 0, 5);
  const auto colour = compared_colour(taught, seen);
  REQUIRE(colour.has_value());
  const Lab expected = linear_srgb_to_lab(rgb * Eigen::Array3d(1.1, 0.9, 1));
  CHECK((*colour - expected).abs().maxCoeff() < 1e-6);
  taught.directions.names.erase(taught.directions.names.begin());
  CHECK_FALSE(compared_colour(taught, seen).has_value());
}

TEST_CASE("T^2 does not depend on the units of the weights", "[verdict]") {
  GaussianParts good(11);
  const TaughtCluster taught = teach_observed(good.parts(8), {});
  const ClusterObservation seen = good.part();
  const Eigen::MatrixXd mix = Eigen::MatrixXd::Random(9, 9) + 4 * Eigen::MatrixXd::Identity(9, 9);
  TaughtCluster mixed = taught;
  mixed.monitored_mean = mix * taught.monitored_mean;
  mixed.monitored_covariance = mix * taught.monitored_covariance * mix.transpose();
  ClusterObservation mixed_seen = seen;
  mixed_seen.monitored = mix * seen.monitored;
  mixed_seen.monitored_noise = mix * seen.monitored_noise * mix.transpose();
  CHECK(deviation(mixed, mixed_seen).t2 == Approx(deviation(taught, seen).t2).epsilon(1e-8));
}

TEST_CASE("Noise of the measurement makes both statistics milder, never stricter", "[verdict]") {
  GaussianParts good(12);
  const TaughtCluster taught = teach_observed(good.parts(8), {});
  ClusterObservation seen = good.part();
  const Deviation clean = deviation(taught, seen);
  seen.monitored_noise.diagonal().array() += 0.01;
  seen.residual_noise.array() += 0.01;
  const Deviation noisy = deviation(taught, seen);
  CHECK(noisy.t2 < clean.t2);
  CHECK(noisy.spe < clean.spe);
}

TEST_CASE("A draft without limits deviates by nothing, an unseen one by NaN", "[verdict]") {
  TaughtCluster draft;
  draft.mean = Eigen::MatrixXd::Zero(5, 1);
  const Deviation d = deviation(draft, two_seen());
  CHECK(d.t2 == 0);
  CHECK(d.t2_limit == 0);
  ClusterObservation elsewhere = two_seen();
  elsewhere.bin_id = {100, 101, 102};
  CHECK(std::isnan(deviation(two_weights(), elsewhere).spe));
}

TEST_CASE("A part of another shape than the taught one is refused by name", "[verdict]") {
  TaughtCluster taught = two_weights();
  taught.name = "lid";
  ClusterObservation seen = two_seen();
  seen.monitored = Eigen::Vector3d(1, 2, 3);
  const std::string error = brdfgate::test::input_error([&] { return deviation(taught, seen); });
  CHECK(brdfgate::test::contains(error, "cluster 'lid': 3 monitored changes"));
}
