// The ways from binned reflectance to weights, chosen by name: in YAML (inspection.method) and on
// the command line (--method).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "model/estimator.hpp"

namespace brdfgate {

/// One way from samples to weights with their posterior. Implementations are thread-safe.
class Estimator {
 public:
  virtual ~Estimator() = default;
  virtual std::string name() const = 0;
  /// @pre as of ridge(): bins not empty, finite, not negative, above the horizon; throws InputError
  /// otherwise.
  virtual Weights estimate(const BinnedSamples& samples) const = 0;
};

struct EstimatorOptions {
  std::string method;      ///< one of estimator_names(); empty: the first that the basis supports
  double eta = kRidgeEta;  ///< of `ridge`
};

/// Names that make_estimator() knows, the product's own first:
///   gp     Gaussian-process regression on examples (example_regression.hpp), its posterior widened
///          by the pixel noise; needs a basis with exemplars. Trains anew for every new set of
///          directions (a second) and keeps the latest few.
///   ridge  the papers' formula
std::vector<std::string> estimator_names();

/// Throws InputError for an unknown name, or one that this basis has no data for.
std::shared_ptr<const Estimator> make_estimator(const EstimatorOptions& options,
                                                std::shared_ptr<const Basis> basis);

}  // namespace brdfgate
