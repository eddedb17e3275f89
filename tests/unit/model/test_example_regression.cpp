// Exemplars, the estimator `gp` that learns from them, and what its results can be trusted for.
#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "model/canonical.hpp"
#include "model/estimators.hpp"
#include "model/example_regression.hpp"
#include "model/mapping.hpp"
#include "model/validation.hpp"
#include "model/validity.hpp"
#include "support/input_error.hpp"
#include "support/simple_regression.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

std::shared_ptr<const Basis> basis_with_exemplars() {
  static const std::shared_ptr<const Basis> basis = [] {
    const TempDir dir;
    TrainingOptions options = small_training_options();
    options.exemplars = {40, 40};
    train_basis(small_training_set(), options, dir / "small.basis");
    return Basis::open(dir / "small.basis");
  }();
  return basis;
}

BrdfPtr satin() {
  GgxParameters p;
  p.diffuse = Rgb(0.3, 0.2, 0.1);
  p.f0 = Rgb(0.06, 0.06, 0.06);
  p.alpha = 0.17;
  return make_brdf(p);
}

double error(const Basis& basis, const Brdf& truth, const Weights& w) {
  return reconstruction_error(truth, basis, w, {24, 12, 12}).mapped_rms;
}

}  // namespace

TEST_CASE("exemplars are the same for the same basis and survive the file") {
  const auto basis = basis_with_exemplars();
  const auto drawn = draw_exemplars(*basis, {40, 40});
  REQUIRE(drawn.size() == 80);
  REQUIRE(basis->exemplars().size() == 80);
  for (std::size_t i = 0; i < drawn.size(); ++i) {
    CHECK(to_record(drawn[i]) == to_record(basis->exemplars()[i]));
    CHECK(is_valid(drawn[i], basis->info().observations));
  }
}

TEST_CASE("a GGX exemplar is the analytic model of the scene files") {
  const auto basis = basis_with_exemplars();
  Exemplar e;
  e.albedo = 0.3;
  e.lobes[0] = {0.2, 2.0, 0.05, 1.0};
  GgxParameters p;
  p.diffuse = Rgb::Constant(0.3);
  p.f0 = Rgb::Constant(0.05);
  p.alpha = 0.2;
  const BrdfPtr peer = make_brdf(p);
  std::vector<HalfDiff> directions;
  for (const double h : {0.0, 0.1, 0.4})
    for (const double d : {0.1, 0.5, 0.9})
      directions.push_back({h, d, 1.1});
  const Eigen::MatrixXd f = exemplar_reflectance(*basis, {e}, directions);
  for (std::size_t j = 0; j < directions.size(); ++j) {
    CHECK(f(Eigen::Index(j), 0) == Approx(peer->eval(directions[j])[0]).epsilon(1e-9));
  }
}

TEST_CASE("a Beckmann lobe falls by e where tan theta_h is alpha, and survives the file") {
  const auto basis = basis_with_exemplars();
  Exemplar e;
  e.lobes[0] = {0.2, 0, 1.0, 1.0};  // exponent 0: Beckmann; f0 = 1: no Fresnel
  CHECK(is_valid(e, 1));
  CHECK(to_record(from_record(to_record(e))) == to_record(e));
  // At one theta_d and phi_d of 90 degrees both cosines are cos theta_h cos theta_d.
  const double theta_d = 0.3;
  const double edge = std::atan(0.2);
  const Eigen::MatrixXd f = exemplar_reflectance(
      *basis, {e}, {{0, theta_d, std::numbers::pi / 2}, {edge, theta_d, std::numbers::pi / 2}});
  const auto masking = [&](double theta_h) {
    const double c = std::cos(theta_h) * std::cos(theta_d);
    return 0.25 / (c * std::sqrt(0.04 + 0.96 * c * c));
  };
  CHECK(f(0, 0) == Approx(masking(0) / (std::numbers::pi * 0.04)).epsilon(1e-9));
  CHECK(f(1, 0) / masking(edge) ==
        Approx(f(0, 0) / masking(0) / std::numbers::e / std::pow(std::cos(edge), 4)).epsilon(1e-9));
}

