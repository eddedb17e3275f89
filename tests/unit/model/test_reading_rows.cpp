#include <Eigen/Cholesky>
#include <cmath>
#include <random>

#include "catch.hpp"
#include "model/camera_colour.hpp"
#include "model/error.hpp"
#include "model/reading_rows.hpp"
#include "model/readings.hpp"
#include "model/reconstruction.hpp"
#include "support/input_error.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

/// A training material's own weights, with a posterior whose axes are not the components'.
Weights material(const Basis& basis, Eigen::Index first, double sigma = 0) {
  const Eigen::Index k = basis.info().components;
  Weights w;
  w.c = basis.training_weights().middleRows(first, 3).transpose();
  std::srand(5);
  const Eigen::MatrixXd mix = Eigen::MatrixXd::Random(k, k);
  const Eigen::MatrixXd shape = mix * mix.transpose() / double(k);
  for (int ch = 0; ch < 3 && sigma > 0; ++ch)
    w.covariance.emplace_back((1 + 0.3 * ch) * sigma * sigma * shape);
  w.channel_correlation = Eigen::Matrix3d{{1, 0.8, 0.5}, {0.8, 1, 0.7}, {0.5, 0.7, 1}};
  return w;
}

/// Draws of the weights: channels' standard normals correlated, then each through its own factor.
class Draws {
 public:
  explicit Draws(const Weights& w)
      : mean_(w), mix_(w.channel_correlation.llt().matrixL()), random_(17) {
    for (const Eigen::MatrixXd& c : w.covariance)
      factor_.emplace_back(c.llt().matrixL());
  }
  Weights next() {
    std::normal_distribution<double> normal;
    const Eigen::MatrixXd z =
        Eigen::MatrixXd::NullaryExpr(mean_.c.rows(), 3, [&] { return normal(random_); }) *
        mix_.transpose();
    Weights w = mean_;
    for (Eigen::Index ch = 0; ch < 3; ++ch)
      w.c.col(ch) += factor_[std::size_t(ch)] * z.col(ch);
    return w;
  }

 private:
  Weights mean_;
  Eigen::Matrix3d mix_;
  std::vector<Eigen::MatrixXd> factor_;
  std::mt19937 random_;
};

/// All of a cluster's readings in a row, by the whole BRDF.
Eigen::ArrayXd by_whole_brdf(const BrdfPtr& brdf) {
  const std::array<double, 3> gloss = gloss_gu(*brdf);
  const AspecularReadings seen = aspecular_readings(*brdf);
  Eigen::ArrayXd all(20);
  all << gloss[0], gloss[1], gloss[2], seen.lab[0], seen.lab[1], seen.lab[2], seen.lab[3],
      seen.lab[4], seen.flop_index, gloss[1] - gloss[0];
  return all;
}

Eigen::ArrayXd by_rows(const ClusterReadings& r, double Reading::* field) {
  Eigen::ArrayXd all(20);
  for (int i = 0; i < 3; ++i)
    all[i] = r.gloss[std::size_t(i)].*field;
  for (int i = 0; i < 15; ++i)
    all[3 + i] = r.aspecular[std::size_t(i / 3)].lab[std::size_t(i % 3)].*field;
  all[18] = r.flop.*field;
  all[19] = r.haze.*field;
  return all;
}

void check_values(const Eigen::ArrayXd& rows, const Eigen::ArrayXd& whole, bool haze) {
  for (int i = 0; i < 19; ++i) {
    CAPTURE(i);
    CHECK(rows[i] == Approx(whole[i]).epsilon(0.002).margin(i < 3 ? 0.001 : 0.003));
  }
  CHECK(std::isnan(rows[19]) != haze);
  if (haze) CHECK(rows[19] == Approx(whole[19]).epsilon(0.004));
}

CameraColour camera(ColourModel model) {
  CameraColour colour;
  colour.model = model;
  colour.to_xyz = Eigen::Matrix3d{{0.5, 0.3, 0.2}, {0.25, 0.65, 0.1}, {0.05, 0.15, 0.9}};
  if (model == ColourModel::root_polynomial) {
    Eigen::MatrixXd wide(3, 6);
    wide << colour.to_xyz, Eigen::Matrix3d{{0.04, 0, 0.02}, {-0.05, 0.03, 0}, {0.01, 0.02, -0.04}};
    colour.to_xyz = wide;
  }
  return colour;
}

}  // namespace

