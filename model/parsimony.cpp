#include "model/parsimony.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "model/error.hpp"
#include "model/estimator.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

/// Mapped observations less the basis' mean, and their deviations: bins x channels.
struct Centred {
  BasisRows rows;
  Eigen::MatrixXd x;
  Eigen::MatrixXd sigma;
};

Centred centre(const BinnedSamples& samples, const Basis& basis, double discrepancy) {
  const LogObservations observed = log_observations(samples, discrepancy);
  Centred out{basis.rows(samples.directions()), observed.value, observed.sigma};
  const Eigen::ArrayXd reference =
      (out.rows.median.array() * observed.weight.array() + kMappingEpsilon).log() +
      out.rows.mean.array();
  out.x.colwise() -= reference.matrix();
  return out;
}

/// The Gaussian evidence of x = Q_k c + error with c ~ N(0, I / m), and the residual at the
/// posterior's mean.
ModelScore score_components(const Centred& data, int k, double m) {
  ModelScore score;
  score.kind = ModelScore::Kind::components;
  score.components = k;
  score.parameters = k * static_cast<int>(data.x.cols());
  score.values = static_cast<int>(data.x.size());
  for (Index channel = 0; channel < data.x.cols(); ++channel) {
    const Eigen::ArrayXd sigma = data.sigma.col(channel).array();
    const Eigen::MatrixXd q = data.rows.q.leftCols(k).array().colwise() / sigma;
    const Eigen::VectorXd x = data.x.col(channel).array() / sigma;
    Eigen::MatrixXd precision = q.transpose() * q;
    precision.diagonal().array() += m;
    const Eigen::LLT<Eigen::MatrixXd> factor(precision);
    const Eigen::VectorXd b = q.transpose() * x;
    const Eigen::VectorXd c = factor.solve(b);
    const double log_det =
        2 * Eigen::MatrixXd(factor.matrixL()).diagonal().array().log().sum() - k * std::log(m);
    score.log_evidence -= 0.5 * (x.squaredNorm() - b.dot(c) + log_det +
                                 double(x.size()) * std::log(2 * std::numbers::pi)) +
                          sigma.log().sum();
    score.chi_square += (x - q * c).squaredNorm();
  }
  return score;
}

ModelScore score_lobe(LobeModel model, const BinnedSamples& samples, double discrepancy) {
  LobeFitOptions options;
  options.discrepancy = discrepancy;
  const LobePosterior posterior = lobe_posterior(model, samples, options);
  ModelScore score;
  score.kind = model == LobeModel::lambert ? ModelScore::Kind::lambert : ModelScore::Kind::lobe;
  score.lobe = model;
  score.parameters = posterior.parameters;
  score.log_evidence = posterior.log_evidence;
  score.chi_square = posterior.chi_square;
  score.values = static_cast<int>(samples.bins.size()) * samples.channels;
  return score;
}

void check(const ParsimonyOptions& options) {
  if (!(options.margin >= 0 && std::isfinite(options.margin))) {
    throw InputError("margin", std::to_string(options.margin), "nats, not negative");
  }
  if (options.components.empty()) throw InputError("components", "none to try", "at least one");
  for (const int k : options.components) {
    if (k < 1) throw InputError("components", std::to_string(k), "at least 1");
  }
}

/// Of two models that suffice: is `a` to be preferred?
bool smaller(const ModelScore& a, const ModelScore& b) {
  if (a.kind != b.kind) return a.kind < b.kind;
  if (a.parameters != b.parameters) return a.parameters < b.parameters;
  return a.log_evidence > b.log_evidence;
}

void choose(Parsimony& result, double margin) {
  double best = -std::numeric_limits<double>::infinity();
  for (const ModelScore& score : result.tried)
    best = std::max(best, score.log_evidence);
  bool found = false;
  for (std::size_t i = 0; i < result.tried.size(); ++i) {
    ModelScore& score = result.tried[i];
    score.sufficient = score.log_evidence >= best - margin;
    if (!score.sufficient || (found && !smaller(score, result.tried[result.chosen]))) continue;
    result.chosen = i;
    found = true;
  }
}

}  // namespace

std::string to_text(const ModelScore& score) {
  if (score.kind != ModelScore::Kind::components) return std::string(describe(score.lobe).name);
  return std::to_string(score.components) + (score.components == 1 ? " component" : " components");
}

Parsimony smallest_sufficient_model(const BinnedSamples& samples, const Basis& basis,
                                    const ParsimonyOptions& options) {
  check(options);
  const double m = basis.info().observations;
  const double discrepancy =
      options.discrepancy == 0 ? std::sqrt(kRidgeEta / m) : options.discrepancy;
  const Centred data = centre(samples, basis, discrepancy);
  Parsimony result;
  result.tried.push_back(score_lobe(LobeModel::lambert, samples, discrepancy));
  for (const LobeModel model : options.lobes)
    result.tried.push_back(score_lobe(model, samples, discrepancy));
  std::vector<int> components = options.components;
  std::sort(components.begin(), components.end());
  for (const int k : components) {
    if (k <= basis.info().components) result.tried.push_back(score_components(data, k, m));
  }
  choose(result, options.margin);
  return result;
}

}  // namespace brdfgate