TEST_CASE("an unchanged observation on no base is itself") {
  const auto basis = basis_with_exemplars();
  Exemplar e;
  e.source = 4;
  const std::vector<HalfDiff> at{{0.05, 0.6, 1.0}, {0.3, 0.4, 2.0}};
  const Eigen::VectorXd f = basis->reconstruct(basis->training_weights().row(4).transpose(), at);
  CHECK((exemplar_reflectance(*basis, {e}, at).col(0) - f).norm() < 1e-9 * f.norm());
}

TEST_CASE("training weights reproduce the training set") {
  const auto basis = basis_with_exemplars();
  const auto set = small_training_set();
  const HalfDiff at = basis->info().grid.centre(5, 6, 6);
  for (std::size_t i = 0; i < set.size(); ++i) {
    const Rgb f = set[i].brdf->eval(at);
    for (int c = 0; c < 3; ++c) {
      const auto row = static_cast<Eigen::Index>(3 * i) + c;
      const double found =
          basis->reconstruct(basis->training_weights().row(row).transpose(), {at})[0];
      CHECK(std::abs(std::log((found + 1e-3) / (f[c] + 1e-3))) < 0.1);
    }
  }
}

TEST_CASE("gp reconstructs a stranger no worse than ridge and says how sure it is") {
  const auto basis = basis_with_exemplars();
  const auto samples = observe_exactly(*satin());
  const Weights own = make_estimator({"gp"}, basis)->estimate(samples);
  const Weights papers = make_estimator({"ridge"}, basis)->estimate(samples);
  CHECK(error(*basis, *satin(), own) < 1.05 * error(*basis, *satin(), papers));
  REQUIRE(own.covariance.size() == 3);
  for (const Eigen::MatrixXd& covariance : own.covariance) {
    CHECK(covariance.diagonal().minCoeff() > 0);
    CHECK((covariance - covariance.transpose()).norm() < 1e-12);
  }
  const Validity v = validity(*basis, own);
  CHECK(v.seen.minCoeff() >= 0);
  CHECK(v.seen.row(0).minCoeff() > 0.5);  // the first weight is what two lights see best
}

TEST_CASE("gp answers the same for the same samples, before and after others") {
  const auto basis = basis_with_exemplars();
  const auto estimator = make_estimator({"gp"}, basis);
  const auto samples = observe_exactly(*satin());
  const Weights first = estimator->estimate(samples);
  BinnedSamples fewer = samples;
  fewer.bins.resize(200);
  estimator->estimate(fewer);
  CHECK(estimator->estimate(samples).c == first.c);
}

TEST_CASE("gp's mean is that of the formulas, from many directions and from few") {
  const auto basis = basis_with_exemplars();
  for (const std::size_t bins : {298U, 5U}) {
    BinnedSamples samples = observe_exactly(*satin());
    samples.bins.resize(bins);
    const ExampleRegression regression(*basis, samples.directions());
    const test::SimpleRegression simple(*basis, samples.directions());
    const Eigen::MatrixXd x = centred(samples, regression.rows());
    const Eigen::MatrixXd c = regression.mean(x);
    const double m = basis->info().observations;
    for (Eigen::Index channel = 0; channel < 3; ++channel) {
      INFO("bins " << bins << ", channel " << channel);
      CHECK((c.col(channel) - simple.mean(x.col(channel))).norm() * std::sqrt(m) <
            1e-2);  // single precision
    }
    const auto predicted = regression.predict(x);
    REQUIRE(predicted.size() == 3);
    CHECK((predicted[2].c - c.col(2)).norm() == 0);
  }
}

