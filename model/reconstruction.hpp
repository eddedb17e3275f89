// Whole BRDFs from weights, and how far two BRDFs are apart.
#pragma once

#include "model/basis.hpp"
#include "model/estimator.hpp"
#include "model/merl.hpp"

namespace brdfgate {

/// A material given by weights in a basis: usable wherever a Brdf is (readings, pictures). Mono
/// weights give three equal channels.
BrdfPtr make_brdf(std::shared_ptr<const Basis> basis, const Weights& weights);

/// Every MERL cell above the horizon filled, -1 below it (cli.md, "Recording").
MerlTable tabulate(const Basis& basis, const Weights& weights);

/// brdfgate.compare/1's numbers: RMS of ln((a w + e) / (b w + e)) over the MERL cells whose cosines
/// both exceed 0.02, per channel and their mean. A cell that is missing in `a` or `b` counts as an
/// error of 5.
struct BrdfDifference {
  double mapped_rms = 0;
  std::array<double, 3> mapped_rms_per_channel{};
  std::size_t missing_cells = 0;  ///< over all channels
};
BrdfDifference compare(const MerlBrdf& a, const MerlBrdf& b);
BrdfDifference compare(const MerlTable& a, const MerlBrdf& b);

}  // namespace brdfgate
