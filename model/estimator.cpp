#include "model/estimator.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <string>

#include "model/error.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

void check_bin(const Bin& bin, int channels, std::size_t number) {
  const std::string where =
      "samples: bin " + std::to_string(number) + " (id " + std::to_string(bin.id) + ")";
  for (int channel = 0; channel < channels; ++channel) {
    const double f = bin.f[channel];
    if (!(std::isfinite(f) && f >= 0)) {
      throw InputError(where, "channel " + std::to_string(channel) + " is " + std::to_string(f),
                       "a finite reflectance, not negative");
    }
  }
  if (!cosines(bin.angles).above_horizon()) {
    throw InputError(where,
                     "theta_h " + std::to_string(bin.angles.theta_h) + ", theta_d " +
                         std::to_string(bin.angles.theta_d) + ", phi_d " +
                         std::to_string(bin.angles.phi_d) + " rad is below the horizon",
                     "both directions above it");
  }
}

}  // namespace

void check_samples(const BinnedSamples& samples) {
  if (samples.channels != 1 && samples.channels != 3) {
    throw InputError("samples", std::to_string(samples.channels) + " channels", "1 or 3");
  }
  if (samples.bins.empty()) throw InputError("samples", "no bins", "at least one");
  for (std::size_t j = 0; j < samples.bins.size(); ++j)
    check_bin(samples.bins[j], samples.channels, j);
}

Eigen::MatrixXd centred(const BinnedSamples& samples, const BasisRows& rows) {
  Eigen::MatrixXd x(rows.q.rows(), samples.channels);
  for (Index j = 0; j < x.rows(); ++j) {
    const Bin& bin = samples.bins[static_cast<std::size_t>(j)];
    for (Index channel = 0; channel < x.cols(); ++channel)
      x(j, channel) = to_mapped(bin.f[channel], rows.median[j], rows.weight[j]) - rows.mean[j];
  }
  return x;
}

Eigen::MatrixXd Weights::in_prior_sigmas(int observations) const {
  return c * std::sqrt(static_cast<double>(observations));
}

Eigen::MatrixXd Weights::sigmas_in_prior_sigmas(int observations) const {
  Eigen::MatrixXd sigmas(c.rows(), c.cols());
  for (Index channel = 0; channel < c.cols(); ++channel) {
    sigmas.col(channel) =
        (covariance[static_cast<std::size_t>(channel)].diagonal() * double(observations))
            .cwiseMax(0.0)
            .cwiseSqrt();
  }
  return sigmas;
}

Eigen::MatrixXd channel_correlation(const Eigen::MatrixXd& x) {
  constexpr double kCommon = 0.6;  // whatever the channels look like
  constexpr double kReach = 0.3;   // mapped units
  const double n = static_cast<double>(std::max<Index>(1, x.rows()));
  Eigen::MatrixXd correlation = Eigen::MatrixXd::Identity(x.cols(), x.cols());
  for (Index a = 0; a < x.cols(); ++a) {
    for (Index b = 0; b < a; ++b) {
      const double distance = std::sqrt((x.col(a) - x.col(b)).squaredNorm() / n);
      correlation(a, b) = correlation(b, a) =
          kCommon + (1 - kCommon) * std::exp(-distance / kReach);
    }
  }
  return correlation;
}

Weights ridge(const Basis& basis, const BinnedSamples& samples, double eta) {
  check_samples(samples);
  if (!(eta > 0 && std::isfinite(eta))) {
    throw InputError("eta", std::to_string(eta), "a finite value over 0");
  }
  const BasisRows rows = basis.rows(samples.directions());
  const Eigen::MatrixXd x = centred(samples, rows);
  const Index k = rows.q.cols();
  Eigen::MatrixXd normal = rows.q.transpose() * rows.q;
  normal.diagonal().array() += eta;
  const Eigen::LLT<Eigen::MatrixXd> factor(normal);
  Weights w;
  w.c = factor.solve(rows.q.transpose() * x);
  // The same directions and error variance for every channel, hence one covariance.
  const Eigen::MatrixXd covariance =
      eta / basis.info().observations * factor.solve(Eigen::MatrixXd::Identity(k, k));
  w.covariance.assign(static_cast<std::size_t>(samples.channels), covariance);
  const Eigen::MatrixXd residual = x - rows.q * w.c;
  const double n = static_cast<double>(x.rows());
  w.residual_rms = std::sqrt(residual.squaredNorm() / static_cast<double>(x.size()));
  w.misfit = (residual.colwise().squaredNorm().transpose() / n).cwiseSqrt() /
             std::sqrt(eta / basis.info().observations);
  w.rows = static_cast<int>(x.rows());
  w.channel_correlation = channel_correlation(x);
  return w;
}

Eigen::MatrixXd mapped_residual(const Basis& basis, const BinnedSamples& samples,
                                const Weights& w) {
  check_samples(samples);
  if (w.c.rows() != basis.info().components || w.c.cols() != samples.channels) {
    throw InputError(
        "weights",
        std::to_string(w.c.rows()) + " components of " + std::to_string(w.c.cols()) + " channels",
        std::to_string(basis.info().components) + " of " + std::to_string(samples.channels));
  }
  const BasisRows rows = basis.rows(samples.directions());
  return centred(samples, rows) - rows.q * w.c;
}

}  // namespace brdfgate