TEST_CASE("a few bad bins hardly move gp's weights") {
  const auto basis = basis_with_exemplars();
  const auto estimator = make_estimator({"gp"}, basis);
  const auto good = observe_exactly(*satin());
  const Weights clean = estimator->estimate(good);
  const double m = basis->info().observations;
  const ExampleRegression plain(*basis, good.directions());
  const auto moved = [&](const Eigen::MatrixXd& c, const Eigen::MatrixXd& from) {
    return (c - from).norm() * std::sqrt(m / double(c.size()));
  };
  struct Case {
    const char* what;
    std::size_t step;  // every so many bins
    double factor;
    double most;  // prior deviations, RMS over the weights
  };
  for (const Case& c : {Case{"3 % of the bins three times too bright", 33, 3.0, 0.03},
                        Case{"3 % of the bins three times too dark", 33, 1 / 3.0, 0.03},
                        Case{"one bin a hundred times too bright", 298, 100.0, 0.03}}) {
    INFO(c.what);
    BinnedSamples bad = good;
    for (std::size_t i = 20; i < bad.bins.size(); i += c.step)
      bad.bins[i].f *= c.factor;
    const double robust = moved(estimator->estimate(bad).c, clean.c);
    const double naive =
        moved(plain.mean(centred(bad, plain.rows())), plain.mean(centred(good, plain.rows())));
    CHECK(robust < c.most);
    CHECK(robust < 0.5 * naive);
  }
  // Nothing is lost where there is nothing to hold.
  const double loss = error(*basis, *satin(), clean);
  Weights unheld = clean;
  unheld.c = plain.mean(centred(good, plain.rows()));
  CHECK(loss < 1.03 * error(*basis, *satin(), unheld));
}

TEST_CASE("a method that is unknown or has no data is refused by name") {
  const auto plain = small_basis();
  CHECK(make_estimator({}, plain)->name() == "ridge");
  CHECK(make_estimator({}, basis_with_exemplars())->name() == "gp");
  CHECK(contains(input_error([&] { make_estimator({"gp"}, plain); }), "no exemplars"));
  CHECK(contains(input_error([&] { make_estimator({"lasso"}, plain); }), "'lasso' is unknown"));
  CHECK(contains(
      input_error([&] { make_estimator({"gp"}, basis_with_exemplars())->estimate({3, {}}); }),
      "no bins"));
}

TEST_CASE("samples on their own frame are unchanged; a missing bin is filled, a strange one left") {
  const auto basis = basis_with_exemplars();
  const auto samples = observe_exactly(*satin());
  const BinFrame frame = frame_of(samples);
  const Weights w = ridge(*basis, samples);
  const BinnedSamples same = onto_frame(*basis, samples, w, frame);
  for (std::size_t i = 0; i < samples.bins.size(); ++i)
    CHECK((same.bins[i].f - samples.bins[i].f).abs().maxCoeff() < 1e-9);

  BinnedSamples gap = samples;
  gap.bins.erase(gap.bins.begin() + 7);
  gap.bins.back().id = 100000;
  const BinnedSamples filled = onto_frame(*basis, gap, w, frame);
  REQUIRE(filled.bins.size() == samples.bins.size());
  CHECK(filled.bins[7].pixels == 0);
  const double ratio = filled.bins[7].f[0] / samples.bins[7].f[0];
  CHECK(std::abs(std::log(ratio)) < 0.5);
  CHECK(contains(input_error([&] { onto_frame(*basis, samples, w, {}); }), "no bins"));
}

TEST_CASE("the chi-square limit is that of the tables") {
  // NIST/SEMATECH e-Handbook of Statistical Methods, table 1.3.6.7.4, upper 0.001.
  CHECK(chi_square_limit(1) == Approx(10.828).epsilon(0.035));
  CHECK(chi_square_limit(10) == Approx(29.588).epsilon(0.007));
  CHECK(chi_square_limit(40) == Approx(73.402).epsilon(0.002));
}
