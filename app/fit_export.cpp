#include "app/fit_export.hpp"

#include <fmt/core.h>

#include <vector>

#include "app/result_json.hpp"
#include "config/material_writer.hpp"
#include "model/analytic_fit.hpp"
#include "model/parsimony.hpp"
#include "model/projection.hpp"

namespace brdfgate {
namespace {

constexpr const char* kBest = "best";

LobeFit fit(const std::string& model, const BinnedSamples& samples) {
  return model == kBest ? fit_best_lobe(samples) : fit_lobe(lobe_model(model), samples);
}

/// The smallest model that explains the samples, as a comment.
std::string called_for(const BinnedSamples& samples, const Basis& basis) {
  const Parsimony parsimony = smallest_sufficient_model(samples, basis);
  const ModelScore& choice = parsimony.choice();
  return fmt::format("# the measurement calls for {}: {} parameters, log evidence {:.1f}\n",
                     to_text(choice), choice.parameters, choice.log_evidence);
}

}  // namespace

CLI::Option* add_fit_option(CLI::App& command, std::string& model) {
  std::vector<std::string> models{kBest};
  for (const LobeModel known : lobe_models())
    models.emplace_back(describe(known).name);
  return command
      .add_option("--fit", model,
                  "also export each cluster as this analytic model's parameters, "
                  "cluster_<n>.yaml; best: the model that fits best")
      ->check(CLI::IsMember(models));
}

void export_fits(const std::filesystem::path& dir, const Inspection& part, const Basis& basis,
                 const std::string& model) {
  if (model.empty()) return;
  for (const ClusterResult& cluster : part.result.clusters) {
    if (!cluster.valid.weights) continue;
    const LobeFit found = fit(model, sample_cells(basis, cluster.raw, kFitGrid));
    const std::string name = "cluster_" + std::to_string(cluster.index);
    const std::string head = fmt::format(
        "# {} fitted to the reconstruction (L1): mean error {:.3f}, RMS {:.3f} in mapped units\n{}",
        describe(found.lobe.model).name, found.mapped_l1, found.mapped_rms,
        called_for(part.samples.at(static_cast<std::size_t>(cluster.index)), basis));
    write_text_file(dir / (name + ".yaml"), head + material_yaml(name, found.lobe));
  }
}

}  // namespace brdfgate