TEST_CASE("Readings from a few rows are those of the whole BRDF", "[reading rows]") {
  const auto basis = small_basis();
  const ReadingRows rows(basis);
  const Eigen::Index materials = basis->training_weights().rows() / 3;
  bool hazy = false;
  for (Eigen::Index i = 0; i < materials; ++i) {
    CAPTURE(i);
    const Weights w = material(*basis, 3 * i);
    const Eigen::ArrayXd whole = by_whole_brdf(make_brdf(basis, w));
    check_values(by_rows(rows.read(w), &Reading::value), whole, whole[1] > 70);
    hazy |= whole[1] > 70;
  }
  CHECK(hazy);
  for (const ColourModel model : {ColourModel::matrix, ColourModel::root_polynomial}) {
    const Weights w = material(*basis, 0);
    const BrdfPtr seen = in_linear_srgb(make_brdf(basis, w), camera(model));
    const Eigen::ArrayXd whole = by_whole_brdf(seen);
    check_values(by_rows(ReadingRows(basis, camera(model)).read(w), &Reading::value), whole,
                 whole[1] > 70);
  }
  Weights grey = material(*basis, 0);
  grey.c = grey.c.col(1).eval();
  const Eigen::ArrayXd whole = by_whole_brdf(make_brdf(basis, grey));
  check_values(by_rows(rows.read(grey), &Reading::value), whole, whole[1] > 70);
}

TEST_CASE("Readings' deviations are the scatter of weights drawn from their posterior",
          "[reading rows]") {
  const auto basis = small_basis();
  const auto colour = GENERATE(std::optional<CameraColour>(), camera(ColourModel::matrix),
                               camera(ColourModel::root_polynomial));
  const ReadingRows rows(basis, colour, 0);
  // A satin metal, and a polished one, which has a haze.
  const bool hazy = GENERATE(false, true);
  const Weights w = material(*basis, 3 * (hazy ? 4 : 8), hazy ? 0.001 : 0.004);
  const Eigen::ArrayXd sigma = by_rows(rows.read(w), &Reading::sigma);
  constexpr int kDraws = 2000;
  Draws draws(w);
  Eigen::ArrayXd sum = Eigen::ArrayXd::Zero(20), squares = sum;
  for (int i = 0; i < kDraws; ++i) {
    const ClusterReadings r = rows.read(draws.next());
    Eigen::ArrayXd all = by_rows(r, &Reading::value);
    all[19] = r.gloss[1].value - r.gloss[0].value;
    sum += all;
    squares += all.square();
  }
  const Eigen::ArrayXd scatter = (squares / kDraws - (sum / kDraws).square()).max(0).sqrt();
  for (int i = 0; i < 19; ++i) {
    CAPTURE(i, sum[i] / kDraws);
    CHECK(sigma[i] == Approx(scatter[i]).epsilon(0.1).margin(1e-4));
  }
  CHECK(std::isnan(sigma[19]) != hazy);
  if (hazy) CHECK(sigma[19] == Approx(scatter[19]).epsilon(0.1));
}

TEST_CASE("What a material can have beyond the basis widens readings, each by its own error",
          "[reading rows]") {
  const auto basis = small_basis();
  Weights w = material(*basis, 3 * 4, 0.001);
  const ReadingRows without(basis, std::nullopt, 0), with(basis, std::nullopt, 0.1);
  w.channel_correlation.setOnes();
  const ClusterReadings bare = without.read(w), wide = with.read(w);
  // All mapped values 0.1 up is about a tenth more light.
  const auto added = [](const Reading& a, const Reading& b) {
    return std::sqrt(b.sigma * b.sigma - a.sigma * a.sigma);
  };
  CHECK(added(bare.gloss[1], wide.gloss[1]) == Approx(0.1 * wide.gloss[1].value).epsilon(0.2));
  const Reading &l = bare.at_45_0().lab[0], &l_wide = wide.at_45_0().lab[0];
  CHECK(added(l, l_wide) == Approx(0.1 * (l.value + 16) / 3).epsilon(0.2));
  const double both =
      std::hypot(added(bare.gloss[0], wide.gloss[0]), added(bare.gloss[1], wide.gloss[1]));
  CHECK(added(bare.haze, wide.haze) == Approx(both));
}

