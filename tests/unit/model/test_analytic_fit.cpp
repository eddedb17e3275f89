#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "catch.hpp"
#include "model/analytic_fit.hpp"
#include "model/projection.hpp"
#include "model/reconstruction.hpp"
#include "model/validation.hpp"
#include "support/input_error.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;

namespace {

constexpr double kPi = std::numbers::pi;

/// One coloured material per model, its lobe wide enough for the rig to see all of it.
const std::vector<Lobe> kMaterials{
    {LobeModel::lambert, {0.1, 0.4, 0.7}, Rgb::Zero(), {}},
    {LobeModel::phong, {0.1, 0.3, 0.6}, {0.3, 0.2, 0.1}, {60}},
    {LobeModel::blinn_phong, {0.1, 0.3, 0.6}, {0.3, 0.2, 0.1}, {200}},
    {LobeModel::ward, {0.1, 0.3, 0.6}, {0.3, 0.2, 0.1}, {0.12}},
    {LobeModel::ggx, {0.1, 0.3, 0.6}, {0.08, 0.05, 0.04}, {0.15}},
    {LobeModel::beckmann, {0.1, 0.3, 0.6}, {0.08, 0.05, 0.04}, {0.15}},
    {LobeModel::blend, {0.1, 0.3, 0.6}, {60, 40, 30}, {50, 0.4, 1.6}}};

BinnedSamples seen_by_rig(const Lobe& lobe) {
  ValidationRig rig;
  rig.lattice = 9;  // a third of the usual 298 directions
  return observe_exactly(*make_brdf(lobe), rig);
}

void check_same(const Lobe& fitted, const Lobe& truth, double epsilon) {
  INFO(describe(truth.model).name);
  CHECK(fitted.model == truth.model);
  for (int channel = 0; channel < 3; ++channel) {
    CHECK(fitted.diffuse[channel] == Approx(truth.diffuse[channel]).epsilon(epsilon));
    CHECK(fitted.specular[channel] == Approx(truth.specular[channel]).epsilon(epsilon));
  }
  REQUIRE(fitted.shape.size() == truth.shape.size());
  for (std::size_t i = 0; i < truth.shape.size(); ++i)
    CHECK(fitted.shape[i] == Approx(truth.shape[i]).epsilon(epsilon));
}

/// Every tenth bin shines forty times too bright.
BinnedSamples with_outliers(BinnedSamples samples) {
  for (std::size_t j = 0; j < samples.bins.size(); j += 10)
    samples.bins[j].f *= 40;
  return samples;
}

double mapped_distance(const Brdf& a, const Brdf& b) {
  const BinnedSamples x = sample_cells(a, {20, 10, 6});
  const BinnedSamples y = sample_cells(b, {20, 10, 6});
  return (log_observations(x, 1).value - log_observations(y, 1).value).array().abs().mean();
}

}  // namespace

TEST_CASE("each model finds its own parameters from a rig's directions") {
  for (const Lobe& truth : kMaterials) {
    const LobeFit fit = fit_lobe(truth.model, seen_by_rig(truth));
    check_same(fit.lobe, truth, 0.02);
    CHECK(fit.mapped_l1 < 1e-3);
    CHECK(fit.mapped_rms >= fit.mapped_l1);
  }
}

TEST_CASE("each model finds its own parameters from a whole table") {
  for (const Lobe& truth : kMaterials) {
    const BinnedSamples table = sample_cells(*make_brdf(truth), {20, 8, 6});
    check_same(fit_lobe(truth.model, table).lobe, truth, 0.02);
  }
}

TEST_CASE("the L1 fit passes by outliers that a least-squares fit follows") {
  const Lobe& truth = kMaterials[4];
  const BinnedSamples samples = with_outliers(seen_by_rig(truth));
  check_same(fit_lobe(truth.model, samples).lobe, truth, 0.05);
  const Lobe pulled = lobe_posterior(truth.model, samples).fit.lobe;
  CHECK(std::abs(pulled.diffuse[1] / truth.diffuse[1] - 1) > 0.1);
}

