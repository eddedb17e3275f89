// What of a taught material is watched: the few ways in which production changes a surface
// (method.md section 8: few directions, chosen at teach time).
//
// A reconstruction has dozens of weights per channel; with N taught parts a covariance of p of them
// costs a T^2 limit that grows without bound as p nears N (Hotelling: at N = 50 and 0.1 % it is 27
// for p = 5, 43 for 9, 96 for 18). What happens to a surface in production are changes of
// pigment (the diffuse level in each channel), of the amount of gloss and of its width: p =
// channels + 2 directions in the space of the mapped reflectance. They are read off the taught
// reconstruction by changing it as BrdfChange does. Everything else is left to SPE.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "model/brdf.hpp"
#include "model/canonical.hpp"
#include "model/observation.hpp"

namespace brdfgate {

/// The monitored directions of one taught cluster, on the bins of the taught pose.
struct MonitoredDirections {
  std::vector<std::string> names;  ///< p: "diffuse level R", .. "gloss level", "roughness"
  BinFrame frame;                  ///< bins in rising order of their numbers
  Eigen::MatrixXd reference;       ///< bins x channels: mapped observation of the taught mean
  /// (bins * channels) x p, channel by channel: d mapped / d ln(factor) of each change.
  Eigen::MatrixXd response;
  Eigen::MatrixXd weight;  ///< bins x channels, > 0: of the least squares, inverse variances

  Eigen::Index size() const { return response.cols(); }
};

/// How many of the directions are diffuse levels: the first ones.
int level_count(const MonitoredDirections& directions);

/// "diffuse level R" and so on; of a mono sensor "diffuse level".
std::string level_name(Eigen::Index channel, Eigen::Index channels);

/// Directions whose size noise and model error alone leave uncertain by more than this are not
/// monitored (the gloss of a material without any): ln units, 0.2 is 20 %.
inline constexpr double kUselessDirection = 0.2;

/// The directions of a material. From channels + 2 candidates those are kept whose size the frame's
/// bins tell, the worst being given up first.
/// @param material   the taught reconstruction
/// @param reference  as in the result; @param noise bins x channels, its variance in one part
/// Throws InputError when shapes differ.
MonitoredDirections monitored_directions(const Basis& basis, const Brdf& material,
                                         const BinFrame& frame, const Eigen::MatrixXd& reference,
                                         const Eigen::MatrixXd& noise);

/// A part along the directions: by weighted least squares on the bins it showed, how far along each
/// (ln of the factor, `monitored`) with the covariance that noise gives, and what they leave
/// (`residual`).
/// @param framed  on directions.frame (onto_frame): bins of 0 pixels were not seen
/// @param linear  the part's weights, kept beside
/// Throws InputError where the samples are on another frame or no bin was seen.
ClusterObservation observe_along(const MonitoredDirections& directions, const Basis& basis,
                                 const BinnedSamples& framed, const Weights& linear);

}  // namespace brdfgate
