// brdfgate basis: trains a basis from measured materials and tells what a basis file is made of.
#include <fmt/core.h>

#include <algorithm>
#include <fstream>
#include <map>
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
  fs::path out;
  int components = 40;
  std::vector<int> grid{45, 45, 45};
  std::string leave_out;
  std::string licence;
  std::string attribution;
  bool json = false;
};

std::string trimmed(const std::string& text) {
  constexpr const char* kBlank = " \t\r\n";
  const std::size_t first = text.find_first_not_of(kBlank);
  return first == std::string::npos ? ""
                                    : text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

void leave_out(std::map<std::string, fs::path>& materials, const std::string& list) {
  std::string unknown;
  for (const std::string& name : read_names(list)) {
    if (materials.erase(name) == 0) unknown += (unknown.empty() ? "" : ", ") + name;
  }
  if (!unknown.empty()) {
    throw InputError("--leave-out", "no material of the name " + unknown,
                     "names of files under --materials");
  }
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
  fmt::print("  training set  {}\n", info.training_set);
  fmt::print("  training hash {}\n", info.training_hash);
  fmt::print("  licence       {}\n", info.licence);
  fmt::print("  attribution   {}\n", info.attribution);
  fmt::print("  checksum      {}\n", info.checksum);
}

void build(const BuildOptions& options) {
  std::map<std::string, fs::path> found = find_materials(options.materials);
  if (!options.leave_out.empty()) leave_out(found, options.leave_out);
  std::vector<TrainingMaterial> materials;
  materials.reserve(found.size());
  for (const auto& [name, file] : found)
    materials.push_back({name, file});
  Progress progress("training", 1);
  TrainingOptions training;
  training.grid = {options.grid[0], options.grid[1], options.grid[2]};
  training.components = options.components;
  training.licence = options.licence;
  training.attribution = options.attribution;
  training.progress = [&progress](double share) { progress.update(share); };
  train_basis(materials, training, options.out);
}

void add_build(CLI::App& basis, int& exit_code) {
  auto options = std::make_shared<BuildOptions>();
  CLI::App* command = basis.add_subcommand("build", "train a basis from MERL .binary files");
  command->add_option("--materials", options->materials, "folders of MERL .binary files")
      ->required();
  command->add_option("--out", options->out, "basis file to write")->required();
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

std::map<std::string, fs::path> find_materials(const std::vector<fs::path>& folders) {
  std::map<std::string, fs::path> found;
  for (const fs::path& folder : folders) {
    if (!fs::is_directory(folder)) {
      throw InputError(folder, "is no folder", "a folder of MERL .binary files");
    }
    std::size_t here = 0;
    for (const auto& entry : fs::directory_iterator(folder)) {
      if (entry.path().extension() != ".binary") continue;
      ++here;
      const auto [at, added] = found.emplace(entry.path().stem(), entry.path());
      if (!added) {
        throw InputError(entry.path(), "has the name of " + at->second.string(),
                         "each material once");
      }
    }
    if (here == 0) throw InputError(folder, "holds no MERL .binary file");
  }
  return found;
}

std::set<std::string> read_names(const std::string& list) {
  std::string text = list;
  std::error_code not_a_path;  // a long list is no valid file name
  if (fs::is_regular_file(list, not_a_path)) {
    std::ifstream in(list);
    text.assign(std::istreambuf_iterator<char>(in), {});
    std::replace(text.begin(), text.end(), '\n', ',');
  }
  std::set<std::string> names;
  for (std::size_t start = 0; start <= text.size();) {
    const std::size_t end = std::min(text.find(',', start), text.size());
    const std::string name = trimmed(text.substr(start, end - start));
    if (!name.empty()) names.insert(name);
    start = end + 1;
  }
  return names;
}

void keep_only(std::map<std::string, fs::path>& materials, const std::string& list) {
  std::map<std::string, fs::path> kept;
  for (const std::string& name : read_names(list)) {
    const auto found = materials.find(name);
    if (found == materials.end()) {
      throw InputError("--only", "no material of the name " + name,
                       "names of files under --materials");
    }
    kept.insert(*found);
  }
  materials = std::move(kept);
}

void add_basis(CLI::App& tool, int& exit_code) {
  CLI::App* basis = tool.add_subcommand("basis", "the reflectance basis: build it, look into it");
  basis->require_subcommand(1);
  add_build(*basis, exit_code);
  add_info(*basis, exit_code);
  add_basis_validate(*basis, exit_code);
}

}  // namespace brdfgate
