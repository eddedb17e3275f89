#include "model/analytic_fit.hpp"

#include <ceres/autodiff_cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/normal_prior.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <string>

#include "model/error.hpp"
#include "model/lobe_formulas.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

/// Below this many mapped units the smoothed L1 norm is quadratic.
constexpr double kSmooth = 0.01;
constexpr int kIterationsPerStage = 60;

/// Parameters as the solver sees them: logarithms, but for the linear ones.
struct Unknowns {
  std::array<double, 3> diffuse{};
  std::array<double, 3> specular{};
  std::array<double, 3> shape{};
};

double inward(const LobeParameter& p, double value) {
  return p.linear ? value : std::log(value);
}

double outward(const LobeParameter& p, double unknown) {
  return std::min(p.linear ? unknown : std::exp(unknown), p.most);
}

/// One observation: ln(f w + e) and its weight 1 / sigma.
struct Target {
  double value;
  double cosine_weight;
  double scale;
};

struct LambertResidual {
  Target target;
  template <typename T>
  bool operator()(const T* diffuse, T* residual) const {
    using std::exp;
    using std::log;
    const T f = exp(diffuse[0]) / lobe::kPi;
    residual[0] = target.scale * (log(f * target.cosine_weight + kMappingEpsilon) - target.value);
    return true;
  }
};

template <typename Formula>
struct LobeResidual {
  Target target;
  lobe::Geometry geometry;
  std::array<bool, 3> linear;

  template <typename T>
  bool operator()(const T* diffuse, const T* specular, const T* unknown, T* residual) const {
    using std::exp;
    using std::log;
    std::array<T, Formula::kShapes> shape;
    for (std::size_t i = 0; i < shape.size(); ++i)
      shape[i] = linear[i] ? unknown[i] : exp(unknown[i]);
    const lobe::Affine<T> value = Formula::template eval<T>(shape.data(), geometry);
    const T f = exp(diffuse[0]) / lobe::kPi + value.offset + value.gain * exp(specular[0]);
    residual[0] = target.scale * (log(f * target.cosine_weight + kMappingEpsilon) - target.value);
    return true;
  }
};

/// One model against one set of samples: the solver's problem and its unknowns.
class Fitter {
 public:
  enum class Norm { l1, gaussian };

  Fitter(LobeModel model, const BinnedSamples& samples, const LobeFitOptions& options, Norm norm)
      : description_(describe(model)),
        samples_(samples),
        observed_(log_observations(samples, options.discrepancy)),
        discrepancy_(options.discrepancy) {
    add_observations(norm);
    set_bounds();
    if (norm == Norm::gaussian) add_priors();
  }

  void start_from(const Unknowns& unknowns) {
    unknowns_ = unknowns;
    for_each([](double* at, const LobeParameter& p) {
      *at = std::clamp(*at, inward(p, p.fit_least), inward(p, p.fit_most));
    });
  }
  const Unknowns& unknowns() const { return unknowns_; }

  /// Minimises over the named groups and holds the rest; the cost reached.
  double solve(bool diffuse, bool specular, bool shape) {
    for (int channel = 0; channel < samples_.channels; ++channel) {
      hold(&unknowns_.diffuse[channel], !diffuse);
      if (has_lobe()) hold(&unknowns_.specular[channel], !specular);
    }
    if (has_lobe()) hold(unknowns_.shape.data(), !shape);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.max_num_iterations = kIterationsPerStage;
    options.function_tolerance = 1e-8;
    options.num_threads = 1;  // sums in one order: the same result everywhere
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    // A step that fails is tried again with more damping: nothing for stderr.
    FLAGS_minloglevel = google::GLOG_ERROR;
    ceres::Solve(options, &problem_, &summary);
    return summary.final_cost;
  }

  LobeFit result() const {
    LobeFit fit;
    fit.lobe.model = description_.model;
    for (int channel = 0; channel < 3; ++channel) {
      const int source = samples_.channels == 1 ? 0 : channel;
      fit.lobe.diffuse[channel] = outward(diffuse_parameter(), unknowns_.diffuse[source]);
      if (!has_lobe()) continue;
      fit.lobe.specular[channel] = outward(description_.specular, unknowns_.specular[source]);
    }
    for (std::size_t i = 0; i < description_.shape.size(); ++i)
      fit.lobe.shape.push_back(outward(description_.shape[i], unknowns_.shape[i]));
    const Eigen::MatrixXd residual = residuals(fit.lobe);
    fit.mapped_l1 = residual.array().abs().mean();
    fit.mapped_rms = std::sqrt(residual.array().square().mean());
    return fit;
  }

