#include "model/prediction.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "model/analytic_fit.hpp"
#include "model/error.hpp"
#include "model/estimators.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

using Values = std::vector<Eigen::Array3d>;

double distance2(const HalfDiff& a, const HalfDiff& b) {
  constexpr double kRight = std::numbers::pi / 2;
  const double h = std::sqrt(a.theta_h / kRight) - std::sqrt(b.theta_h / kRight);
  const double d = (a.theta_d - b.theta_d) / kRight;
  const double apart = std::abs(a.phi_d - b.phi_d);
  const double p = std::min(apart, 2 * kRight - apart) / kRight *
                   std::sqrt(std::sin(a.theta_d) * std::sin(b.theta_d));
  return h * h + d * d + p * p;
}

struct Split {
  BinnedSamples known;
  BinnedSamples others;
};

Split split(const BinnedSamples& all, const std::vector<std::size_t>& known) {
  std::vector<bool> taken(all.bins.size(), false);
  Split out;
  out.known.channels = out.others.channels = all.channels;
  for (const std::size_t i : known) {
    if (i >= all.bins.size()) {
      throw InputError("known directions", "index " + std::to_string(i),
                       "below " + std::to_string(all.bins.size()));
    }
    taken[i] = true;
    out.known.bins.push_back(all.bins[i]);
  }
  for (std::size_t i = 0; i < taken.size(); ++i) {
    if (!taken[i]) out.others.bins.push_back(all.bins[i]);
  }
  if (out.others.bins.empty()) throw InputError("known directions", "none is left to predict");
  return out;
}

PredictionError error_of(const std::string& method, const BinnedSamples& truth,
                         const Values& predicted) {
  PredictionError error{method};
  std::vector<double> absolute;
  for (int channel = 0; channel < truth.channels; ++channel) {
    double sum = 0;
    for (std::size_t j = 0; j < truth.bins.size(); ++j) {
      const double w = cosine_weight(cosines(truth.bins[j].angles));
      const double e = to_mapped(predicted[j][channel], truth.bins[j].f[channel], w);
      sum += e * e;
      absolute.push_back(std::abs(e));
    }
    error.channels[static_cast<std::size_t>(channel)] =
        std::sqrt(sum / static_cast<double>(truth.bins.size()));
    error.mapped_rms += error.channels[static_cast<std::size_t>(channel)] / truth.channels;
  }
  const auto middle = absolute.begin() + static_cast<std::ptrdiff_t>(absolute.size() / 2);
  std::nth_element(absolute.begin(), middle, absolute.end());
  error.median = *middle;
  return error;
}

Values by_estimator(const std::string& name, const std::shared_ptr<const Basis>& basis,
                    const Split& samples) {
  EstimatorOptions options;
  options.method = name;
  const Weights weights = make_estimator(options, basis)->estimate(samples.known);
  const std::vector<HalfDiff> directions = samples.others.directions();
  Values values(directions.size(), Eigen::Array3d::Zero());
  for (Eigen::Index channel = 0; channel < weights.c.cols(); ++channel) {
    const Eigen::VectorXd f = basis->reconstruct(weights.c.col(channel), directions);
    for (std::size_t j = 0; j < values.size(); ++j)
      values[j][channel] = f[static_cast<Eigen::Index>(j)];
  }
  return values;
}

Values by_lobe(const Lobe& lobe, const Split& samples) {
  const BrdfPtr brdf = make_brdf(lobe);
  Values values;
  for (const Bin& bin : samples.others.bins)
    values.push_back(brdf->eval(bin.angles));
  return values;
}

}  // namespace

Values nearest_neighbour(const BinnedSamples& known, const std::vector<HalfDiff>& directions) {
  Values values;
  values.reserve(directions.size());
  for (const HalfDiff& at : directions) {
    const auto nearest =
        std::min_element(known.bins.begin(), known.bins.end(), [&at](const Bin& a, const Bin& b) {
          return distance2(a.angles, at) < distance2(b.angles, at);
        });
    values.push_back(nearest->f);
  }
  return values;
}

std::vector<PredictionError> predict_the_others(const std::shared_ptr<const Basis>& basis,
                                                const BinnedSamples& all,
                                                const std::vector<std::size_t>& known) {
  log_observations(all, 1.0);  // refuses unusable samples before any method meets them
  const Split samples = split(all, known);
  std::vector<PredictionError> errors;
  for (const std::string& name : estimator_names()) {
    try {
      errors.push_back(error_of(name, samples.others, by_estimator(name, basis, samples)));
    } catch (const InputError& error) {  // a basis without this estimator's data
      errors.push_back({name});
      errors.back().failed = error.what();
    }
  }
  for (const LobeModel model : lobe_models()) {
    const std::string name(describe(model).name);
    errors.push_back(error_of(name + " (L1)", samples.others,
                              by_lobe(fit_lobe(model, samples.known).lobe, samples)));
    errors.push_back(error_of(name + " (L2)", samples.others,
                              by_lobe(lobe_posterior(model, samples.known).fit.lobe, samples)));
  }
  errors.push_back(error_of("nearest neighbour", samples.others,
                            nearest_neighbour(samples.known, samples.others.directions())));
  return errors;
}

}  // namespace brdfgate
