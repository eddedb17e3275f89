#include "model/pose_estimate.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "model/error.hpp"
#include "model/estimator.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

/// Ridge parameter of the weights inside the fit and error of one mapped value, both for
/// kReferenceRows rows: under ridge's own 40 and 0.37 the tilt of half the materials is found as
/// well, that of matte ones less often (docs/decisions).
constexpr double kPoseEta = 10;
constexpr double kPoseError = 0.2;
constexpr double kReferenceRows = 298;
/// Leading components in the fit.
constexpr Index kPoseComponents = 30;
/// What a value counts with in the stated covariance, in place of the fit's own error squared: this
/// share of it, and the residuals' mean square times the rest per channel. A material unlike the
/// basis leaves more residual than one like it, and neighbouring directions and the channels of one
/// material err alike. Two deviations then hold 93 to 96 % of the tilts (docs/accuracy.md).
constexpr double kErrorShare = 0.25;
constexpr double kErrsAlike = 64.0 / 3;

using Parameters = Eigen::Vector3d;  // tilt_x, tilt_y, height in units of their prior deviations

class PoseProblem {
 public:
  PoseProblem(const Basis& basis, const PoseSamples& samples, const PosePrior& prior)
      : basis_(basis),
        samples_(samples),
        scale_(prior.tilt_sigma, prior.tilt_sigma, prior.height_sigma_m) {}

  PartPose pose(const Parameters& p) const {
    return {p[0] * scale_[0], p[1] * scale_[1], p[2] * scale_[2]};
  }
  const Eigen::Vector3d& scale() const { return scale_; }
  bool free(Index i) const { return scale_[i] > 0; }

  /// Residuals whose squared norm is minimised: rows x channels, then penalties; empty where a
  /// direction falls below the horizon.
  std::optional<Eigen::VectorXd> residuals(const Parameters& p) const {
    const PartPose at = pose(p);
    std::vector<HalfDiff> directions;
    directions.reserve(samples_.lines.size());
    for (const Sightline& line : samples_.lines) {
      directions.push_back(line.angles(at));
      if (!cosines(directions.back()).above_horizon()) return std::nullopt;
    }
    const BasisRows rows = basis_.rows(directions);
    Eigen::MatrixXd x = mapped(rows, at);
    const auto q = rows.q.leftCols(std::min(kPoseComponents, rows.q.cols()));
    const double share = double(x.rows()) / kReferenceRows;
    const double eta = kPoseEta * share;
    Eigen::MatrixXd normal = q.transpose() * q;
    normal.diagonal().array() += eta;
    const Eigen::MatrixXd c = Eigen::LLT<Eigen::MatrixXd>(normal).solve(q.transpose() * x);
    x -= q * c;
    const double sigma = kPoseError * std::sqrt(share);
    Eigen::VectorXd out(x.size() + c.size() + 3);
    out << x.reshaped() / sigma, std::sqrt(eta) / sigma * c.reshaped(), p;
    return out;
  }

 private:
  Eigen::MatrixXd mapped(const BasisRows& rows, const PartPose& at) const {
    Eigen::MatrixXd x(samples_.f.rows(), samples_.f.cols());
    for (Index j = 0; j < x.rows(); ++j) {
      const Sightline& line = samples_.lines[static_cast<std::size_t>(j)];
      const double received = line.irradiance({}) / line.irradiance(at);
      for (Index channel = 0; channel < x.cols(); ++channel) {
        x(j, channel) =
            to_mapped(samples_.f(j, channel) * received, rows.median[j], rows.weight[j]) -
            rows.mean[j];
      }
    }
    return x;
  }

  const Basis& basis_;
  const PoseSamples& samples_;
  Eigen::Vector3d scale_;
};

struct Fit {
  Parameters p = Parameters::Zero();
  Eigen::VectorXd residuals;
  double cost = std::numeric_limits<double>::infinity();
};

Fit evaluate(const PoseProblem& problem, const Parameters& p) {
  Fit fit;
  fit.p = p;
  if (auto r = problem.residuals(p)) {
    fit.residuals = std::move(*r);
    fit.cost = fit.residuals.squaredNorm();
  }
  return fit;
}

/// J^T J and J^T r by central differences.
struct Normal {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
};
Normal linearise(const PoseProblem& problem, const Fit& at) {
  constexpr double kTiltStep = 3e-4;    // rad, 0.02 deg
  constexpr double kHeightStep = 2e-5;  // m
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(at.residuals.size(), 3);
  Normal normal;
  for (Index i = 0; i < 3; ++i) {
    if (!problem.free(i)) continue;
    const double step = (i < 2 ? kTiltStep : kHeightStep) / problem.scale()[i];
    Parameters above = at.p;
    Parameters below = at.p;
    above[i] += step;
    below[i] -= step;
    const auto up = problem.residuals(above);
    const auto down = problem.residuals(below);
    if (up && down) jacobian.col(i) = (*up - *down) / (2 * step);
  }
  normal.matrix = jacobian.transpose() * jacobian;
  normal.gradient = jacobian.transpose() * at.residuals;
  for (Index i = 0; i < 3; ++i) {
    if (!(normal.matrix(i, i) > 0)) normal.matrix(i, i) = 1;
  }
  return normal;
}

