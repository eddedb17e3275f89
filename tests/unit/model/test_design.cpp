#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "catch.hpp"
#include "model/design.hpp"
#include "model/design_layouts.hpp"
#include "support/input_error.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kDegree = std::numbers::pi / 180;

const DesignBasis& basis() {
  static const DesignBasis made = make_design_basis(test::small_basis());
  return made;
}

std::vector<HalfDiff> directions(int n) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> u(0, 1);
  std::vector<HalfDiff> some;
  while (static_cast<int>(some.size()) < n) {
    const HalfDiff at{0.9 * u(random), 1.3 * u(random), 3.14 * u(random)};
    if (cosines(at).above_horizon(0.1)) some.push_back(at);
  }
  return some;
}

std::vector<DesignPoint> points_at(const std::vector<HalfDiff>& at) {
  std::vector<DesignPoint> points;
  for (const HalfDiff& a : at)
    points.push_back(make_design_point(basis(), a));
  return points;
}

std::vector<const DesignPoint*> pointers(const std::vector<DesignPoint>& points) {
  std::vector<const DesignPoint*> list;
  for (const DesignPoint& p : points)
    list.push_back(&p);
  return list;
}

/// Q at every cell of the basis: p x k.
MatrixXd whole_q() {
  const BasisGrid& grid = basis().basis->info().grid;
  std::vector<HalfDiff> cells;
  for (int h = 0; h < grid.theta_h; ++h) {
    for (int d = 0; d < grid.theta_d; ++d) {
      for (int p = 0; p < grid.phi_d; ++p) {
        if (basis().basis->row_of(h, d, p)) cells.push_back(grid.centre(h, d, p));
      }
    }
  }
  return design_rows(basis(), cells);
}

/// C.VI eq. 15 as it is printed: every matrix p rows long, the pseudo-inverse by QR, y_i = Q u_i.
ExpectedError printed_equation_15(const MatrixXd& q, const std::vector<Index>& chosen) {
  const auto n = static_cast<Index>(chosen.size());
  const Index k = q.cols();
  MatrixXd sq(n, k);
  for (Index j = 0; j < n; ++j)
    sq.row(j) = q.row(chosen[static_cast<std::size_t>(j)]);
  const MatrixXd sq_eta =
      (sq.transpose() * sq + basis().eta * MatrixXd::Identity(k, k)).inverse() * sq.transpose();
  const Eigen::ColPivHouseholderQR<MatrixXd> q_plus(q);
  ExpectedError error;
  for (Index i = 0; i < basis().u.cols(); ++i) {
    const VectorXd y = q * basis().u.col(i);
    VectorXd sy(n);
    for (Index j = 0; j < n; ++j)
      sy[j] = y[chosen[static_cast<std::size_t>(j)]];
    error.reconstruction += (q * (q_plus.solve(y) - sq_eta * sy)).norm();
  }
  const double cells = std::sqrt(static_cast<double>(q.rows()));
  error.reconstruction /= static_cast<double>(basis().u.cols()) * cells;
  error.noise_gain = (q * (sq_eta * VectorXd::Ones(n))).norm() / cells;
  return error;
}

}  // namespace

TEST_CASE("The expected error in k dimensions is that of C.VI eq. 15 in p dimensions") {
  const MatrixXd q = whole_q();
  REQUIRE(q.rows() == static_cast<Index>(basis().basis->info().valid_cells));
  for (const int n : {1, 5, 40}) {
    std::vector<Index> chosen;
    MatrixXd rows(n, q.cols());
    for (int j = 0; j < n; ++j) {
      chosen.push_back((j * 379 + 11) % q.rows());
      rows.row(j) = q.row(chosen.back());
    }
    const ExpectedError ours = expected_error(basis(), Information::of(rows));
    const ExpectedError theirs = printed_equation_15(q, chosen);
    INFO("n = " << n);
    // The file keeps Q in half floats: |Q z| and |S z| differ by their rounding.
    CHECK(ours.reconstruction == Approx(theirs.reconstruction).epsilon(2e-3));
    CHECK(ours.noise_gain == Approx(theirs.noise_gain).epsilon(2e-3));
  }
}

