// Time of the expected error of one candidate (C.VI eq. 15) at k = 60 components, m = 300 training
// observations and 200 directions, against the same equation as it is printed: p rows long.
//
//   build target bench_design, then: bench_design [basis file]
//
// With a basis file also the time of looking up the candidate's rows in it.
#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <random>

#include "model/design.hpp"

using namespace brdfgate;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr Index kComponents = 60, kObservations = 300, kDirections = 200;
constexpr Index kCells = 20'000;  // MERL has 1,458,000: the printed form takes that much longer

double least_ms(int repeats, const std::function<void()>& work) {
  double best = HUGE_VAL;
  for (int i = 0; i < repeats; ++i) {
    const auto start = std::chrono::steady_clock::now();
    work();
    const std::chrono::duration<double, std::milli> t = std::chrono::steady_clock::now() - start;
    best = std::min(best, t.count());
  }
  return best;
}

MatrixXd gaussian(Index rows, Index cols, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  return MatrixXd::NullaryExpr(rows, cols, [&] { return normal(random); });
}

MatrixXd orthonormal(Index rows, Index cols, unsigned seed) {
  const Eigen::HouseholderQR<MatrixXd> qr(gaussian(rows, cols, seed));
  return qr.householderQ() * MatrixXd::Identity(rows, cols);
}

/// C.VI eq. 15 with p-dimensional vectors, all observations at once.
double printed_form(const DesignBasis& basis, const MatrixXd& q, const MatrixXd& rows) {
  MatrixXd regularised = rows.transpose() * rows;
  regularised.diagonal().array() += basis.eta;
  const MatrixXd m = regularised.llt().solve(rows.transpose());
  const MatrixXd missed = q * (basis.u - m * (rows * basis.u));
  return missed.colwise().norm().mean() / std::sqrt(static_cast<double>(q.rows()));
}

}  // namespace

int main(int argc, char** argv) {
  DesignBasis basis;
  basis.u = orthonormal(kObservations, kComponents, 1).transpose();
  VectorXd s(kComponents);  // falls as that of the MERL materials does
  for (Index i = 0; i < kComponents; ++i)
    s[i] = 18 * std::sqrt(static_cast<double>(kCells)) * std::pow(static_cast<double>(i + 1), -1.3);
  const MatrixXd q = orthonormal(kCells, kComponents, 2) * s.asDiagonal();
  basis.s = s / std::sqrt(static_cast<double>(kCells));
  MatrixXd rows(kDirections, kComponents);
  for (Index j = 0; j < kDirections; ++j)
    rows.row(j) = q.row(j * (kCells / kDirections));

  double ours = 0;
  double printed = 0;
  const double ours_ms =
      least_ms(51, [&] { ours = expected_error(basis, Information::of(rows)).reconstruction; });
  const double printed_ms = least_ms(3, [&] { printed = printed_form(basis, q, rows); });
  std::printf("expected error, k x k work: %.3f ms\n", ours_ms);
  std::printf("as printed, p = %ld: %.1f ms, %.0f times as long; the values differ by %.1e\n",
              static_cast<long>(kCells), printed_ms, printed_ms / ours_ms,
              std::abs(ours / printed - 1));

  basis.unseen = (basis.s.asDiagonal() * basis.u).colwise().squaredNorm().transpose();
  if (argc > 1) {
    const DesignBasis real = make_design_basis(Basis::open(argv[1]));
    std::vector<HalfDiff> directions;
    for (Index j = 0; j < kDirections; ++j)
      directions.push_back({0.003 * static_cast<double>(j), 0.9, 0.015 * static_cast<double>(j)});
    const double ms = least_ms(51, [&] {
      ours = expected_error(real, Information::of(design_rows(real, directions))).reconstruction;
    });
    std::printf("with looking up the rows in a basis of %ld components: %.3f ms\n",
                static_cast<long>(real.components()), ms);
  }
  return std::isfinite(ours) ? 0 : 1;
}
