// Training a basis from measured materials (thesis, C.IV section 3; method.md section 3).
//
// A cell's observation is the material's value at the cell's centre, interpolated in its own table.
// Averaging the mapped values over the cell instead (2 x 2 x 2 points) gives the same error of
// held-out materials: 0.2479 against 0.2479 mapped RMS on a 45 x 45 x 45 grid (ten materials left
// out, ridge, 298 directions), so the simpler one is used.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "model/basis.hpp"
#include "model/exemplars.hpp"
#include "model/training_sources.hpp"

namespace brdfgate {

struct TrainingOptions {
  BasisGrid grid;
  int components = 40;
  ExemplarCounts exemplars{0, 0};  ///< derived materials for the estimator `gp`
  std::string licence;
  std::string attribution;
  std::function<void(double)> progress;  ///< called with 0..1; may be empty
  /// Where an interrupted training goes on; removed when the basis is written. Empty: nowhere. Of
  /// use for files only: a BRDF object has no bytes to be recognised by.
  std::filesystem::path checkpoint;
  std::function<void(const std::string&)> message;  ///< a checkpoint used or ignored; may be empty
};

/// Trains and writes the file atomically. Streams theta_h slab by slab through the mapped files and
/// accumulates the m x m Gram matrix in double precision: memory grows with m, not with m x p.
/// Deterministic, whatever the number of threads and interruptions; each component's sign makes the
/// sum over its cells positive.
/// Throws InputError: fewer than 2 materials, two of one name in one fit, components > m - 1, an
/// unusable file or material (named).
void train_basis(const std::vector<TrainingMaterial>& materials, const TrainingOptions& options,
                 const std::filesystem::path& out);
/// The same from BRDF objects; small bases are built on the spot. The training hash is then over
/// the values sampled.
void train_basis(const std::vector<NamedBrdf>& materials, const TrainingOptions& options,
                 const std::filesystem::path& out);

}  // namespace brdfgate
