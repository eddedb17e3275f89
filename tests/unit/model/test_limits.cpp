#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>
#include <random>

#include "catch.hpp"
#include "model/limits.hpp"

using namespace brdfgate;

namespace {

Eigen::MatrixXd normals(int rows, const Eigen::VectorXd& deviations, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd x(rows, deviations.size());
  for (Eigen::Index i = 0; i < x.rows(); ++i) {
    for (Eigen::Index j = 0; j < x.cols(); ++j)
      x(i, j) = deviations[j] * normal(random);
  }
  return x;
}

Eigen::VectorXd halving(int p) {
  Eigen::VectorXd d(p);
  for (int i = 0; i < p; ++i)
    d[i] = std::pow(0.5, i);
  return d;
}

/// Ledoit and Wolf's lemmas word by word, with every outer product formed.
Eigen::MatrixXd ledoit_wolf_by_definition(const Eigen::MatrixXd& observations) {
  const Eigen::MatrixXd x = observations.rowwise() - observations.colwise().mean();
  const double n = static_cast<double>(x.rows()), p = static_cast<double>(x.cols());
  const auto norm2 = [p](const Eigen::MatrixXd& a) { return (a * a.transpose()).trace() / p; };
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(x.cols(), x.cols());
  const Eigen::MatrixXd s = x.transpose() * x / n;
  const double m = (s * identity).trace() / p;
  const double d2 = norm2(s - m * identity);
  double b2 = 0;
  for (Eigen::Index k = 0; k < x.rows(); ++k)
    b2 += norm2(x.row(k).transpose() * x.row(k) - s) / (n * n);
  b2 = std::min(b2, d2);
  return b2 / d2 * m * identity + (d2 - b2) / d2 * s;
}

}  // namespace

TEST_CASE("Ledoit-Wolf is what its lemmas say, term by term", "[limits]") {
  for (const int n : {2, 3, 10, 50}) {
    for (const int p : {1, 3, 9, 24}) {
      const Eigen::MatrixXd x = normals(n, halving(p), 7u * n + p);
      CAPTURE(n, p);
      const Eigen::MatrixXd s = ledoit_wolf(x);
      if (p > 1) CHECK((s - ledoit_wolf_by_definition(x)).norm() < 1e-12 * s.norm());
      // Shrinking keeps the total variance.
      const Eigen::MatrixXd c = x.rowwise() - x.colwise().mean();
      CHECK(s.trace() == Approx(c.squaredNorm() / n));
    }
  }
}

TEST_CASE("Ledoit-Wolf is regular with fewer parts than weights, and nearer to the truth",
          "[limits]") {
  const Eigen::VectorXd deviations = Eigen::VectorXd::LinSpaced(9, 0.5, 1.0);
  const Eigen::MatrixXd truth = deviations.array().square().matrix().asDiagonal();
  double shrunk_error = 0, sample_error = 0;
  for (unsigned seed = 0; seed < 40; ++seed) {
    const Eigen::MatrixXd x = normals(6, deviations, seed);
    const Eigen::MatrixXd c = x.rowwise() - x.colwise().mean();
    const Eigen::MatrixXd s = ledoit_wolf(x);
    CHECK(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(s).eigenvalues().minCoeff() > 1e-4);
    shrunk_error += (s - truth).squaredNorm();
    sample_error += (c.transpose() * c / 6 - truth).squaredNorm();
  }
  CHECK(shrunk_error < 0.9 * sample_error);
}

TEST_CASE("Ledoit-Wolf turns with the axes and lets many observations speak for themselves",
          "[limits]") {
  const Eigen::MatrixXd x = normals(12, halving(4), 3);
  const Eigen::MatrixXd turn =
      Eigen::HouseholderQR<Eigen::MatrixXd>(normals(4, Eigen::VectorXd::Ones(4), 4)).householderQ();
  CHECK((ledoit_wolf(x * turn) - turn.transpose() * ledoit_wolf(x) * turn).norm() < 1e-12);

  const Eigen::MatrixXd many = normals(20000, halving(4), 5);
  const Eigen::MatrixXd c = many.rowwise() - many.colwise().mean();
  CHECK((ledoit_wolf(many) - c.transpose() * c / 20000).norm() < 1e-3);
}