  /// Laplace's approximation at the present unknowns, all of them free.
  void add_evidence(LobePosterior& posterior) {
    double cost = 0;
    ceres::CRSMatrix sparse;
    problem_.Evaluate({}, &cost, nullptr, nullptr, &sparse);
    Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(sparse.num_cols, sparse.num_cols);
    for (int row = 0; row < sparse.num_rows; ++row) {
      for (int a = sparse.rows[row]; a < sparse.rows[row + 1]; ++a) {
        for (int b = sparse.rows[row]; b < sparse.rows[row + 1]; ++b)
          hessian(sparse.cols[a], sparse.cols[b]) += sparse.values[a] * sparse.values[b];
      }
    }
    const Eigen::LLT<Eigen::MatrixXd> factor(hessian);
    const double log_det = 2 * Eigen::MatrixXd(factor.matrixL()).diagonal().array().log().sum();
    posterior.parameters = sparse.num_cols;
    posterior.chi_square =
        residuals(posterior.fit.lobe).cwiseQuotient(observed_.sigma).squaredNorm();
    const double normaliser = observed_.sigma.array().log().sum() +
                              0.5 * double(observed_.sigma.size()) * std::log(2 * lobe::kPi);
    posterior.log_evidence = -cost - normaliser - prior_log_spread_ - 0.5 * log_det;
  }

 private:
  bool has_lobe() const { return description_.model != LobeModel::lambert; }

  void hold(double* block, bool constant) {
    if (constant) {
      problem_.SetParameterBlockConstant(block);
    } else {
      problem_.SetParameterBlockVariable(block);
    }
  }

  /// Every unknown in use with its parameter.
  template <typename Action>
  void for_each(Action&& action) {
    for (int channel = 0; channel < samples_.channels; ++channel) {
      action(&unknowns_.diffuse[channel], diffuse_parameter());
      if (has_lobe()) action(&unknowns_.specular[channel], description_.specular);
    }
    for (std::size_t i = 0; i < description_.shape.size(); ++i)
      action(&unknowns_.shape[i], description_.shape[i]);
  }

  void add_observations(Norm norm) {
    std::array<bool, 3> linear{};
    for (std::size_t i = 0; i < description_.shape.size(); ++i)
      linear[i] = description_.shape[i].linear;
    // Residuals of an L1 fit stay in mapped units, but for noisy bins.
    const double unit = norm == Norm::l1 ? discrepancy_ : 1.0;
    loss_ = norm == Norm::l1 ? std::make_unique<ceres::SoftLOneLoss>(kSmooth) : nullptr;
    for (Index j = 0; j < observed_.value.rows(); ++j) {
      const HalfDiff& angles = samples_.bins[static_cast<std::size_t>(j)].angles;
      const lobe::Geometry geometry = lobe::geometry(angles, cosines(angles));
      for (int channel = 0; channel < samples_.channels; ++channel) {
        const Target target{observed_.value(j, channel), observed_.weight[j],
                            unit / observed_.sigma(j, channel)};
        add_observation(channel, target, geometry, linear);
      }
    }
  }

  void add_observation(int channel, const Target& target, const lobe::Geometry& geometry,
                       const std::array<bool, 3>& linear) {
    double* diffuse = &unknowns_.diffuse[channel];
    if (!has_lobe()) {
      problem_.AddResidualBlock(
          new ceres::AutoDiffCostFunction<LambertResidual, 1, 1>(new LambertResidual{target}),
          loss_.get(), diffuse);
      return;
    }
    lobe::with_formula(description_.model, [&](auto formula) {
      using Formula = decltype(formula);
      using Residual = LobeResidual<Formula>;
      problem_.AddResidualBlock(
          new ceres::AutoDiffCostFunction<Residual, 1, 1, 1, Formula::kShapes>(
              new Residual{target, geometry, linear}),
          loss_.get(), diffuse, &unknowns_.specular[channel], unknowns_.shape.data());
    });
  }

