#include <algorithm>
#include <cmath>

#include "catch.hpp"
#include "model/estimators.hpp"
#include "model/lobes.hpp"
#include "model/prediction.hpp"
#include "model/validation.hpp"
#include "support/input_error.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;

namespace {

Bin bin(const HalfDiff& angles, double f) {
  Bin b;
  b.angles = angles;
  b.f.setConstant(f);
  return b;
}

BinnedSamples seen(const Lobe& lobe) {
  return observe_exactly(*make_brdf(lobe));
}

const PredictionError& of(const std::vector<PredictionError>& errors, const std::string& method) {
  const auto found = std::find_if(errors.begin(), errors.end(),
                                  [&](const PredictionError& e) { return e.method == method; });
  REQUIRE(found != errors.end());
  return *found;
}

/// Every fifteenth direction: twenty of the rig's 298.
std::vector<std::size_t> twenty() {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < 20; ++i)
    indices.push_back(i * 15);
  return indices;
}

}  // namespace

TEST_CASE("the nearest neighbour is near in theta_h at the peak and knows phi_d's period") {
  BinnedSamples known;
  known.bins = {bin({0.001, 0.8, 0.1}, 1), bin({0.05, 0.8, 0.1}, 2), bin({0.5, 0.8, 1.5}, 3),
                bin({0.5, 0.8, 0.1}, 4)};
  const auto at = [&](const HalfDiff& angles) { return nearest_neighbour(known, {angles})[0][1]; };
  for (std::size_t i = 0; i < known.bins.size(); ++i)
    CHECK(at(known.bins[i].angles) == known.bins[i].f[1]);
  // Half way in angle between 0.001 and 0.05 is nearer to 0.05 in the root.
  CHECK(at({0.0255, 0.8, 0.1}) == 2);
  // phi_d of 3.1 is 0.14 away from 0.1 over the period, 1.6 from 1.5.
  CHECK(at({0.5, 0.8, 3.1}) == 4);
}

TEST_CASE("a model predicts its own material from twenty directions, the others do not") {
  const Lobe truth{LobeModel::ggx, {0.1, 0.3, 0.6}, {0.08, 0.05, 0.04}, {0.2}};
  const auto errors = predict_the_others(test::small_basis(), seen(truth), twenty());
  CHECK(errors.size() == estimator_names().size() + 2 * lobe_models().size() + 1);
  CHECK(of(errors, "ggx (L1)").mapped_rms < 0.01);
  CHECK(of(errors, "ggx (L2)").mapped_rms < 0.1);
  CHECK(of(errors, "lambert (L1)").mapped_rms > 0.3);
  CHECK(of(errors, "nearest neighbour").mapped_rms > 0.05);
  const PredictionError& ridge = of(errors, "ridge");
  CHECK(ridge.failed.empty());
  CHECK(ridge.mapped_rms > of(errors, "ggx (L1)").mapped_rms);
  CHECK(ridge.mapped_rms ==
        Approx((ridge.channels[0] + ridge.channels[1] + ridge.channels[2]) / 3));
  CHECK(ridge.median <= 2 * ridge.mapped_rms);
}

TEST_CASE("a constant material is predicted exactly by its nearest neighbour") {
  const Lobe truth{LobeModel::lambert, {0.1, 0.3, 0.6}, Rgb::Zero(), {}};
  const auto errors = predict_the_others(test::small_basis(), seen(truth), {7});
  CHECK(of(errors, "nearest neighbour").mapped_rms == 0);
  CHECK(of(errors, "lambert (L1)").mapped_rms < 1e-3);
}

TEST_CASE("mono lists are predicted in their one channel") {
  BinnedSamples mono = seen({LobeModel::ggx, {0.1, 0.3, 0.6}, {0.08, 0.05, 0.04}, {0.2}});
  mono.channels = 1;
  for (const PredictionError& e : predict_the_others(test::small_basis(), mono, twenty())) {
    INFO(e.method);
    CHECK(e.mapped_rms == e.channels[0]);
    CHECK(e.channels[2] == 0);
  }
}

TEST_CASE("prediction refuses lists it cannot split") {
  const auto basis = test::small_basis();
  BinnedSamples samples = seen({LobeModel::lambert, {0.1, 0.3, 0.6}, Rgb::Zero(), {}});
  const auto message = [&](const std::vector<std::size_t>& known) {
    return input_error([&] { return predict_the_others(basis, samples, known).size(); });
  };
  CHECK(contains(message({300}), "index 300; expected below 298"));
  samples.bins.resize(2);
  CHECK(contains(message({0, 1}), "none is left to predict"));
  samples.bins[0].f[0] = std::nan("");
  CHECK(contains(message({1}), "bin 0: channel 0 is nan"));
}