TEST_CASE("A shrunk covariance does not know the changes' units", "[limits]") {
  const Eigen::MatrixXd x = normals(20, halving(5), 6);
  Eigen::VectorXd units(5);
  units << 1, 1, 1, 30, 0.02;  // the levels' own is theirs together
  for (const int levels : {0, 3}) {
    const Eigen::MatrixXd s = shrunk_covariance(x, levels);
    const Eigen::MatrixXd scaled = shrunk_covariance(x * units.asDiagonal(), levels);
    const Eigen::MatrixXd expected = units.asDiagonal() * s * units.asDiagonal();
    CHECK((scaled - expected).norm() < 1e-12 * expected.norm());
    const Eigen::MatrixXd c = x.rowwise() - x.colwise().mean();
    CHECK(s.trace() == Approx(c.squaredNorm() / 20));
  }
  // A change that never varied stays at 0 and makes nothing else undefined.
  Eigen::MatrixXd still = x;
  still.col(3).setConstant(0.7);
  const Eigen::MatrixXd s = shrunk_covariance(still);
  CHECK(s.allFinite());
  CHECK(s.col(3).norm() < 1e-12);
}

TEST_CASE("Levels that move together do not loosen the colour, whatever else deviates by",
          "[limits]") {
  // Levels of three channels: 0.5 % in common, 0.1 % each; gloss deviates by 6 %.
  Eigen::MatrixXd mix = Eigen::MatrixXd::Zero(5, 5);
  mix.row(0).head(3).setConstant(0.005);
  mix.block(1, 0, 3, 3).diagonal().setConstant(0.001);
  mix(4, 3) = 0.06;
  mix.col(4).setZero();
  mix(4, 4) = 0.01;
  const Eigen::VectorXd contrast = Eigen::Vector<double, 5>(1, -1, 0, 0, 0);
  const double truth = 2 * 1e-6;
  for (const int n : {10, 50}) {
    double own = 0, levels = 0, scaled_identity = 0;
    for (unsigned seed = 0; seed < 40; ++seed) {
      const Eigen::MatrixXd x = normals(n, Eigen::VectorXd::Ones(5), 100 + seed) * mix;
      const auto of = [&](const Eigen::MatrixXd& s) { return contrast.dot(s * contrast) / truth; };
      levels += of(shrunk_covariance(x, 3)) / 40;
      own += of(shrunk_covariance(x)) / 40;
      scaled_identity += of(ledoit_wolf(x)) / 40;
    }
    CAPTURE(n, own, scaled_identity);
    CHECK(levels == Approx(1).epsilon(0.2));
    CHECK(own > 1.5 * levels);
    CHECK(scaled_identity > 5 * levels);
  }
}

TEST_CASE("T^2's limit holds for parts whose levels move together", "[limits]") {
  Eigen::MatrixXd mix = Eigen::MatrixXd::Identity(5, 5) * 0.01;
  mix.row(0).head(3).setConstant(0.05);
  mix(4, 3) = 0.04;
  const Eigen::MatrixXd covariance = mix.transpose() * mix;
  constexpr double kFloor = 0.001, kRate = 0.02;
  for (const int n : {6, 15, 50}) {
    const double limit = t2_limit(covariance, n, kFloor, kRate, 3);
    int beyond = 0;
    constexpr int kRecipes = 300, kFresh = 40;
    for (unsigned seed = 0; seed < kRecipes; ++seed) {
      const Eigen::MatrixXd x = normals(n, Eigen::VectorXd::Ones(5), 1000 + seed) * mix;
      Eigen::MatrixXd s = shrunk_covariance(x, 3);
      s.diagonal().array() += kFloor * kFloor;
      const Eigen::MatrixXd inverse = (s * (1 + 1.0 / n)).inverse();
      const Eigen::MatrixXd fresh =
          (normals(kFresh, Eigen::VectorXd::Ones(5), 5000 + seed) * mix).rowwise() -
          x.colwise().mean();
      for (int i = 0; i < kFresh; ++i)
        beyond += fresh.row(i) * inverse * fresh.row(i).transpose() > limit;
    }
    CAPTURE(n, limit);
    CHECK(beyond / double(kRecipes * kFresh) == Approx(kRate).margin(0.006));
  }
}

