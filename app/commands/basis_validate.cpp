// brdfgate basis validate: reconstruction error per material, on materials the basis should not
// have seen.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "app/commands/basis_commands.hpp"
#include "app/progress.hpp"
#include "app/session.hpp"
#include "model/error.hpp"
#include "model/reconstruction.hpp"
#include "model/validation.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

struct ValidateOptions {
  fs::path basis;
  std::vector<fs::path> materials;
  std::string only;
  double eta = kRidgeEta;
  bool json = false;
};

struct MaterialError {
  std::string name;
  bool seen = false;  ///< the basis was trained on a material of this name
  BrdfDifference difference;
};

MaterialError measure(const Basis& basis, const std::string& name, const fs::path& file,
                      double eta) {
  const auto truth = MerlBrdf::open(file);
  const Weights weights = ridge(basis, observe_exactly(*truth), eta);
  return {name, false, compare(tabulate(basis, weights), *truth)};
}

std::vector<MaterialError> validate(const ValidateOptions& options) {
  const auto basis = Basis::open(options.basis);
  const std::set<std::string> trained = read_names(basis->info().training_set);
  std::map<std::string, fs::path> files = find_materials(options.materials);
  if (!options.only.empty()) keep_only(files, options.only);
  std::vector<MaterialError> errors;
  Progress progress("validating", static_cast<int>(files.size()));
  for (const auto& [name, file] : files) {
    errors.push_back(measure(*basis, name, file, options.eta));
    errors.back().seen = trained.count(name) != 0;
    progress.advance();
  }
  return errors;
}

struct Summary {
  double mean = 0;
  double median = 0;
  double p90 = 0;
};

Summary summarise(const std::vector<MaterialError>& errors) {
  std::vector<double> rms;
  for (const MaterialError& e : errors)
    rms.push_back(e.difference.mapped_rms);
  std::sort(rms.begin(), rms.end());
  Summary s;
  for (const double r : rms)
    s.mean += r / static_cast<double>(rms.size());
  const auto at = [&](double q) {
    return rms[static_cast<std::size_t>(std::lround(q * static_cast<double>(rms.size() - 1)))];
  };
  s.median = at(0.5);
  s.p90 = at(0.9);
  return s;
}

void print_json(const std::vector<MaterialError>& errors, const Summary& s) {
  nlohmann::json materials = nlohmann::json::array();
  for (const MaterialError& e : errors) {
    materials.push_back({{"name", e.name},
                         {"seen", e.seen},
                         {"mapped_rms", e.difference.mapped_rms},
                         {"mapped_rms_per_channel", e.difference.mapped_rms_per_channel}});
  }
  const nlohmann::json document = {{"schema", "brdfgate.basis_validation/1"},
                                   {"mean", s.mean},
                                   {"median", s.median},
                                   {"p90", s.p90},
                                   {"materials", std::move(materials)}};
  fmt::print("{}\n", document.dump(2));
}

void print_text(const std::vector<MaterialError>& errors, const Summary& s) {
  for (const MaterialError& e : errors) {
    fmt::print("{:<28} {:.4f}{}\n", e.name, e.difference.mapped_rms,
               e.seen ? "  (trained on)" : "");
  }
  fmt::print("mean {:.4f}  median {:.4f}  90th percentile {:.4f}  of {} materials\n", s.mean,
             s.median, s.p90, errors.size());
}

}  // namespace

void add_basis_validate(CLI::App& basis, int& exit_code) {
  auto options = std::make_shared<ValidateOptions>();
  CLI::App* command = basis.add_subcommand(
      "validate", "reconstruction error per material from 298 exact directions (ridge)");
  command->add_option("basis", options->basis, "basis file")->required();
  command->add_option("--materials", options->materials, "folders of MERL .binary files")
      ->required();
  command->add_option("--only", options->only,
                      "these materials: names with commas, or a file of names");
  command->add_option("--eta", options->eta, "ridge parameter")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_flag("--json", options->json, "print one JSON document on stdout");
  command->callback([options, &exit_code] {
    const std::vector<MaterialError> errors = validate(*options);
    const Summary summary = summarise(errors);
    if (options->json) {
      print_json(errors, summary);
    } else {
      print_text(errors, summary);
    }
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
