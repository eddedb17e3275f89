// The smallest model that samples call for: Lambert, one analytic lobe, or k components of the
// basis (method.md section 9; C.II asks for descriptive and parsimonious models).
#pragma once

#include <string>
#include <vector>

#include "model/analytic_fit.hpp"
#include "model/basis.hpp"
#include "model/samples.hpp"

namespace brdfgate {

struct ParsimonyOptions {
  /// Error of one observation beside its pixel noise, mapped units; 0: the ridge's, sqrt(40 / m).
  double discrepancy = 0;
  /// A model suffices when its log evidence is at most this far below the best one's, nats. 3 is a
  /// ratio of 20: what Kass & Raftery 1995 ("Bayes factors") call strong evidence begins there.
  double margin = 3;
  /// Components to try; those beyond the basis' own are left out. Never empty.
  std::vector<int> components{1, 2, 3, 5, 8, 12, 20, 30, 40, 60, 100};
  std::vector<LobeModel> lobes{LobeModel::phong, LobeModel::blinn_phong, LobeModel::ward,
                               LobeModel::ggx,   LobeModel::beckmann,    LobeModel::blend};
};

struct ModelScore {
  enum class Kind { lambert, lobe, components };
  Kind kind = Kind::lambert;
  LobeModel lobe = LobeModel::lambert;  ///< for lambert and lobe
  int components = 0;                   ///< k, for components
  int parameters = 0;                   ///< over all channels
  double log_evidence = 0;              ///< nats, of the samples' logarithms
  double chi_square = 0;                ///< squared residual in deviations, summed over `values`
  int values = 0;                       ///< bins x channels
  bool sufficient = false;
};

struct Parsimony {
  std::vector<ModelScore> tried;  ///< in the order of size: Lambert, lobes, components rising
  std::size_t chosen = 0;         ///< index into `tried`
  const ModelScore& choice() const { return tried[chosen]; }
};

/// "lambert", "ggx", "12 components".
std::string to_text(const ModelScore& score);

/// Log evidence of every model under one error model (pixel noise plus discrepancy, independent
/// per bin and channel), exact for components (their weights are Gaussian a priori, N(0, 1 / m)),
/// Laplace's approximation for Lambert and lobes. Chosen is the smallest model that suffices; of
/// equally large lobes the one with the most evidence. Costs half a second for 300 bins: offline.
/// Throws InputError as lobe_posterior(); for a margin below 0, no components to try, k below 1.
Parsimony smallest_sufficient_model(const BinnedSamples& samples, const Basis& basis,
                                    const ParsimonyOptions& options = {});

}  // namespace brdfgate