TEST_CASE("With the covariance known, T^2's limit is chi-square's", "[limits]") {
  struct Row {
    int p;
    double rate, quantile;  // chi-square tables
  };
  for (const Row& row : {Row{1, 0.01, 6.635},
                         {3, 0.01, 11.345},
                         {9, 0.01, 21.666},
                         {9, 0.001, 27.877},
                         {24, 0.01, 42.980}}) {
    CAPTURE(row.p, row.rate);
    const Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(row.p, row.p);
    for (const int parts : {1, 2})
      CHECK(t2_limit(covariance, parts, 0.02, row.rate) == Approx(row.quantile).epsilon(0.06));
  }
}

TEST_CASE("T^2's limit falls to chi-square's as parts are added and rises with strictness",
          "[limits]") {
  const Eigen::MatrixXd covariance = Eigen::Vector3d(0.04, 0.01, 0.0025).asDiagonal();
  double last = 1e9;
  for (const int parts : {5, 10, 25, 100}) {
    const double limit = t2_limit(covariance, parts, 0.001, 0.01);
    CHECK(limit < last);
    CHECK(limit > 0.97 * 11.345);
    CHECK(t2_limit(covariance, parts, 0.001, 0.001) > limit);
    CHECK(t2_limit(covariance, parts, 0.001, 0.01) == limit);  // seeded
    last = limit;
  }
  // Without shrinkage it would be Hotelling's p N / (N - p) F(p, N - p) (the covariance being of N,
  // and 1 + 1/N in T^2); F(0.99; 3, 97) = 3.99. Shrinkage only lowers it, toward chi-square's.
  CHECK(last < 3 * 100 / 97.0 * 3.99);
}

TEST_CASE("Box's degrees of freedom count the patterns that residuals share", "[limits]") {
  const auto centred = [](const Eigen::MatrixXd& x) {
    return Eigen::MatrixXd(x.rowwise() - x.colwise().mean());
  };
  const int columns = 200;
  double one = 0, four = 0, all = 0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    // Orthogonal patterns of equal strength: h is their number.
    Eigen::MatrixXd patterns = Eigen::MatrixXd::Zero(4, columns);
    for (int j = 0; j < columns; ++j)
      patterns(j % 4, j) = 1;
    const Eigen::MatrixXd amplitudes = normals(15, Eigen::VectorXd::Ones(4), seed);
    one += box_dof(centred(amplitudes.leftCols(1) * Eigen::MatrixXd::Ones(1, columns))) / 20;
    four += box_dof(centred(amplitudes * patterns)) / 20;
    all += box_dof(centred(normals(15, Eigen::VectorXd::Ones(columns), seed))) / 20;
  }
  CHECK(one == Approx(1).epsilon(0.25));
  CHECK(four == Approx(4).epsilon(0.25));
  CHECK(all > 0.5 * columns);
}

TEST_CASE("SPE's limit is the F table's, scaled to its leave-one-out mean, never under its floor",
          "[limits]") {
  // F(0.99; h, h (N - 1)) over the mean of that F.
  CHECK(spe_limit(1, 1, 10, 0.01) == Approx(10.56 * 7 / 9).epsilon(0.06));
  CHECK(spe_limit(1, 1, 10001, 0.01) == Approx(6.635).epsilon(0.04));
  CHECK(spe_limit(1, 10, 10001, 0.01) == Approx(2.321).epsilon(0.03));
  CHECK(spe_limit(1, 10, 13, 0.01) == Approx(2.47 * 118 / 120).epsilon(0.03));
  CHECK(spe_limit(3, 10, 10001, 0.01) == Approx(3 * 2.321).epsilon(0.03));
  CHECK(spe_limit(0.1, 10, 25, 0.01) == kLeastSpeLimit);
  CHECK(spe_limit(1, 500, 25, 0.01) == kLeastSpeLimit);
}
