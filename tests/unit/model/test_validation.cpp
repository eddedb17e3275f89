#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "catch.hpp"
#include "model/analytic.hpp"
#include "model/mapping.hpp"
#include "model/reconstruction.hpp"
#include "model/validation.hpp"
#include "support/input_error.hpp"
#include "support/merl_files.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;

TEST_CASE("The validation rig has the literature's 298 rows") {
  const BinnedSamples samples = observe_exactly(*make_brdf(LambertParameters{Rgb(0.1, 0.2, 0.3)}));
  CHECK(samples.bins.size() == 298);
  for (const Bin& bin : samples.bins) {
    CHECK(cosines(bin.angles).above_horizon());
    CHECK(bin.f[2] == Approx(0.3 / std::numbers::pi));
  }
}

TEST_CASE(
    "Light 1 shows the peak at the centre of the view and light 2 half the angle between light and "
    "camera") {
  ValidationRig rig;
  rig.lattice = 3;  // corners fall off the disc: the centre and four rim points
  const BinnedSamples samples = observe_exactly(*make_brdf(LambertParameters{}), rig);
  REQUIRE(samples.bins.size() == 10);
  const double degree = std::numbers::pi / 180;
  CHECK(samples.bins[2].angles.theta_h == Approx(0).margin(1e-9));
  CHECK(samples.bins[2].angles.theta_d == Approx(55 * degree));
  CHECK(samples.bins[7].angles.theta_h == Approx(37.5 * degree));
  CHECK(samples.bins[7].angles.theta_d == Approx(17.5 * degree));
}

TEST_CASE("the reconstruction error is the mapped distance of prediction and truth, cell by cell") {
  const auto basis = test::small_basis();
  const auto truth = make_brdf(LambertParameters{Rgb(0.1, 0.2, 0.6)});
  Weights w;
  w.c = Eigen::MatrixXd::Constant(12, 3, 0.03);
  const BasisGrid grid{9, 7, 5};
  std::vector<HalfDiff> cells;
  for (int h = 0; h < 9; ++h) {
    for (int d = 0; d < 7; ++d) {
      for (int p = 0; p < 5; ++p) {
        if (cosines(grid.centre(h, d, p)).above_horizon(0.02)) {
          cells.push_back(grid.centre(h, d, p));
        }
      }
    }
  }
  const BasisRows rows = basis->rows(cells);
  const Eigen::VectorXd x = rows.q * w.c.col(0) + rows.mean;
  const ReconstructionError error = reconstruction_error(*truth, *basis, w, grid);
  CHECK(error.cells == cells.size());
  for (Eigen::Index channel = 0; channel < 3; ++channel) {
    double sum = 0;
    for (Eigen::Index j = 0; j < x.size(); ++j) {
      const double f = truth->eval(cells[static_cast<std::size_t>(j)])[channel];
      sum += std::pow(x[j] - to_mapped(f, rows.median[j], rows.weight[j]), 2);
    }
    CHECK(error.per_channel[static_cast<std::size_t>(channel)] ==
          Approx(std::sqrt(sum / static_cast<double>(x.size()))).epsilon(1e-5));
  }
  CHECK(error.mapped_rms ==
        Approx((error.per_channel[0] + error.per_channel[1] + error.per_channel[2]) / 3));
}

TEST_CASE("a material of the basis is reconstructed with a small error, a stranger with a larger") {
  const auto basis = test::small_basis(26);
  const auto own = test::small_training_set()[5].brdf;
  GgxParameters p;
  p.diffuse = Rgb(0.3, 0.0, 0.1);
  p.f0 = Rgb(0.9, 0.2, 0.04);
  p.alpha = 0.6;
  const auto stranger = make_brdf(p);
  const auto error_of = [&](const BrdfPtr& truth) {
    const Weights w = ridge(*basis, observe_exactly(*truth), 1e-3);
    // On the basis' own cells: nothing is interpolated but the observations' rows.
    return reconstruction_error(*truth, *basis, w, basis->info().grid).mapped_rms;
  };
  CHECK(error_of(own) < error_of(stranger));
}

TEST_CASE("the error on 45 x 45 x 45 cells is that of comparing whole tables") {
  const auto basis = test::small_basis();
  const auto truth = test::small_training_set()[6].brdf;
  const Weights w = ridge(*basis, observe_exactly(*truth), kRidgeEta);
  const test::TempDir dir;
  const auto table = MerlBrdf::open(test::write_merl_file(dir / "truth.binary", *truth));
  const double whole = compare(tabulate(*basis, w), *table).mapped_rms;
  CHECK(reconstruction_error(*table, *basis, w).mapped_rms == Approx(whole).epsilon(0.02));
}

TEST_CASE("weights that are not the basis' have no error but an exception") {
  const auto basis = test::small_basis();
  const auto truth = make_brdf(LambertParameters{});
  Weights w;
  w.c = Eigen::MatrixXd::Zero(11, 3);
  CHECK(contains(input_error([&] { return reconstruction_error(*truth, *basis, w); }), "11"));
  w.c = Eigen::MatrixXd::Constant(12, 3, std::nan(""));
  CHECK(contains(input_error([&] { return reconstruction_error(*truth, *basis, w); }), "finite"));
  w.c = Eigen::MatrixXd::Zero(12, 1);
  const ReconstructionError mono = reconstruction_error(*truth, *basis, w);
  CHECK(mono.per_channel[0] == Approx(mono.per_channel[2]));
}

TEST_CASE("folds are a partition of equal parts that the seed decides") {
  const std::vector<int> a = assign_folds(100, 6, 1);
  REQUIRE(a.size() == 100);
  for (int fold = 0; fold < 6; ++fold) {
    const auto size = std::count(a.begin(), a.end(), fold);
    CHECK((size == 16 || size == 17));
  }
  CHECK(a == assign_folds(100, 6, 1));
  CHECK(a != assign_folds(100, 6, 2));
  std::vector<int> each = assign_folds(5, 5, 3);
  std::sort(each.begin(), each.end());
  CHECK(each == std::vector<int>{0, 1, 2, 3, 4});
  CHECK(contains(input_error([] { return assign_folds(5, 6, 1); }), "6 for 5"));
  CHECK(contains(input_error([] { return assign_folds(5, 1, 1); }), "folds"));
}

TEST_CASE("quantiles run linearly between ranks") {
  const ErrorSummary s = summarise({5, 1, 4, 2});
  CHECK(s.mean == Approx(3));
  CHECK(s.median == Approx(3));
  CHECK(s.p90 == Approx(4.7));
  CHECK(summarise({2}).p90 == 2);
  CHECK(summarise({}).mean == 0);
}
