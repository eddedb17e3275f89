// Reconstruction error per material, for a basis file and for bases trained without the materials
// they are tested on.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "model/basis_training.hpp"
#include "model/estimators.hpp"
#include "model/validation.hpp"

namespace brdfgate {

/// What each material was reconstructed by and how far off it is.
struct MaterialErrors {
  std::string name;
  bool seen = false;                        ///< the basis was trained on a material of this name
  int fold = -1;                            ///< it was left out with; -1 without folds
  std::vector<ReconstructionError> errors;  ///< per method
};

struct BasisValidation {
  std::vector<std::string> methods;
  std::vector<MaterialErrors> materials;

  /// Of one method over the materials.
  std::vector<double> errors_of(std::size_t method) const;
  /// Numbers of the materials by falling error of one method.
  std::vector<std::size_t> worst_first(std::size_t method) const;
};

struct ValidationMethods {
  std::vector<std::string> names;  ///< of estimator_names(); empty: the basis' own and `ridge`
  double eta = kRidgeEta;
};

struct TestMaterial {
  std::string name;
  std::filesystem::path file;
};

using ShareDone = std::function<void(double)>;  ///< called with 0..1

/// Observes each material exactly at the 298 directions of ValidationRig, estimates with each
/// method, and measures (reconstruction_error()). On all cores; same result for any number of them.
BasisValidation validate_basis(const std::shared_ptr<const Basis>& basis,
                               const std::vector<TestMaterial>& materials,
                               const ValidationMethods& methods, const ShareDone& progress = {});

struct CrossValidation {
  int folds = 6;
  std::uint64_t seed = 1;
  TrainingOptions training;
  ValidationMethods methods;
};

/// Splits the names of the test materials into folds; trains a basis per fold, in a temporary
/// folder, on all training materials but those of the fold's names (in every fit), and tests it on
/// the fold's. Materials to train on that are not tested are in every training set. Throws
/// InputError: a fold that leaves too few materials for the components, an unusable file.
BasisValidation cross_validate(const std::vector<TrainingMaterial>& training,
                               const std::vector<TestMaterial>& tests,
                               const CrossValidation& options, const ShareDone& progress = {});

/// One line per material and method: name, seen, fold, method, error and its channels.
std::string to_csv(const BasisValidation& validation);

/// Error of each material, sorted by the first method's, with mean, median and 90th percentile of
/// each method.
void draw_errors(const BasisValidation& validation, const std::string& title,
                 const std::filesystem::path& png);

}  // namespace brdfgate
