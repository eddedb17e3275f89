// What a teacher should know of what was taught: parts that stand out, and what the limits let
// through.
#pragma once

#include <string>
#include <vector>

#include "model/recipe.hpp"
#include "model/verdict.hpp"

namespace brdfgate {

/// A "good" part that the others would not pass.
struct OutlyingPart {
  int part = 0;          ///< from 0
  double t2 = 0;         ///< against the other parts (leave-one-out)
  MonitoredShift shift;  ///< what is most unlike them
};

/// Fewer parts say nothing of each other.
inline constexpr int kLeastPartsToCompare = 6;

/// Parts whose T^2 against mean and shrunk covariance of the others is over the taught limit.
/// Nothing for fewer than kLeastPartsToCompare.
std::vector<OutlyingPart> outlying_parts(const std::vector<ClusterObservation>& parts,
                                         const TaughtCluster& taught,
                                         const JudgeSettings& settings);

/// The change along one monitored direction alone that reaches the T^2 limit.
struct Reach {
  std::string name;
  double now = 0;        ///< relative, with the limit as taught
  double with_more = 0;  ///< if `more` parts of the same spread had been taught
};
/// @param clusters  of the recipe
std::vector<Reach> reach_of(const TaughtCluster& taught, const JudgeSettings& settings,
                            int clusters, int more);

}  // namespace brdfgate