  void set_bounds() {
    const auto bound = [this](double* block, int index, const LobeParameter& p) {
      problem_.SetParameterLowerBound(block, index, inward(p, p.fit_least));
      problem_.SetParameterUpperBound(block, index, inward(p, p.fit_most));
    };
    for (int channel = 0; channel < samples_.channels; ++channel) {
      bound(&unknowns_.diffuse[channel], 0, diffuse_parameter());
      if (has_lobe()) bound(&unknowns_.specular[channel], 0, description_.specular);
    }
    for (std::size_t i = 0; i < description_.shape.size(); ++i)
      bound(unknowns_.shape.data(), static_cast<int>(i), description_.shape[i]);
  }

  void add_prior(double* block, std::span<const LobeParameter> parameters) {
    const auto size = static_cast<Index>(parameters.size());
    ceres::Matrix precision = ceres::Matrix::Zero(size, size);
    ceres::Vector centre(size);
    for (Index i = 0; i < size; ++i) {
      const LobeParameter& p = parameters[static_cast<std::size_t>(i)];
      precision(i, i) = 1 / p.spread;
      centre[i] = inward(p, p.typical);
      prior_log_spread_ += std::log(p.spread);
    }
    problem_.AddResidualBlock(new ceres::NormalPrior(precision, centre), nullptr, block);
  }

  void add_priors() {
    for (int channel = 0; channel < samples_.channels; ++channel) {
      add_prior(&unknowns_.diffuse[channel], {&diffuse_parameter(), 1});
      if (has_lobe()) add_prior(&unknowns_.specular[channel], {&description_.specular, 1});
    }
    if (has_lobe()) add_prior(unknowns_.shape.data(), description_.shape);
  }

  Eigen::MatrixXd residuals(const Lobe& lobe) const {
    const BrdfPtr brdf = make_brdf(lobe);
    Eigen::MatrixXd residual(observed_.value.rows(), observed_.value.cols());
    for (Index j = 0; j < residual.rows(); ++j) {
      const Rgb f = brdf->eval(samples_.bins[static_cast<std::size_t>(j)].angles);
      for (Index channel = 0; channel < residual.cols(); ++channel) {
        residual(j, channel) = std::log(f[channel] * observed_.weight[j] + kMappingEpsilon) -
                               observed_.value(j, channel);
      }
    }
    return residual;
  }

  const LobeDescription& description_;
  const BinnedSamples& samples_;
  LogObservations observed_;
  double discrepancy_;
  double prior_log_spread_ = 0;
  Unknowns unknowns_;
  std::unique_ptr<ceres::LossFunction> loss_;
  ceres::Problem problem_{[] {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }()};
};

/// Where the fit begins: the diffuse level at the samples' lower quartile, all else at its prior.
Unknowns first_guess(const LobeDescription& description, const BinnedSamples& samples) {
  Unknowns guess;
  for (int channel = 0; channel < samples.channels; ++channel) {
    std::vector<double> f;
    for (const Bin& bin : samples.bins)
      f.push_back(bin.f[channel]);
    const auto quartile = f.begin() + static_cast<std::ptrdiff_t>(f.size() / 4);
    std::nth_element(f.begin(), quartile, f.end());
    const double level = std::clamp(lobe::kPi * *quartile, 1e-4, 1.0);
    guess.diffuse[channel] = inward(diffuse_parameter(), level);
    guess.specular[channel] = inward(description.specular, description.specular.typical);
  }
  for (std::size_t i = 0; i < description.shape.size(); ++i)
    guess.shape[i] = inward(description.shape[i], description.shape[i].typical);
  return guess;
}

/// C.I's three stages, and ours; the cost reached.
double run_stages(Fitter& fitter, bool polish) {
  fitter.solve(true, true, false);
  fitter.solve(false, false, true);
  const double cost = fitter.solve(false, true, true);
  return polish ? fitter.solve(true, true, true) : cost;
}

/// Evenly strided samples, enough to tell the starts apart.
BinnedSamples thinned(const BinnedSamples& samples) {
  constexpr std::size_t kEnough = 300;
  const std::size_t stride = std::max<std::size_t>(1, samples.bins.size() / kEnough);
  BinnedSamples out;
  out.channels = samples.channels;
  for (std::size_t j = 0; j < samples.bins.size(); j += stride)
    out.bins.push_back(samples.bins[j]);
  return out;
}

/// Unknowns that the best start leads to.
Unknowns best_start(LobeModel model, const BinnedSamples& samples, const LobeFitOptions& options) {
  const LobeDescription& description = describe(model);
  const Unknowns guess = first_guess(description, samples);
  Fitter fitter(model, samples, options, Fitter::Norm::l1);
  Unknowns best = guess;
  double least = std::numeric_limits<double>::infinity();
  for (const double shape : description.starts) {
    Unknowns start = guess;
    start.shape[0] = inward(description.shape[0], shape);
    fitter.start_from(start);
    const double cost = run_stages(fitter, options.polish);
    if (!(cost < least)) continue;
    least = cost;
    best = fitter.unknowns();
  }
  return best;
}

