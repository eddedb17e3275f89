#include <cmath>
#include <limits>

#include "catch.hpp"
#include "model/reconstruction.hpp"
#include "support/input_error.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;

namespace {

const std::shared_ptr<const Basis>& basis() {
  static const auto made = test::small_basis();
  return made;
}

Weights some_weights(Eigen::Index channels) {
  Weights w;
  w.c = Eigen::MatrixXd::Zero(12, channels);
  w.c(0, 0) = 0.15;
  w.c(2, 0) = -0.1;
  if (channels == 3) {
    w.c(1, 1) = 0.2;
    w.c(4, 2) = 0.05;
  }
  return w;
}

}  // namespace

TEST_CASE("a material of weights is the basis' reconstruction in every direction") {
  const Weights w = some_weights(3);
  const BrdfPtr brdf = make_brdf(basis(), w);
  const std::vector<HalfDiff> at{
      {0.0, 0.4, 0.0}, {0.02, 0.9, 1.0}, {0.4, 0.3, 2.5}, {1.3, 0.1, 1.5}};
  for (int channel = 0; channel < 3; ++channel) {
    const Eigen::VectorXd f = basis()->reconstruct(w.c.col(channel), at);
    for (std::size_t i = 0; i < at.size(); ++i) {
      CHECK(brdf->eval(at[i])[channel] ==
            Approx(f[static_cast<Eigen::Index>(i)]).epsilon(1e-4).margin(1e-8));
    }
  }
}

TEST_CASE("mono weights give three equal channels") {
  const BrdfPtr brdf = make_brdf(basis(), some_weights(1));
  const Rgb f = brdf->eval({0.1, 0.5, 1.0});
  CHECK(f[0] == f[1]);
  CHECK(f[1] == f[2]);
  CHECK(f[0] == Approx(make_brdf(basis(), some_weights(3))->eval({0.1, 0.5, 1.0})[0]));
  CHECK(contains(input_error([] { return make_brdf(basis(), some_weights(2)); }), "2 channels"));
}

TEST_CASE("the diffuse part is under the reconstruction wherever theta_h is below 60 degrees") {
  const BrdfPtr brdf = make_brdf(basis(), some_weights(3));
  const BasisGrid grid = basis()->info().grid;
  bool touched = false;
  for (int h = 0; grid.centre(h, 0, 0).theta_h < 1.047; ++h) {
    for (int p = 0; p < grid.phi_d; ++p) {
      if (!basis()->row_of(h, 4, p)) continue;
      const HalfDiff at = grid.centre(h, 4, p);
      const Rgb specular = brdf->specular(at);
      CHECK((specular > -1e-6).all());
      touched = touched || specular[0] < 1e-6;
    }
  }
  CHECK(touched);  // a minimum is taken somewhere
}

TEST_CASE("tabulate fills every cell above the horizon and only those") {
  const MerlTable table = tabulate(*basis(), some_weights(3));
  std::size_t wrong = 0;
  for (int h = 0; h < MerlFormat::kThetaH; ++h) {
    for (int d = 0; d < MerlFormat::kThetaD; ++d) {
      for (int p = 0; p < MerlFormat::kPhiD; ++p) {
        const bool above = cosines(MerlFormat::centre(h, d, p)).above_horizon();
        for (const auto& channel : table.f) {
          const double f = channel[MerlFormat::cell(h, d, p)];
          wrong += above ? (std::isfinite(f) && f >= 0 ? 0 : 1) : (f == -1 ? 0 : 1);
        }
      }
    }
  }
  CHECK(wrong == 0);
  const HalfDiff at = MerlFormat::centre(10, 20, 30);
  const BrdfPtr brdf = make_brdf(basis(), some_weights(3));
  CHECK(table.f[1][MerlFormat::cell(10, 20, 30)] == Approx(brdf->eval(at)[1]));
}

TEST_CASE("weights beyond anything measured still make a table without infinities") {
  Weights wild = some_weights(3);
  wild.c *= 1000;
  const MerlTable table = tabulate(*basis(), wild);
  for (const auto& channel : table.f) {
    for (const double f : channel) {
      if (!std::isfinite(f)) FAIL("a cell is " << f);
    }
  }
  wild.c(0, 0) = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(input_error([&] { return tabulate(*basis(), wild); }), "finite"));
}
