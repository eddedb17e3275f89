// A cluster's readings in words, for text and pages.
#pragma once

#include <string>
#include <vector>

#include "app/inspector.hpp"

namespace brdfgate {

struct ReadingWords {
  std::string name;      ///< with its geometry
  std::string value;     ///< with its unit
  std::string interval;  ///< 90 %, "12.1 to 14.0"; empty: not known
  std::string taught;    ///< empty: not taught
  bool measured = false;
};

/// Gloss, haze where it is defined, and colours where the camera's are known. Without valid weights
/// nothing. `taught` nullptr: no recipe.
std::vector<ReadingWords> reading_words(const ClusterResult& cluster, const TaughtCluster* taught);

}  // namespace brdfgate