/// The L1 fit's unknowns over all samples.
Unknowns robust_unknowns(Fitter& fitter, LobeModel model, const BinnedSamples& samples,
                         const LobeFitOptions& options) {
  const BinnedSamples few = thinned(samples);
  fitter.start_from(best_start(model, few, options));
  if (model == LobeModel::lambert) {
    fitter.solve(true, false, false);
  } else if (few.bins.size() < samples.bins.size()) {
    run_stages(fitter, options.polish);
  }
  return fitter.unknowns();
}

void check(const BinnedSamples& samples, double discrepancy) {
  if (!(discrepancy > 0 && std::isfinite(discrepancy))) {
    throw InputError("discrepancy", std::to_string(discrepancy), "a finite value over 0");
  }
  if (samples.channels != 1 && samples.channels != 3) {
    throw InputError("samples", std::to_string(samples.channels) + " channels", "1 or 3");
  }
  if (samples.bins.empty()) throw InputError("samples", "no bins", "at least one");
  for (std::size_t j = 0; j < samples.bins.size(); ++j) {
    const Bin& bin = samples.bins[j];
    const std::string where = "samples: bin " + std::to_string(j);
    for (int channel = 0; channel < samples.channels; ++channel) {
      if (!(std::isfinite(bin.f[channel]) && bin.f[channel] >= 0)) {
        throw InputError(
            where, "channel " + std::to_string(channel) + " is " + std::to_string(bin.f[channel]),
            "a finite reflectance, not negative");
      }
      if (!(std::isfinite(bin.variance[channel]) && bin.variance[channel] >= 0)) {
        throw InputError(where, "its variance is " + std::to_string(bin.variance[channel]),
                         "a finite variance, not negative");
      }
    }
    if (!cosines(bin.angles).above_horizon()) {
      throw InputError(where, "a direction is below the horizon", "both directions above it");
    }
  }
}

}  // namespace

LogObservations log_observations(const BinnedSamples& samples, double discrepancy) {
  check(samples, discrepancy);
  const auto bins = static_cast<Index>(samples.bins.size());
  LogObservations out;
  out.value.resize(bins, samples.channels);
  out.sigma.resize(bins, samples.channels);
  out.weight.resize(bins);
  for (Index j = 0; j < bins; ++j) {
    const Bin& bin = samples.bins[static_cast<std::size_t>(j)];
    const double w = cosine_weight(cosines(bin.angles));
    out.weight[j] = w;
    for (int channel = 0; channel < samples.channels; ++channel) {
      const double level = bin.f[channel] * w + kMappingEpsilon;
      const double slope = w / level;
      out.value(j, channel) = std::log(level);
      out.sigma(j, channel) =
          std::sqrt(discrepancy * discrepancy + slope * slope * bin.variance[channel]);
    }
  }
  return out;
}

LobeFit fit_lobe(LobeModel model, const BinnedSamples& samples, const LobeFitOptions& options) {
  Fitter fitter(model, samples, options, Fitter::Norm::l1);
  robust_unknowns(fitter, model, samples, options);
  return fitter.result();
}

LobeFit fit_best_lobe(const BinnedSamples& samples, const LobeFitOptions& options) {
  LobeFit best;
  best.mapped_l1 = std::numeric_limits<double>::infinity();
  for (const LobeModel model : lobe_models()) {
    LobeFit fit = fit_lobe(model, samples, options);
    if (fit.mapped_l1 < best.mapped_l1) best = std::move(fit);
  }
  return best;
}

LobePosterior lobe_posterior(LobeModel model, const BinnedSamples& samples,
                             const LobeFitOptions& options) {
  Fitter robust(model, samples, options, Fitter::Norm::l1);
  const Unknowns start = robust_unknowns(robust, model, samples, options);
  Fitter gaussian(model, samples, options, Fitter::Norm::gaussian);
  gaussian.start_from(start);
  gaussian.solve(true, true, true);
  LobePosterior posterior;
  posterior.fit = gaussian.result();
  gaussian.add_evidence(posterior);
  return posterior;
}

}  // namespace brdfgate