TEST_CASE("C.I's three stages leave the diffuse level of the first; the last stage mends it") {
  const Lobe& truth = kMaterials[6];
  const BinnedSamples samples = seen_by_rig(truth);
  LobeFitOptions paper;
  paper.polish = false;
  const LobeFit three = fit_lobe(LobeModel::blend, samples, paper);
  const LobeFit four = fit_lobe(LobeModel::blend, samples);
  CHECK(three.mapped_l1 < 0.1);
  CHECK(four.mapped_l1 <= three.mapped_l1);
}

TEST_CASE("a fit is the same every time") {
  const BinnedSamples samples = with_outliers(seen_by_rig(kMaterials[5]));
  const LobeFit a = fit_lobe(LobeModel::blend, samples);
  const LobeFit b = fit_lobe(LobeModel::blend, samples);
  CHECK(a.lobe.shape == b.lobe.shape);
  CHECK((a.lobe.diffuse == b.lobe.diffuse).all());
  CHECK((a.lobe.specular == b.lobe.specular).all());
}

TEST_CASE("bins known to be noisy count for little") {
  const Lobe& truth = kMaterials[0];
  BinnedSamples samples = seen_by_rig(truth);
  for (std::size_t j = 0; j < samples.bins.size(); ++j) {
    if (j % 5 < 2) continue;  // three bins in five are far off, and say so
    samples.bins[j].f *= 3;
    samples.bins[j].variance = (samples.bins[j].f * 20).square();
  }
  check_same(fit_lobe(LobeModel::lambert, samples).lobe, truth, 0.02);
}

TEST_CASE("mono samples give a grey material") {
  BinnedSamples samples = seen_by_rig(kMaterials[4]);
  samples.channels = 1;
  const Lobe lobe = fit_lobe(LobeModel::ggx, samples).lobe;
  CHECK(lobe.diffuse[0] == Approx(0.1).epsilon(0.02));
  CHECK((lobe.diffuse == lobe.diffuse[0]).all());
  CHECK((lobe.specular == lobe.specular[0]).all());
}

TEST_CASE("the best of all models is the one the samples come from") {
  for (const std::size_t i : {0, 4}) {
    const LobeFit fit = fit_best_lobe(seen_by_rig(kMaterials[i]));
    if (i > 0) CHECK(fit.lobe.model == kMaterials[i].model);
    CHECK(fit.mapped_l1 < 1e-3);
  }
}

TEST_CASE("black samples and a perfect mirror's are fitted without a fault") {
  for (const LobeModel model : lobe_models()) {
    BinnedSamples black = seen_by_rig(kMaterials[0]);
    for (Bin& bin : black.bins)
      bin.f.setZero();
    const LobeFit none = fit_lobe(model, black);
    INFO(describe(model).name);
    CHECK(none.mapped_l1 < 0.3);  // Schlick's Fresnel reflects at grazing angles even at f0 = 0
    BinnedSamples spike = black;
    spike.bins[25].f.setConstant(1e5);
    const LobeFit fit = fit_lobe(model, spike);
    CHECK(std::isfinite(fit.mapped_rms));
    CHECK_NOTHROW(make_brdf(fit.lobe));
  }
}

TEST_CASE("a single bin is fitted by every model") {
  BinnedSamples samples = seen_by_rig(kMaterials[4]);
  samples.bins.resize(1);
  for (const LobeModel model : lobe_models())
    CHECK(fit_lobe(model, samples).mapped_l1 < 0.1);
}

