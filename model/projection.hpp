// From any BRDF to samples on a grid, and from there to weights in the basis.
#pragma once

#include <memory>

#include "model/basis.hpp"
#include "model/brdf.hpp"
#include "model/estimator.hpp"
#include "model/samples.hpp"

namespace brdfgate {

/// Exact values at the cell centres whose cosines both exceed 0.02 (those that comparisons count):
/// one bin each, no variance.
/// @pre every axis of the grid has at least one cell
BinnedSamples sample_cells(const Brdf& brdf, const BasisGrid& grid);

/// The same of a reconstruction, at the basis' own precision. Mono weights give three equal
/// channels.
BinnedSamples sample_cells(const Basis& basis, const Weights& weights, const BasisGrid& grid);

/// A grid on which a fit sees the whole hemisphere, the highlight finely.
inline constexpr BasisGrid kFitGrid{30, 12, 8};

/// The weights that come nearest to a BRDF, in mapped units, over the valid cells of the basis' own
/// grid: plain least squares (a ridge of 1e-6, there for lone zero components). For what a basis
/// can say of an analytic model, and as the truth that estimators from few directions aim at.
Weights project(const Basis& basis, const Brdf& brdf);

}  // namespace brdfgate
