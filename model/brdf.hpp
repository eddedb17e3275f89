// An isotropic BRDF in RGB, split into the diffuse and the specular part that scene files vary.
#pragma once

#include <Eigen/Core>
#include <memory>

#include "model/directions.hpp"

namespace brdfgate {

using Rgb = Eigen::Array3d;

/// f_r in 1/sr per colour channel (linear R, G, B); no cosine included. Defined for both directions
/// above the horizon; below it the value is 0. Implementations are immutable and thread-safe.
class Brdf {
 public:
  virtual ~Brdf() = default;
  /// Diffuse part. Analytic models: their Lambertian term. Tables: per colour and theta_d, the
  /// minimum over theta_h below 60 degrees (cli.md's definition).
  virtual Rgb diffuse(double theta_d) const = 0;
  /// f - diffuse, in 1/sr; may be slightly negative for tables beyond theta_h = 60 degrees.
  virtual Rgb specular(const HalfDiff& angles) const = 0;
  /// The BRDF: diffuse + specular, never negative.
  Rgb eval(const HalfDiff& angles) const {
    return (diffuse(angles.theta_d) + specular(angles)).max(0.0);
  }
};

using BrdfPtr = std::shared_ptr<const Brdf>;

}  // namespace brdfgate