/// The tilt that puts the mirror direction where the brightest samples are, in prior deviations.
Parameters brightest(const PoseProblem& problem, const PoseSamples& samples) {
  const Eigen::VectorXd grey = samples.f.rowwise().mean();
  const double peak = grey.maxCoeff();
  Eigen::Vector3d half = Eigen::Vector3d::Zero();
  for (Index j = 0; j < grey.size(); ++j) {
    if (grey[j] < 0.7 * peak) continue;
    const Sightline& line = samples.lines[static_cast<std::size_t>(j)];
    const Eigen::Vector3d wi = line.light_W.head<3>() - line.light_W[3] * line.point_W;
    half += wi.normalized() + (line.eye_W - line.point_W).normalized();
  }
  half.normalize();
  constexpr double kReach = 3;
  const Eigen::Vector3d& scale = problem.scale();
  const double x = -std::asin(std::clamp(half.y(), -1.0, 1.0)) / scale[0];
  const double y = std::atan2(half.x(), half.z()) / scale[1];
  return {std::clamp(x, -kReach, kReach), std::clamp(y, -kReach, kReach), 0};
}

Fit best_start(const PoseProblem& problem, const PoseSamples& samples) {
  Fit best = evaluate(problem, Parameters::Zero());
  if (!problem.free(0)) return best;
  const Parameters seen = brightest(problem, samples);
  for (const Parameters& start : {seen, Parameters(1.2, 1.2, 0), Parameters(1.2, -1.2, 0),
                                  Parameters(-1.2, 1.2, 0), Parameters(-1.2, -1.2, 0)}) {
    Fit fit = evaluate(problem, start);
    if (fit.cost < best.cost) best = std::move(fit);
  }
  return best;
}

/// Levenberg's damped steps until they are under a thousandth of a prior deviation.
Fit refine(const PoseProblem& problem, Fit fit) {
  constexpr int kSteps = 20;
  constexpr double kSmall = 1e-3;
  double damping = 1e-3;
  for (int i = 0; i < kSteps; ++i) {
    Normal normal = linearise(problem, fit);
    normal.matrix.diagonal() *= 1 + damping;
    const Parameters step = -normal.matrix.ldlt().solve(normal.gradient);
    Fit next = evaluate(problem, fit.p + step);
    if (next.cost < fit.cost) {
      fit = std::move(next);
      damping *= 0.1;
      if (step.norm() < kSmall) break;
    } else {
      damping = std::max(1e-3, damping * 10);
      if (damping > 1e6) break;
    }
  }
  return fit;
}

/// Of the parameters: the prior, and the data as far as the residuals say that they can be
/// believed.
Eigen::Matrix3d covariance_of(const PoseProblem& problem, const Fit& fit, Index values,
                              Index channels) {
  const double mean_square = fit.residuals.head(values).squaredNorm() / double(values);
  const double growth = kErrorShare + kErrsAlike * double(channels) * mean_square;
  Eigen::Matrix3d information = linearise(problem, fit).matrix;
  const Eigen::Matrix3d prior = Eigen::Matrix3d::Identity();  // a parameter held at 0 stays there
  information = (information - prior) / growth + prior;
  const auto scale = problem.scale().asDiagonal();
  return scale * information.inverse() * scale;
}

void check(const PoseSamples& samples, const PosePrior& prior) {
  if (samples.lines.empty() || samples.f.rows() != static_cast<Index>(samples.lines.size())) {
    throw InputError("pose samples",
                     std::to_string(samples.lines.size()) + " sightlines for " +
                         std::to_string(samples.f.rows()) + " values",
                     "one value each, at least one");
  }
  if (!(samples.f.allFinite() && samples.f.minCoeff() >= 0)) {
    throw InputError("pose samples", "hold a negative or non-finite reflectance", "values over 0");
  }
  if (!(prior.tilt_sigma >= 0 && prior.height_sigma_m >= 0)) {
    throw InputError("pose prior", "a negative deviation", "0 or more");
  }
}

}  // namespace

PoseEstimate estimate_pose(const Basis& basis, const PoseSamples& samples, const PosePrior& prior) {
  check(samples, prior);
  const PoseProblem problem(basis, samples, prior);
  const Fit fit = refine(problem, best_start(problem, samples));
  PoseEstimate estimate;
  estimate.pose = problem.pose(fit.p);
  estimate.covariance = covariance_of(problem, fit, samples.f.size(), samples.f.cols());
  return estimate;
}

}  // namespace brdfgate