TEST_CASE("Errors that channels share add up in lightness and cancel in chroma", "[reading rows]") {
  const auto basis = small_basis();
  const ReadingRows rows(basis, std::nullopt, 0);
  Weights w = material(*basis, 0, 0.004);
  w.c = w.c.col(1).replicate(1, 3).eval();
  w.covariance.assign(3, w.covariance[0]);
  w.channel_correlation = Eigen::Matrix3d::Identity();
  const ColourReading apart = rows.read(w).at_45_0();
  w.channel_correlation.setOnes();
  const ColourReading together = rows.read(w).at_45_0();
  CHECK(together.lab[0].sigma > 1.2 * apart.lab[0].sigma);
  CHECK(together.lab[1].sigma < 1e-3 * apart.lab[1].sigma);
  CHECK(together.lab[2].sigma < 1e-3 * apart.lab[2].sigma);
}

TEST_CASE("Channels that look alike share their errors", "[reading rows]") {
  Eigen::MatrixXd x = Eigen::VectorXd::LinSpaced(50, -1, 1).replicate(1, 3);
  x.col(2).array() += 1;
  const Eigen::MatrixXd r = channel_correlation(x);
  CHECK(r(0, 1) == Approx(1));
  CHECK(r(0, 2) == Approx(0.6 + 0.4 * std::exp(-1 / 0.3)));
  CHECK((r - r.transpose()).norm() == 0);
}

TEST_CASE("Intervals of gloss are by factors, others even", "[reading rows]") {
  const Reading gloss{100, 10, true};
  CHECK(gloss.interval()[0] == Approx(83.55).margin(0.01));
  CHECK(gloss.interval_by_factor()[0] * gloss.interval_by_factor()[1] == Approx(1e4));
  CHECK(gloss.interval_by_factor()[1] == Approx(100 * std::exp(0.16449)).epsilon(1e-4));
  const Reading black{0, 0.1, true};
  CHECK(black.interval_by_factor()[1] == 0);
}

TEST_CASE("A reading says whether the rig looked there", "[reading rows]") {
  constexpr double kDegree = EIGEN_PI / 180;
  const auto basis = small_basis();
  const ReadingRows rows(basis);
  BinnedSamples seen;
  seen.bins.push_back({.light = 1, .angles = {0.5 * kDegree, 55 * kDegree, 1}});
  seen.bins.push_back({.light = 2, .angles = to_half_diff(aspecular_directions(45))});
  const ClusterReadings r = rows.read(material(*basis, 0), seen);
  CHECK_FALSE(r.gloss[0].measured);
  CHECK(r.gloss[1].measured);
  CHECK_FALSE(r.gloss[2].measured);
  CHECK_FALSE(r.haze.measured);
  CHECK(r.at_45_0().lab[2].measured);
  CHECK_FALSE(r.aspecular[0].lab[0].measured);
  CHECK_FALSE(r.flop.measured);
  seen.bins[0].light = 2;  // the light that shows no highlight
  CHECK_FALSE(rows.read(material(*basis, 0), seen).gloss[1].measured);
}

TEST_CASE("Readings without a covariance have no deviation, and wrong weights are refused",
          "[reading rows]") {
  const auto basis = small_basis();
  const ReadingRows rows(basis);
  Weights w = material(*basis, 0);
  const ClusterReadings r = rows.read(w);
  CHECK(std::isfinite(r.gloss[1].value));
  CHECK(std::isnan(r.gloss[1].sigma));
  CHECK(std::isnan(r.at_45_0().lab[0].sigma));
  w.c(0, 0) = std::numeric_limits<double>::quiet_NaN();
  CHECK_THROWS_AS(rows.read(w), InputError);
  w.c = Eigen::MatrixXd::Zero(3, 3);
  CHECK(contains(input_error([&] { rows.read(w); }), "3 components"));
}
