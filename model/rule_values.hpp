// A measured part's readings as its rules see them.
#pragma once

#include <string>
#include <vector>

#include "model/judge.hpp"

namespace brdfgate {

/// Of a cluster that was measured with valid weights; of others only the area share is known.
/// @param seen  nullptr: nothing comparable to the taught parts was seen
/// @pre the reading is of a cluster
RuleValue cluster_value(RuleReading reading, const ClusterResult& cluster,
                        const TaughtCluster& taught, const ClusterObservation* seen);

/// @pre the reading is of the part
/// @param kind  of the defects that count; empty: all
RuleValue part_value(RuleReading reading, const PartFacts& facts, const std::string& kind);

/// As taught; NaN where the recipe does not hold it, or is a draft.
double taught_value(RuleReading reading, const TaughtCluster& taught);

/// False where the bins that the taught parts showed never measure the reading: it is always
/// extrapolated by the basis. True where those bins are not known.
bool can_be_measured(RuleReading reading, const TaughtCluster& taught);

/// Why no part of the taught kind can have the reading; empty: it can.
std::string never_defined(RuleReading reading, const TaughtCluster& taught);

}  // namespace brdfgate
