// How much light a BRDF reflects, by integration.
#pragma once

#include <cmath>
#include <numbers>

#include "model/brdf.hpp"

namespace brdfgate::test {

/// Directional albedo of the specular part, first channel: the integral of f cos_o over wo, taken
/// over half vectors (d wo = 4 (wi . h) d h) with theta_h squeezed toward 0, where the lobe is.
inline double directional_albedo(const Brdf& brdf, double theta_i, int steps = 400) {
  constexpr double kPi = std::numbers::pi;
  const Eigen::Vector3d wi(std::sin(theta_i), 0, std::cos(theta_i));
  double sum = 0;
  for (int i = 0; i < steps; ++i) {
    const double t = (i + 0.5) / steps;
    const double theta = t * t * t * kPi / 2;
    const double d_theta = 3 * t * t * kPi / 2 / steps;
    for (int j = 0; j < steps; ++j) {
      const double phi = (j + 0.5) * 2 * kPi / steps;
      const Eigen::Vector3d h(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                              std::cos(theta));
      const Eigen::Vector3d wo = 2 * wi.dot(h) * h - wi;
      if (wo.z() <= 0 || wi.dot(h) <= 0) continue;
      sum += brdf.specular(to_half_diff({wi, wo}))[0] * wo.z() * 4 * wi.dot(h) * std::sin(theta) *
             d_theta * 2 * kPi / steps;
    }
  }
  return sum;
}

}  // namespace brdfgate::test
