#include <cmath>

#include "catch.hpp"
#include "model/mapping.hpp"
#include "model/monitored.hpp"
#include "support/input_error.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::small_basis;

namespace {

BrdfPtr satin() {
  return make_brdf(GgxParameters{{0.2, 0.1, 0.05}, Rgb::Constant(0.05), 0.15});
}

/// Directions from the highlight outward under light 1, and far from it under light 2.
BinFrame frame() {
  BinFrame f;
  for (int j = 0; j < 24; ++j) {
    f.id.push_back(3 * j);
    f.light.push_back(j < 16 ? 1 : 2);
    f.directions.push_back({j < 16 ? 0.02 * j : 0.35 + 0.01 * j, 0.6, 0.3});
  }
  return f;
}

BinnedSamples seen(const Brdf& brdf, const BinFrame& f, double variance = 1e-8) {
  BinnedSamples s;
  for (std::size_t j = 0; j < f.id.size(); ++j) {
    Bin bin;
    bin.id = f.id[j];
    bin.light = f.light[j];
    bin.angles = f.directions[j];
    bin.pixels = 50;
    bin.f = brdf.eval(bin.angles);
    bin.variance.setConstant(variance);
    s.bins.push_back(bin);
  }
  return s;
}

MonitoredDirections directions_of(const Basis& basis, const Brdf& brdf) {
  const BinFrame f = frame();
  const BinnedSamples taught = seen(brdf, f);
  const BasisRows rows = basis.rows(f.directions);
  return monitored_directions(basis, brdf, f, centred(taught, rows), mapped_noise(rows, taught));
}

ClusterObservation observed(const Basis& basis, const MonitoredDirections& d,
                            const BinnedSamples& samples) {
  return observe_along(d, basis, samples, ridge(basis, samples));
}

}  // namespace

TEST_CASE("A changed material is seen along its own direction, by the logarithm of its change",
          "[monitored]") {
  const auto basis = small_basis();
  const MonitoredDirections d = directions_of(*basis, *satin());
  REQUIRE(d.names == std::vector<std::string>{"diffuse level R", "diffuse level G",
                                              "diffuse level B", "gloss level", "roughness"});
  struct Row {
    BrdfChange change;
    Eigen::VectorXd expected;
  };
  const auto vector = [](std::initializer_list<double> v) {
    return Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(v.begin(), std::ssize(v)));
  };
  const double up = std::log(1.03), down = std::log(0.97);
  const Row rows[] = {{{}, vector({0, 0, 0, 0, 0})},
                      {{.albedo = 1.03}, vector({up, up, up, 0, 0})},
                      {{.gloss = 0.97}, vector({0, 0, 0, down, 0})},
                      {{.roughness = 1.03}, vector({0, 0, 0, 0, up})},
                      {{.albedo = 0.97, .roughness = 1.03}, vector({down, down, down, 0, up})}};
  for (const Row& row : rows) {
    const ClusterObservation o = observed(*basis, d, seen(*changed(satin(), row.change), d.frame));
    CAPTURE(o.monitored.transpose(), row.expected.transpose());
    CHECK((o.monitored - row.expected).cwiseAbs().maxCoeff() < 2e-3);
    CHECK(o.residual.cwiseAbs().maxCoeff() < 5e-3);
  }
}

TEST_CASE("Bins that a part did not show change nothing but the uncertainty", "[monitored]") {
  const auto basis = small_basis();
  const MonitoredDirections d = directions_of(*basis, *satin());
  BinnedSamples some = seen(*changed(satin(), {.albedo = 1.02, .roughness = 0.98}), d.frame);
  const ClusterObservation all = observed(*basis, d, some);
  for (std::size_t j = 0; j < some.bins.size(); j += 3) {
    some.bins[j].pixels = 0;
    some.bins[j].f.setConstant(9);  // not to be looked at
  }
  const ClusterObservation fewer = observed(*basis, d, some);
  CHECK(fewer.bin_id.size() == 16);
  CHECK(fewer.residual.rows() == 16);
  CHECK((fewer.monitored - all.monitored).cwiseAbs().maxCoeff() < 2e-3);
  CHECK((fewer.monitored_noise.diagonal() - all.monitored_noise.diagonal()).minCoeff() > 0);
}

TEST_CASE("The noise of the monitored changes is what pixel noise makes of them", "[monitored]") {
  const auto basis = small_basis();
  const MonitoredDirections d = directions_of(*basis, *satin());
  const BinnedSamples clean = seen(*satin(), d.frame, 1e-6);
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(5, 5);
  constexpr int kDraws = 600;
  const Weights weights = ridge(*basis, clean);
  for (int i = 0; i < kDraws; ++i) {
    BinnedSamples noisy = clean;
    for (Bin& bin : noisy.bins)
      for (int c = 0; c < 3; ++c)
        bin.f[c] += 1e-3 * normal(random);
    const ClusterObservation o = observe_along(d, *basis, noisy, weights);
    sum += o.monitored * o.monitored.transpose() / kDraws;
  }
  // Beside the pixels' noise there is a part that does not depend on it: the bins' own error.
  const Eigen::MatrixXd predicted = observed(*basis, d, clean).monitored_noise -
                                    observed(*basis, d, seen(*satin(), d.frame, 0)).monitored_noise;
  for (int i = 0; i < 5; ++i)
    CHECK(sum(i, i) == Approx(predicted(i, i)).epsilon(0.25));
}

TEST_CASE("What a bin's cells are mistaken by is common to its channels", "[monitored]") {
  const auto basis = small_basis();
  const auto matt = make_brdf(LambertParameters{{0.5, 0.5, 0.5}});
  const MonitoredDirections d = directions_of(*basis, *matt);
  const ClusterObservation o = observed(*basis, d, seen(*matt, d.frame, 0));
  CHECK(o.levels == 3);
  // 24 bins of equal weight: 1 % of each, of which 0.3 % are a channel's own.
  const double common = o.monitored_noise(0, 1), level = o.monitored_noise(0, 0);
  CHECK(level == Approx(1e-4 / 24).epsilon(0.03));
  CHECK(level - common == Approx(9e-6 / 24).epsilon(0.03));
  CHECK(observed(*basis, directions_of(*basis, *satin()), seen(*satin(), d.frame)).levels == 3);
}

TEST_CASE("What a material does not have is not monitored", "[monitored]") {
  const auto basis = small_basis();
  const auto matt = make_brdf(LambertParameters{{0.5, 0.4, 0.3}});
  const MonitoredDirections d = directions_of(*basis, *matt);
  CHECK(d.names ==
        std::vector<std::string>{"diffuse level R", "diffuse level G", "diffuse level B"});
  CHECK(d.response.cols() == 3);
}

TEST_CASE("Samples on other bins than the taught ones are refused", "[monitored]") {
  const auto basis = small_basis();
  const MonitoredDirections d = directions_of(*basis, *satin());
  BinnedSamples other = seen(*satin(), d.frame);
  other.bins[2].id += 1;
  CHECK(contains(input_error([&] { return observed(*basis, d, other); }), "other bins"));
  BinnedSamples none = seen(*satin(), d.frame);
  for (Bin& bin : none.bins)
    bin.pixels = 0;
  CHECK(contains(input_error([&] { return observed(*basis, d, none); }), "no bin was seen"));
  CHECK(contains(input_error([&] {
                   return monitored_directions(*basis, *satin(), frame(),
                                               Eigen::MatrixXd::Zero(3, 3),
                                               Eigen::MatrixXd::Zero(3, 3));
                 }),
                 "3 reference values for 24 bins"));
}
