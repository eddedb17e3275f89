#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "catch.hpp"
#include "model/mapping.hpp"
#include "model/parsimony.hpp"
#include "model/validation.hpp"
#include "support/input_error.hpp"
#include "support/shipped.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::shipped_file;

namespace {

const Basis& shipped_basis() {
  static const auto basis = Basis::open(shipped_file("basis/merl.basis"));
  return *basis;
}

/// 74 directions of the usual rig: enough to tell models apart, quick to fit.
ValidationRig small_rig() {
  ValidationRig rig;
  rig.lattice = 8;
  return rig;
}

BinnedSamples seen(const Lobe& lobe) {
  return observe_exactly(*make_brdf(lobe), small_rig());
}

/// Each value off by a normal error in mapped units.
BinnedSamples disturbed(BinnedSamples samples, double sigma, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> error(0, sigma);
  for (Bin& bin : samples.bins) {
    for (double& f : bin.f)
      f *= std::exp(error(random));
  }
  return samples;
}

/// A material of the first k components alone, its weights a draw from the prior.
BinnedSamples of_components(int k, unsigned seed) {
  const Basis& basis = shipped_basis();
  BinnedSamples samples = seen({LobeModel::lambert, Rgb::Constant(0.1), Rgb::Zero(), {}});
  std::mt19937 random(seed);
  std::normal_distribution<double> draw(0, 1 / std::sqrt(double(basis.info().observations)));
  for (int channel = 0; channel < 3; ++channel) {
    Eigen::VectorXd c = Eigen::VectorXd::Zero(basis.info().components);
    for (int i = 0; i < k; ++i)
      c[i] = draw(random);
    const Eigen::VectorXd f = basis.reconstruct(c, samples.directions());
    for (std::size_t j = 0; j < samples.bins.size(); ++j)
      samples.bins[j].f[channel] = f[Eigen::Index(j)];
  }
  return samples;
}

const Lobe kLambert{LobeModel::lambert, {0.1, 0.4, 0.7}, Rgb::Zero(), {}};
const Lobe kGgx{LobeModel::ggx, {0.1, 0.3, 0.6}, {0.08, 0.05, 0.04}, {0.12}};

}  // namespace

TEST_CASE("Lambertian samples need Lambert and no more") {
  for (const double discrepancy : {0.05, 0.37}) {
    ParsimonyOptions options;
    options.discrepancy = discrepancy;
    const Parsimony result = smallest_sufficient_model(disturbed(seen(kLambert), discrepancy, 1),
                                                       shipped_basis(), options);
    CHECK(to_text(result.choice()) == "lambert");
    CHECK(result.choice().parameters == 3);
    // The residual is what the error model says: chi-square within 4 deviations of its mean.
    CHECK(result.choice().chi_square ==
          Approx(result.choice().values).margin(4 * std::sqrt(2.0 * result.choice().values)));
  }
}

TEST_CASE("samples of a lobe need that lobe") {
  for (const double discrepancy : {0.05, 0.2}) {
    ParsimonyOptions options;
    options.discrepancy = discrepancy;
    const Parsimony result =
        smallest_sufficient_model(disturbed(seen(kGgx), discrepancy, 2), shipped_basis(), options);
    INFO(to_text(result.choice()));
    CHECK(result.choice().kind == ModelScore::Kind::lobe);
    if (discrepancy < 0.1) CHECK(result.choice().lobe == LobeModel::ggx);
    CHECK(result.choice().components == 0);
  }
}

TEST_CASE("samples that only components explain get as many as they are made of") {
  ParsimonyOptions options;
  options.discrepancy = 0.05;
  int last = 0;
  for (const int k : {2, 8, 20}) {
    const Parsimony result = smallest_sufficient_model(disturbed(of_components(k, 5), 0.05, 3),
                                                       shipped_basis(), options);
    const ModelScore& choice = result.choice();
    INFO("made of " << k << ", chosen: " << to_text(choice));
    CHECK(choice.kind == ModelScore::Kind::components);
    CHECK(choice.components > last);
    CHECK(choice.components <= k);
    last = choice.components;
  }
}

TEST_CASE("more error asks for fewer components") {
  const BinnedSamples exact = of_components(30, 6);
  std::vector<int> chosen;
  for (const double discrepancy : {0.02, 0.2, 0.8}) {
    ParsimonyOptions options;
    options.discrepancy = discrepancy;
    options.lobes = {};
    chosen.push_back(
        smallest_sufficient_model(disturbed(exact, discrepancy, 4), shipped_basis(), options)
            .choice()
            .components);
  }
  CAPTURE(chosen);
  CHECK(std::is_sorted(chosen.rbegin(), chosen.rend()));
  CHECK(chosen.front() > 2 * chosen.back());
}

