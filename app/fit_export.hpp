// Reconstructed materials as the parameters of an analytic model, for other people's renderers.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "app/inspector.hpp"

namespace brdfgate {

/// Adds --fit MODEL: a model of model/lobes.hpp, or `best` for the one that fits best; empty when
/// not given. Returns the option.
CLI::Option* add_fit_option(CLI::App& command, std::string& model);

/// Writes cluster_<n>.yaml for every cluster with valid weights: the model fitted to the whole
/// reconstruction, as an entry of a scene file's `materials`; in comments its error, and the
/// smallest model that the cluster's samples call for (model/parsimony.hpp). Nothing where `model`
/// is empty. Throws InputError where it cannot write.
void export_fits(const std::filesystem::path& dir, const Inspection& part, const Basis& basis,
                 const std::string& model);

}  // namespace brdfgate