TEST_CASE("Laplace's evidence of a Lambertian is the integral over its albedo") {
  BinnedSamples samples = seen_by_rig(kMaterials[0]);
  samples.channels = 1;
  samples.bins.resize(40);
  std::mt19937 random(3);
  std::normal_distribution<double> error(0, 0.2);
  for (Bin& bin : samples.bins)
    bin.f *= std::exp(error(random));
  LobeFitOptions options;
  options.discrepancy = 0.2;
  const LobePosterior posterior = lobe_posterior(LobeModel::lambert, samples, options);
  const LogObservations seen = log_observations(samples, 0.2);
  const LobeParameter& prior = diffuse_parameter();
  double sum = 0;
  constexpr double kStep = 1e-3;
  const double peak = std::log(posterior.fit.lobe.diffuse[0]);
  for (double u = peak - 1; u < peak + 1; u += kStep) {
    const double z = (u - std::log(prior.typical)) / prior.spread;
    double log_density = -0.5 * z * z - std::log(prior.spread * std::sqrt(2 * kPi));
    for (Eigen::Index j = 0; j < seen.value.rows(); ++j) {
      const double model = std::log(std::exp(u) / kPi * seen.weight[j] + 1e-3);
      const double r = (seen.value(j, 0) - model) / 0.2;
      log_density += -0.5 * r * r - std::log(0.2 * std::sqrt(2 * kPi));
    }
    sum += std::exp(log_density) * kStep;
  }
  CHECK(posterior.parameters == 1);
  CHECK(posterior.log_evidence == Approx(std::log(sum)).epsilon(1e-3));
}

TEST_CASE("unusable samples and options are refused") {
  const BinnedSamples good = seen_by_rig(kMaterials[0]);
  const auto message = [](const BinnedSamples& samples, double discrepancy = 0.3) {
    return input_error([&] {
      LobeFitOptions options;
      options.discrepancy = discrepancy;
      return fit_lobe(LobeModel::ggx, samples, options).mapped_l1;
    });
  };
  BinnedSamples bad = good;
  bad.bins.clear();
  CHECK(contains(message(bad), "no bins"));
  bad = good;
  bad.bins[3].f[1] = -1e-9;
  CHECK(contains(message(bad), "bin 3: channel 1 is -0.0"));
  bad.bins[3].f[1] = std::nan("");
  CHECK(contains(message(bad), "bin 3: channel 1 is nan"));
  bad = good;
  bad.bins[4].variance[2] = std::nan("");
  CHECK(contains(message(bad), "bin 4: its variance is nan"));
  bad = good;
  bad.bins[5].angles = {1.4, 1.2, 0};
  CHECK(contains(message(bad), "bin 5: a direction is below the horizon"));
  bad = good;
  bad.channels = 2;
  CHECK(contains(message(bad), "2 channels"));
  for (const double wrong : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()})
    CHECK(contains(message(good, wrong), "discrepancy: "));
}

TEST_CASE("a table has only cells that comparisons count, each at its own direction") {
  const BrdfPtr brdf = make_brdf(kMaterials[4]);
  const BinnedSamples samples = sample_cells(*brdf, {9, 9, 9});
  CHECK(samples.bins.size() > 9 * 9 * 9 / 3);
  for (const Bin& bin : samples.bins) {
    REQUIRE(cosines(bin.angles).above_horizon(0.02));
    REQUIRE((bin.f == brdf->eval(bin.angles)).all());
  }
}

TEST_CASE("an analytic model projected on a basis that knows it comes back as itself") {
  const auto basis = test::small_basis(20);
  GgxParameters known;  // a material of the training set
  known.diffuse = Rgb(0.02, 0.1, 0.4) * 0.96;
  known.f0 = Rgb(0.04, 0.9 * 0.04, 0.8 * 0.04);
  known.alpha = 0.1;
  const BrdfPtr brdf = make_brdf(known);
  const BrdfPtr back = make_brdf(basis, project(*basis, *brdf));
  CHECK(mapped_distance(*brdf, *back) < 0.06);
  // And from the basis to parameters: the whole way round.
  const LobeFit fit = fit_lobe(LobeModel::ggx, sample_cells(*back, {20, 10, 6}));
  CHECK(fit.lobe.shape[0] == Approx(0.1).epsilon(0.15));
  CHECK(fit.lobe.diffuse[2] == Approx(0.4 * 0.96).epsilon(0.1));
}
