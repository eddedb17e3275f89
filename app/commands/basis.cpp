// brdfgate basis: trains a basis from measured materials and tells what a basis file is made of.
#include <fmt/core.h>
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "app/commands/basis_commands.hpp"
#include "app/commands/commands.hpp"
#include "app/progress.hpp"
#include "app/session.hpp"
#include "model/basis_training.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

struct BuildOptions {
  std::vector<fs::path> materials;
  std::vector<fs::path> refits;
  fs::path out;
  int components = 40;
  int exemplars = 600;
  std::vector<int> grid{45, 45, 45};
  std::string leave_out;
  std::string licence;
  std::string attribution;
  bool json = false;
};

/// Each material once, whatever the number of its fits.
std::string unique_names(const std::string& training_set) {
  std::string list;
  for (const std::string& name : read_names(training_set))
    list += (list.empty() ? "" : ",") + name;
  return list;
}

nlohmann::json to_json(const fs::path& file, const Basis& basis) {
  const BasisInfo& info = basis.info();
  const Eigen::VectorXd& s = basis.singular_values();
  return {{"schema", "brdfgate.basis/1"},
          {"file", file.string()},
          {"bytes", fs::file_size(file)},
          {"version", info.version},
          {"grid", {info.grid.theta_h, info.grid.theta_d, info.grid.phi_d}},
          {"valid_cells", info.valid_cells},
          {"components", info.components},
          {"observations", info.observations},
          {"exemplars", info.exemplars},
          {"epsilon", info.epsilon},
          {"singular_values", std::vector<double>(s.data(), s.data() + s.size())},
          {"training_set", info.training_set},
          {"training_hash", info.training_hash},
          {"licence", info.licence},
          {"attribution", info.attribution},
          {"checksum", info.checksum}};
}

void print_info(const fs::path& file, bool json) {
  const auto basis = Basis::open(file);
  if (json) {
    fmt::print("{}\n", to_json(file, *basis).dump(2));
    return;
  }
  const BasisInfo& info = basis->info();
  const Eigen::VectorXd& s = basis->singular_values();
  fmt::print("basis {} (version {}, {:.2f} MB)\n", file.string(), info.version,
             static_cast<double>(fs::file_size(file)) / 1e6);
  fmt::print("  grid          {} x {} x {} (theta_h, theta_d, phi_d), {} cells above the horizon\n",
             info.grid.theta_h, info.grid.theta_d, info.grid.phi_d, info.valid_cells);
  fmt::print("  components    {} of {} observations, singular values {:.4g} to {:.4g}\n",
             info.components, info.observations, s[0], s[s.size() - 1]);
  fmt::print("  mapping       epsilon {}\n", info.epsilon);
  fmt::print("  training set  {}\n", unique_names(info.training_set));
  fmt::print("  training hash {}\n", info.training_hash);
  fmt::print("  licence       {}\n", info.licence);
  fmt::print("  attribution   {}\n", info.attribution);
  fmt::print("  checksum      {}\n", info.checksum);
}

std::vector<TrainingMaterial> materials_of(const BuildOptions& options) {
  MaterialFiles found = find_materials(options.materials);
  if (!options.leave_out.empty()) leave_out(found, options.leave_out);
  std::set<std::string> ignored;
  std::vector<TrainingMaterial> materials = with_refits(found, options.refits, ignored);
  if (!ignored.empty()) {
    fmt::print(stderr, "refits of {} material(s) that are not trained on are ignored: {}\n",
               ignored.size(), fmt::join(ignored, ", "));
  }
  return materials;
}

void build(const BuildOptions& options) {
  const std::vector<TrainingMaterial> materials = materials_of(options);
  Progress progress("training", 1);
  TrainingOptions training;
  training.grid = {options.grid[0], options.grid[1], options.grid[2]};
  training.components = options.components;
  training.exemplars.microfacet = options.exemplars / 3;
  training.exemplars.recombined = options.exemplars - training.exemplars.microfacet;
  training.licence = options.licence;
  training.attribution = options.attribution;
  training.progress = [&progress](double share) { progress.update(share); };
  training.checkpoint = options.out.string() + ".checkpoint";
  training.message = [](const std::string& message) {
    fmt::print(stderr, "training {}\n", message);
  };
  train_basis(materials, training, options.out);
}

void add_build(CLI::App& basis, int& exit_code) {
  auto options = std::make_shared<BuildOptions>();
  CLI::App* command = basis.add_subcommand("build", "train a basis from MERL .binary files");
  command
      ->add_option("--materials", options->materials,
                   "MERL .binary files: folders, files, lists of paths (one per line, # comments)")
      ->required();
  command->add_option("--refit", options->refits,
                      "second independent fits of the same materials, by file name");
  command->add_option("--out", options->out, "basis file to write")->required();
  command
      ->add_option("--exemplars", options->exemplars,
                   "materials to derive from the training set for the method gp; 0: ridge only")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  command->add_option("--components", options->components, "principal components to keep")
      ->capture_default_str();
  command->add_option("--grid", options->grid, "cells along theta_h, theta_d, phi_d")
      ->delimiter(',')
      ->expected(3)
      ->capture_default_str();
  command->add_option("--leave-out", options->leave_out,
                      "materials not to train on: names with commas, or a file of names");
  command->add_option("--licence", options->licence, "terms of the data, kept in the file");
  command->add_option("--attribution", options->attribution,
                      "origin of the data, kept in the file");
  command->add_flag("--json", options->json, "print one JSON document on stdout");
  command->callback([options, &exit_code] {
    build(*options);
    print_info(options->out, options->json);
    exit_code = kExitYes;
  });
}

void add_info(CLI::App& basis, int& exit_code) {
  struct Options {
    fs::path file;
    bool json = false;
  };
  auto options = std::make_shared<Options>();
  CLI::App* command = basis.add_subcommand("info", "what a basis file is made of");
  command->add_option("basis", options->file, "basis file")->required();
  command->add_flag("--json", options->json, "print one JSON document on stdout");
  command->callback([options, &exit_code] {
    print_info(options->file, options->json);
    exit_code = kExitYes;
  });
}

}  // namespace

void add_basis(CLI::App& tool, int& exit_code) {
  CLI::App* basis = tool.add_subcommand("basis", "the reflectance basis: build it, look into it");
  basis->require_subcommand(1);
  add_build(*basis, exit_code);
  add_info(*basis, exit_code);
  add_basis_validate(*basis, exit_code);
  add_basis_goniometer(*basis, exit_code);
}

}  // namespace brdfgate