TEST_CASE("noise of the pixels counts as the discrepancy does") {
  // The same error, once known as discrepancy and once as the bins' own variance.
  BinnedSamples samples = disturbed(of_components(8, 7), 0.3, 8);
  ParsimonyOptions as_discrepancy;
  as_discrepancy.discrepancy = 0.3;
  as_discrepancy.lobes = {};
  const Parsimony a = smallest_sufficient_model(samples, shipped_basis(), as_discrepancy);
  for (Bin& bin : samples.bins) {
    const double w = cosine_weight(cosines(bin.angles));
    bin.variance = (0.2999 / w * (bin.f * w + kMappingEpsilon)).square();
  }
  ParsimonyOptions as_noise = as_discrepancy;
  as_noise.discrepancy = std::sqrt(0.3 * 0.3 - 0.2999 * 0.2999);
  const Parsimony b = smallest_sufficient_model(samples, shipped_basis(), as_noise);
  REQUIRE(a.tried.size() == b.tried.size());
  for (std::size_t i = 0; i < a.tried.size(); ++i)
    CHECK(a.tried[i].log_evidence == Approx(b.tried[i].log_evidence).margin(1e-3));
}

TEST_CASE("the components' evidence is the density of one large Gaussian") {
  BinnedSamples samples = of_components(5, 9);
  samples.bins.resize(12);
  samples.channels = 1;
  ParsimonyOptions options;
  options.discrepancy = 0.3;
  options.lobes = {};
  options.components = {3};
  const Basis& basis = shipped_basis();
  const ModelScore score = smallest_sufficient_model(samples, basis, options).tried.back();
  const BasisRows rows = basis.rows(samples.directions());
  const double m = basis.info().observations;
  Eigen::VectorXd x(12);
  for (Eigen::Index j = 0; j < 12; ++j)
    x[j] =
        to_mapped(samples.bins[std::size_t(j)].f[0], rows.median[j], rows.weight[j]) - rows.mean[j];
  const Eigen::MatrixXd covariance = rows.q.leftCols(3) * rows.q.leftCols(3).transpose() / m +
                                     0.09 * Eigen::MatrixXd::Identity(12, 12);
  const double expected =
      -0.5 * (x.dot(covariance.inverse() * x) + std::log(covariance.determinant()) +
              12 * std::log(2 * std::numbers::pi));
  CHECK(score.components == 3);
  CHECK(score.parameters == 3);
  CHECK(score.log_evidence == Approx(expected));
}

TEST_CASE("what is tried runs from small to large, and the choice is the first that suffices") {
  const Parsimony result = smallest_sufficient_model(seen(kGgx), shipped_basis());
  REQUIRE(result.tried.size() == 1 + 6 + 9);  // up to the 40 components of the shipped basis
  CHECK(to_text(result.tried.front()) == "lambert");
  CHECK(to_text(result.tried[7]) == "1 component");
  CHECK(to_text(result.tried.back()) == "40 components");
  CHECK(result.choice().sufficient);
  for (std::size_t i = 0; i < result.chosen; ++i) {
    if (result.tried[i].kind < result.choice().kind) CHECK_FALSE(result.tried[i].sufficient);
  }
}

TEST_CASE("parsimony refuses options and samples that say nothing") {
  const BinnedSamples good = seen(kLambert);
  const auto message = [&](const BinnedSamples& samples, const ParsimonyOptions& options) {
    return input_error(
        [&] { return smallest_sufficient_model(samples, shipped_basis(), options).chosen; });
  };
  ParsimonyOptions options;
  options.margin = -1;
  CHECK(contains(message(good, options), "margin: "));
  options = {};
  options.components = {};
  CHECK(contains(message(good, options), "components: none to try"));
  options.components = {3, 0};
  CHECK(contains(message(good, options), "components: 0"));
  options = {};
  options.discrepancy = -0.1;
  CHECK(contains(message(good, options), "discrepancy: "));
  BinnedSamples bad = good;
  bad.bins[0].f[0] = std::nan("");
  CHECK(contains(message(bad, {}), "bin 0: channel 0 is nan"));
  bad.bins.clear();
  CHECK(contains(message(bad, {}), "no bins"));
}
