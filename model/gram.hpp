// The Gram matrix of a training set's mapped observations, accumulated slab by slab.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "model/training_sources.hpp"

namespace brdfgate {

/// What is known after `slabs` values of theta_h.
struct GramState {
  Eigen::MatrixXd gram;  ///< m x m; the lower triangle
  int slabs = 0;
  std::string values_hash;  ///< chained SHA-256 over the values sampled; empty for files
};

/// Where an interrupted accumulation goes on.
struct GramCheckpoint {
  std::filesystem::path file;  ///< empty: none is kept
  std::string key;             ///< of inputs and options: a file with another one is foreign
  int interval = 5;            ///< slabs between writes
};

/// Writes a checkpoint atomically. Throws InputError where it cannot.
void save_checkpoint(const GramCheckpoint& checkpoint, const GramState& state);

/// The state in the checkpoint's file. None where there is no file, or one that is damaged, foreign
/// or of another size; `reason` then says which (empty where there is no file).
std::optional<GramState> load_checkpoint(const GramCheckpoint& checkpoint,
                                         Eigen::Index observations, std::string& reason);

struct GramOptions {
  GramCheckpoint checkpoint;
  std::function<void(int slabs)> progress;  ///< called after each slab; may be empty
  std::function<void(const std::string& message)> message;  ///< a checkpoint used or ignored
};

/// (X - mu)(X - mu)^T in double precision, both triangles (method.md section 3), on all cores; the
/// result does not depend on their number, nor on interruptions. Memory: one slab and m x m.
GramState accumulate_gram(const TrainingSources& sources, const BasisGrid& grid,
                          const GramOptions& options = {});

}  // namespace brdfgate
