#include "model/estimators.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <deque>
#include <mutex>

#include "model/error.hpp"
#include "model/example_regression.hpp"
#include "model/observation.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

class RidgeEstimator final : public Estimator {
 public:
  RidgeEstimator(std::shared_ptr<const Basis> basis, double eta)
      : basis_(std::move(basis)), eta_(eta) {}
  std::string name() const override { return "ridge"; }
  Weights estimate(const BinnedSamples& samples) const override {
    return ridge(*basis_, samples, eta_);
  }

 private:
  std::shared_ptr<const Basis> basis_;
  double eta_;
};

bool same(const std::vector<HalfDiff>& a, const std::vector<HalfDiff>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const HalfDiff& x, const HalfDiff& y) {
                      return x.theta_h == y.theta_h && x.theta_d == y.theta_d && x.phi_d == y.phi_d;
                    });
}

/// A value that misses its prediction by more than this many of the material's own misfits is held
/// at that: dust, a glint or a scratch in one bin, not the material. The material's own misfit is
/// told from the median (1.4826 MAD is a normal law's deviation; Huber 1981), between these shares
/// of what left-out training materials have.
constexpr double kOutlier = 3.0;
constexpr double kLeastMisfit = 0.15;
constexpr double kMostMisfit = 1.0;
constexpr int kOutlierRounds = 3;

double median_of(Eigen::ArrayXd values) {
  auto* middle = values.data() + values.size() / 2;
  std::nth_element(values.data(), middle, values.data() + values.size());
  return *middle;
}

/// Observed values, outliers pulled to the edge of what is plausible.
Eigen::MatrixXd hold_outliers(const Eigen::MatrixXd& predicted, const Eigen::VectorXd& misfit,
                              const Eigen::MatrixXd& observed) {
  Eigen::MatrixXd x(observed.rows(), observed.cols());
  for (Index channel = 0; channel < x.cols(); ++channel) {
    const Eigen::ArrayXd expected = predicted.col(channel);
    const Eigen::ArrayXd misses = (observed.col(channel).array() - expected) / misfit.array();
    const double own = std::clamp(1.4826 * median_of(misses.abs()), kLeastMisfit, kMostMisfit);
    x.col(channel) = expected + misses.max(-kOutlier * own).min(kOutlier * own) * misfit.array();
  }
  return x;
}

class ExampleEstimator final : public Estimator {
 public:
  explicit ExampleEstimator(std::shared_ptr<const Basis> basis) : basis_(std::move(basis)) {}
  std::string name() const override { return "gp"; }

  Weights estimate(const BinnedSamples& samples) const override {
    check_samples(samples);
    const auto regression = regression_for(samples.directions());
    const BasisRows& rows = regression->rows();
    const Eigen::MatrixXd x = centred(samples, rows);
    const auto noise = noise_covariance(rows, samples, kRidgeEta);
    Weights w;
    w.rows = static_cast<int>(x.rows());
    w.c.resize(basis_->info().components, samples.channels);
    w.misfit.resize(samples.channels);
    const std::vector<ExampleRegression::Prediction> found = robust(*regression, x);
    for (Index channel = 0; channel < x.cols(); ++channel) {
      const ExampleRegression::Prediction& p = found[static_cast<std::size_t>(channel)];
      w.c.col(channel) = p.c;
      w.misfit[channel] =
          (x.col(channel) - rows.q * p.c).cwiseQuotient(regression->misfit()).squaredNorm() /
          (static_cast<double>(x.rows()) * regression->misfit_limit());
      w.covariance.push_back(p.covariance + noise[static_cast<std::size_t>(channel)]);
    }
    w.channel_correlation = channel_correlation(x);
    w.residual_rms = std::sqrt((x - rows.q * w.c).squaredNorm() / static_cast<double>(x.size()));
    return w;
  }

 private:
  static std::vector<ExampleRegression::Prediction> robust(const ExampleRegression& regression,
                                                           const Eigen::MatrixXd& observed) {
    Eigen::MatrixXd x = observed;
    // Where no value is redundant, none can be told to be bad.
    const int rounds = x.rows() > 2 * regression.rows().q.cols() ? kOutlierRounds : 0;
    for (int round = 0; round < rounds; ++round) {
      const Eigen::MatrixXd predicted = regression.rows().q * regression.mean(x);
      x = hold_outliers(predicted, regression.misfit(), observed);
    }
    return regression.predict(x);
  }

  /// The latest first. Training happens under the lock: two threads that ask for the same
  /// directions train once.
  std::shared_ptr<const ExampleRegression> regression_for(
      const std::vector<HalfDiff>& directions) const {
    constexpr std::size_t kKept = 16;
    const std::scoped_lock lock(mutex_);
    const auto found = std::find_if(kept_.begin(), kept_.end(), [&](const auto& r) {
      return same(r->directions(), directions);
    });
    std::shared_ptr<const ExampleRegression> regression;
    if (found != kept_.end()) {
      regression = *found;
      kept_.erase(found);
    } else {
      regression = std::make_shared<ExampleRegression>(*basis_, directions);
      if (kept_.size() == kKept) kept_.pop_back();
    }
    kept_.push_front(regression);
    return regression;
  }

  std::shared_ptr<const Basis> basis_;
  mutable std::mutex mutex_;
  mutable std::deque<std::shared_ptr<const ExampleRegression>> kept_;
};

}  // namespace

std::vector<std::string> estimator_names() {
  return {"gp", "ridge"};
}

std::shared_ptr<const Estimator> make_estimator(const EstimatorOptions& options,
                                                std::shared_ptr<const Basis> basis) {
  std::string method = options.method;
  if (method.empty()) method = basis->exemplars().empty() ? "ridge" : "gp";
  if (method == "ridge") return std::make_shared<RidgeEstimator>(std::move(basis), options.eta);
  if (method != "gp") throw InputError("method", "'" + method + "' is unknown", "gp or ridge");
  if (basis->exemplars().empty()) {
    throw InputError("method gp", "the basis has no exemplars",
                     "one from brdfgate basis build with --exemplars over 0, or --method ridge");
  }
  return std::make_shared<ExampleEstimator>(std::move(basis));
}

}  // namespace brdfgate
