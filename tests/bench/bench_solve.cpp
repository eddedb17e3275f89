// Time of one cluster's solve, weights and posterior: 200 binned directions, three channels, 1 %
// pixel noise, one core, by `ridge` and by `gp` once it is trained; and the time of its training
// for new directions. Each beside the same result got the plain way, in this run.
//
//   build target bench_solve, then: bench_solve BASIS
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <opencv2/core/utility.hpp>

#include "model/analytic.hpp"
#include "model/error.hpp"
#include "model/estimators.hpp"
#include "model/validation.hpp"
#include "support/simple_regression.hpp"

using namespace brdfgate;

namespace {

constexpr int kDirections = 200;

/// Processor time of this one thread, so that a busy machine does not count.
double least_ms(int repeats, const std::function<void()>& work) {
  double best = HUGE_VAL;
  for (int i = 0; i < repeats; ++i) {
    const std::clock_t start = std::clock();
    work();
    best = std::min(best, 1e3 * double(std::clock() - start) / CLOCKS_PER_SEC);
  }
  return best;
}

BinnedSamples some_material() {
  GgxParameters p;
  p.diffuse = Rgb(0.3, 0.2, 0.1);
  p.f0 = Rgb::Constant(0.05);
  p.alpha = 0.15;
  BinnedSamples all = observe_exactly(*make_brdf(p));
  BinnedSamples some;
  for (int i = 0; i < kDirections; ++i)
    some.bins.push_back(all.bins[all.bins.size() * std::size_t(i) / kDirections]);
  for (Bin& bin : some.bins)
    bin.variance = (0.01 * bin.f).square();
  return some;
}

/// Ridge as the least-squares solution of the augmented system, channel by channel, with its
/// posterior by plain inversion.
Eigen::MatrixXd plain_ridge(const Basis& basis, const BinnedSamples& samples) {
  const Eigen::Index k = basis.info().components;
  Eigen::MatrixXd c(k, 3);
  for (Eigen::Index channel = 0; channel < 3; ++channel) {
    const BasisRows rows = basis.rows(samples.directions());
    Eigen::MatrixXd a(rows.q.rows() + k, k);
    a << rows.q, std::sqrt(kRidgeEta) * Eigen::MatrixXd::Identity(k, k);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(a.rows());
    b.head(rows.q.rows()) = centred(samples, rows).col(channel);
    c.col(channel) = a.colPivHouseholderQr().solve(b);
    const Eigen::MatrixXd posterior = (a.transpose() * a).inverse();
    if (!posterior.allFinite()) throw InputError("basis", "has no posterior");
  }
  return c;
}

void report(const char* what, double ms, double plain_ms) {
  std::printf("%-22s %8.3f ms   the plain way %9.3f ms, %.1f times as long\n", what, ms, plain_ms,
              plain_ms / ms);
}

int run(const std::shared_ptr<const Basis>& basis) {
  const BinnedSamples samples = some_material();
  std::printf("%d directions, 3 channels, k = %d, %d examples, one thread\n", kDirections,
              basis->info().components, basis->info().exemplars + basis->info().observations);
  const double prior = std::sqrt(double(basis->info().observations));

  const auto papers = make_estimator({"ridge"}, basis);
  Eigen::MatrixXd ours;
  Eigen::MatrixXd plain;
  const double ridge_ms = least_ms(101, [&] { ours = papers->estimate(samples).c; });
  report("ridge", ridge_ms, least_ms(11, [&] { plain = plain_ridge(*basis, samples); }));
  double worst = (ours - plain).cwiseAbs().maxCoeff() * prior;

  std::unique_ptr<ExampleRegression> regression;
  std::unique_ptr<test::SimpleRegression> simple;
  const std::vector<HalfDiff> directions = samples.directions();
  const double training_ms =
      least_ms(5, [&] { regression = std::make_unique<ExampleRegression>(*basis, directions); });
  report("gp, training", training_ms, least_ms(1, [&] {
           simple = std::make_unique<test::SimpleRegression>(*basis, directions);
         }));
  const Eigen::MatrixXd x = centred(samples, regression->rows());
  const double mean_ms = least_ms(101, [&] { ours = regression->mean(x); });
  report("gp, the mean alone", mean_ms, least_ms(5, [&] {
           for (Eigen::Index channel = 0; channel < 3; ++channel)
             plain.col(channel) = simple->mean(x.col(channel));
         }));
  worst = std::max(worst, (ours - plain).cwiseAbs().maxCoeff() * prior);
  const auto own = make_estimator({"gp"}, basis);
  own->estimate(samples);
  const double gp_ms = least_ms(101, [&] { own->estimate(samples); });
  std::printf("%-22s %8.3f ms   robust, with posterior and pixel noise\n", "gp", gp_ms);
  std::printf("weights differ by at most %.1e prior deviations\n", worst);
  return worst < 3e-2 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: bench_solve BASIS\n");
    return 2;
  }
  cv::setNumThreads(1);
  return run(Basis::open(argv[1]));
}
