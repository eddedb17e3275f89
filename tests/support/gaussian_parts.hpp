// Parts of one kind as plain numbers: Gaussian weights and residuals around a mean, seeded.
#pragma once

#include <Eigen/Core>
#include <random>
#include <vector>

#include "model/observation.hpp"

namespace brdfgate::test {

/// What a population of good parts is: deviations of its monitored weights, and of its residuals
/// along a few common patterns plus bin by bin.
struct GaussianParts {
  int components = 5, channels = 3, monitored = 3, bins = 40;
  double weight_deviation = 0.10;  ///< of the first weight; each further one has half
  double correlation = 0.8;        ///< between the channels' same weights
  int patterns = 3;                ///< that all bins' residuals share
  double pattern_deviation = 0.08;
  double bin_deviation = 0.01;
  double noise_deviation = 0;  ///< known noise of this measurement, weights and residuals alike
  std::mt19937_64 random{1};

  explicit GaussianParts(std::uint64_t seed = 1) : random(seed) {}

  double normal() { return normal_(random); }

  ClusterObservation part() {
    ClusterObservation seen;
    seen.weights = Eigen::MatrixXd::Zero(components, channels);
    for (int i = 0; i < components; ++i) {
      const double common = normal();
      for (int c = 0; c < channels; ++c) {
        const double own = normal();
        seen.weights(i, c) =
            0.3 * (i + 1) - 0.2 * c +
            weight_deviation / (1 << i) *
                (std::sqrt(correlation) * common + std::sqrt(1 - correlation) * own) +
            noise_deviation * normal();
      }
    }
    seen.monitored = leading_weights(seen.weights, monitored);
    seen.monitored_noise = noise_deviation * noise_deviation *
                           Eigen::MatrixXd::Identity(seen.monitored.size(), seen.monitored.size());
    add_residuals(seen);
    return seen;
  }

  std::vector<ClusterObservation> parts(int n) {
    std::vector<ClusterObservation> drawn;
    for (int i = 0; i < n; ++i)
      drawn.push_back(part());
    return drawn;
  }

 private:
  void add_residuals(ClusterObservation& seen) {
    std::vector<double> amplitude;
    for (int k = 0; k < patterns; ++k)
      amplitude.push_back(pattern_deviation * normal());
    seen.residual = Eigen::MatrixXd::Zero(bins, channels);
    seen.residual_noise =
        Eigen::MatrixXd::Constant(bins, channels, noise_deviation * noise_deviation);
    for (int b = 0; b < bins; ++b) {
      seen.bin_id.push_back(10 + b);
      seen.angles.push_back({0.01 * b, 0.9, 0.1});
      for (int c = 0; c < channels; ++c) {
        seen.residual(b, c) =
            0.1 * std::sin(0.7 * b + c) + bin_deviation * normal() + noise_deviation * normal();
        for (int k = 0; k < patterns; ++k)
          seen.residual(b, c) +=
              amplitude[static_cast<std::size_t>(k)] * std::cos((0.3 + 0.2 * k) * b + k + 0.5 * c);
      }
    }
  }

  std::normal_distribution<double> normal_;
};

}  // namespace brdfgate::test