TEST_CASE("Few points have the same expected error by n x n work as by k x k work") {
  for (const int n : {1, 2, 5, 11, 20}) {
    const std::vector<HalfDiff> at = directions(n);
    const std::vector<DesignPoint> points = points_at(at);
    const ExpectedError small = expected_error(basis(), pointers(points));
    const ExpectedError large = expected_error(basis(), Information::of(design_rows(basis(), at)));
    INFO("n = " << n);
    CHECK(small.reconstruction == Approx(large.reconstruction).epsilon(1e-9));
    CHECK(small.noise_gain == Approx(large.noise_gain).epsilon(1e-9));
  }
}

TEST_CASE("Knowing nothing leaves the materials' own spread, knowing everything leaves nothing") {
  const Index k = basis().components();
  const ExpectedError nothing = expected_error(basis(), Information::none(k));
  CHECK(nothing.reconstruction ==
        Approx((basis().s.asDiagonal() * basis().u).colwise().norm().mean()));
  CHECK(nothing.noise_gain == 0);
  Information everything = Information::none(k);
  everything.gram.diagonal().setConstant(1e12);
  everything.rows = 100;
  CHECK(expected_error(basis(), everything).reconstruction < 1e-9);
}

TEST_CASE("Beta weighs the noise term alone") {
  const ExpectedError error =
      expected_error(basis(), Information::of(design_rows(basis(), directions(8))));
  CHECK(error.total(0) == error.reconstruction);
  CHECK(error.total(0.5) == Approx(error.reconstruction + 0.5 * error.noise_gain));
  CHECK(error.noise_gain > 0);
}

TEST_CASE("The information of two images is the sum of theirs") {
  const std::vector<HalfDiff> all = directions(30);
  Information sum = Information::of(design_rows(basis(), {all.begin(), all.begin() + 10}));
  sum += Information::of(design_rows(basis(), {all.begin() + 10, all.end()}));
  const Information together = Information::of(design_rows(basis(), all));
  CHECK(sum.rows == together.rows);
  CHECK(sum.gram.isApprox(together.gram, 1e-12));
  CHECK(sum.sum.isApprox(together.sum, 1e-12));
}

TEST_CASE("The condition number is that of the singular values") {
  for (const int n : {2, 5, 12, 40}) {
    const std::vector<HalfDiff> at = directions(n);
    const MatrixXd q = design_rows(basis(), at);
    const VectorXd s = Eigen::JacobiSVD<MatrixXd>(q).singularValues();
    INFO("n = " << n);
    CHECK(condition_number(Information::of(q)) == Approx(s[0] / s[s.size() - 1]).epsilon(1e-4));
    const std::vector<DesignPoint> points = points_at(at);
    CHECK(condition_number(pointers(points)) == Approx(s[0] / s[s.size() - 1]).epsilon(1e-4));
  }
}

TEST_CASE("The same direction twice has an infinite condition number") {
  std::vector<HalfDiff> at = directions(2);
  at[1] = at[0];
  CHECK(std::isinf(condition_number(Information::of(design_rows(basis(), at)))));
  CHECK(std::isinf(condition_number(Information::none(basis().components()))));
}

TEST_CASE("A design basis refuses an unusable eta and components that are not there") {
  const auto file = basis().basis;
  CHECK(contains(input_error([&] { return make_design_basis(file, 13); }), "components: 13"));
  CHECK(contains(input_error([&] { return make_design_basis(file, -1); }), "components: -1"));
  for (const double eta : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN()}) {
    CHECK(contains(input_error([&] { return make_design_basis(file, 0, eta); }), "eta"));
  }
  CHECK(make_design_basis(file, 4).components() == 4);
}

TEST_CASE("Directions that cannot be measured have no score") {
  CHECK(contains(input_error([&] { return score_points(basis(), {}); }), "at least 1"));
  const HalfDiff below{80 * kDegree, 60 * kDegree, 0};
  const HalfDiff nan{std::numeric_limits<double>::quiet_NaN(), 0, 0};
  CHECK(contains(input_error([&] { return score_points(basis(), {HalfDiff{0, 0.5, 0}, below}); }),
                 "direction 2: lies below the horizon"));
  CHECK(contains(input_error([&] { return score_points(basis(), {nan}); }), "is not finite"));
}
