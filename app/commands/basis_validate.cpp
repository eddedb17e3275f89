// brdfgate basis validate: reconstruction error per material, on materials the basis has not seen.
#include <fmt/core.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "app/basis_validation.hpp"
#include "app/commands/basis_commands.hpp"
#include "app/progress.hpp"
#include "app/session.hpp"
#include "model/error.hpp"
#include "model/mapped_file.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kWorst = 10;

struct ValidateOptions {
  fs::path basis;
  std::vector<fs::path> materials;
  std::string only;
  ValidationMethods methods;
  // Cross-validation.
  int folds = 0;
  std::uint64_t seed = 1;
  std::vector<fs::path> refits;
  std::vector<fs::path> tests;
  int components = 40;
  std::vector<int> grid{90, 36, 36};
  int exemplars = 600;
  // Output.
  fs::path csv;
  fs::path picture;
  bool json = false;
};

std::vector<TestMaterial> tests_of(const MaterialFiles& files) {
  std::vector<TestMaterial> tests;
  for (const auto& [name, file] : files)
    tests.push_back({name, file});
  return tests;
}

/// The fit to test on; of its materials those that are trained on.
MaterialFiles test_files(const ValidateOptions& options, const MaterialFiles& materials) {
  if (options.tests.empty()) return materials;
  MaterialFiles tests = find_materials(options.tests);
  std::erase_if(tests, [&](const auto& test) { return materials.count(test.first) == 0; });
  if (tests.empty()) {
    throw InputError("--test", "has no material of a name under --materials",
                     "another fit of the same materials");
  }
  return tests;
}

BasisValidation validate_folds(const ValidateOptions& options) {
  const MaterialFiles materials = find_materials(options.materials);
  MaterialFiles tests = test_files(options, materials);
  if (!options.only.empty()) keep_only(tests, options.only);
  std::set<std::string> ignored;
  CrossValidation folds;
  folds.folds = options.folds;
  folds.seed = options.seed;
  folds.methods = options.methods;
  folds.training.components = options.components;
  folds.training.grid = {options.grid[0], options.grid[1], options.grid[2]};
  folds.training.exemplars.microfacet = options.exemplars / 3;
  folds.training.exemplars.recombined = options.exemplars - options.exemplars / 3;
  Progress progress("cross-validating", 1);
  return cross_validate(with_refits(materials, options.refits, ignored), tests_of(tests), folds,
                        [&](double share) { progress.update(share); });
}

BasisValidation validate_file(const ValidateOptions& options) {
  MaterialFiles files = find_materials(options.materials);
  if (!options.only.empty()) keep_only(files, options.only);
  const auto basis = Basis::open(options.basis);
  Progress progress("validating", 1);
  return validate_basis(basis, tests_of(files), options.methods,
                        [&](double share) { progress.update(share); });
}

BasisValidation validate(const ValidateOptions& options) {
  const bool by_folds = options.folds != 0;
  if (by_folds == !options.basis.empty()) {
    throw InputError("basis validate",
                     by_folds ? "a basis file and --folds" : "neither a basis file nor --folds",
                     "one of them");
  }
  if (!by_folds && !(options.refits.empty() && options.tests.empty())) {
    throw InputError("basis validate", "--refit and --test go with --folds",
                     "no such option for a basis file");
  }
  return by_folds ? validate_folds(options) : validate_file(options);
}

nlohmann::json methods_json(const BasisValidation& v) {
  nlohmann::json methods = nlohmann::json::array();
  for (std::size_t i = 0; i < v.methods.size(); ++i) {
    const ErrorSummary s = summarise(v.errors_of(i));
    nlohmann::json worst = nlohmann::json::array();
    for (const std::size_t m : v.worst_first(i)) {
      if (worst.size() == kWorst) break;
      worst.push_back(v.materials[m].name);
    }
    methods.push_back({{"method", v.methods[i]},
                       {"mean", s.mean},
                       {"median", s.median},
                       {"p90", s.p90},
                       {"worst", std::move(worst)}});
  }
  return methods;
}

void print_json(const BasisValidation& v, const ValidateOptions& options) {
  nlohmann::json materials = nlohmann::json::array();
  for (const MaterialErrors& m : v.materials) {
    nlohmann::json errors = nlohmann::json::object();
    for (std::size_t i = 0; i < v.methods.size(); ++i) {
      errors[v.methods[i]] = {{"mapped_rms", m.errors[i].mapped_rms},
                              {"mapped_rms_per_channel", m.errors[i].per_channel}};
    }
    nlohmann::json entry = {{"name", m.name}, {"seen", m.seen}, {"errors", std::move(errors)}};
    if (m.fold >= 0) entry["fold"] = m.fold;
    materials.push_back(std::move(entry));
  }
  nlohmann::json document = {{"schema", "brdfgate.basis_validation/1"},
                             {"kind", options.folds > 0 ? "cross_validation" : "held_out"},
                             {"methods", methods_json(v)},
                             {"materials", std::move(materials)}};
  if (options.folds > 0) {
    document["folds"] = options.folds;
    document["seed"] = options.seed;
    document["components"] = options.components;
    document["exemplars"] = options.exemplars;
    document["grid"] = options.grid;
  }
  fmt::print("{}\n", document.dump(2));
}

void print_row(const std::string& name, std::span<const double> values, const char* note = "") {
  fmt::print("{:<28}", name);
  for (const double v : values)
    fmt::print(" {:>10.4f}", v);
  fmt::print("{}\n", note);
}

void print_worst(const BasisValidation& v, std::size_t method) {
  fmt::print("worst by {}:", v.methods[method]);
  const std::vector<std::size_t> order = v.worst_first(method);
  for (std::size_t i = 0; i < std::min(kWorst, order.size()); ++i) {
    const MaterialErrors& m = v.materials[order[i]];
    fmt::print("{} {} {:.3f}", i == 0 ? "" : ",", m.name, m.errors[method].mapped_rms);
  }
  fmt::print("\n");
}

void print_text(const BasisValidation& v) {
  fmt::print("{:<28}", "material");
  for (const std::string& method : v.methods)
    fmt::print(" {:>10}", method);
  fmt::print("\n");
  for (const MaterialErrors& m : v.materials) {
    std::vector<double> errors;
    for (const ReconstructionError& e : m.errors)
      errors.push_back(e.mapped_rms);
    print_row(m.name, errors, m.seen ? "  (trained on)" : "");
  }
  std::vector<double> mean;
  std::vector<double> median;
  std::vector<double> p90;
  for (std::size_t i = 0; i < v.methods.size(); ++i) {
    const ErrorSummary s = summarise(v.errors_of(i));
    mean.push_back(s.mean);
    median.push_back(s.median);
    p90.push_back(s.p90);
  }
  fmt::print("of {} materials\n", v.materials.size());
  print_row("mean", mean);
  print_row("median", median);
  print_row("90th percentile", p90);
  for (std::size_t i = 0; i < v.methods.size(); ++i)
    print_worst(v, i);
}

void write_outputs(const BasisValidation& v, const ValidateOptions& options) {
  if (!options.csv.empty()) {
    AtomicFile file(options.csv);
    const std::string csv = to_csv(v);
    file.write(std::as_bytes(std::span(csv)));
    file.commit();
  }
  if (!options.picture.empty()) {
    draw_errors(v,
                options.folds > 0
                    ? fmt::format("Reconstruction error, {}-fold cross-validation", options.folds)
                    : "Reconstruction error of " + options.basis.filename().string(),
                options.picture);
  }
}

void add_fold_options(CLI::App& command, ValidateOptions& options) {
  command
      .add_option("--folds", options.folds,
                  "instead of a basis file: train without each of so many parts of the materials")
      ->check(CLI::Range(2, 1000));
  command.add_option("--seed", options.seed, "of the partition")->capture_default_str();
  command.add_option("--refit", options.refits,
                     "second fits of the same materials, to train on as well");
  command.add_option("--test", options.tests,
                     "another fit of the same materials, to test on instead");
  command.add_option("--components", options.components, "principal components of the fold bases")
      ->capture_default_str();
  command.add_option("--exemplars", options.exemplars, "derived materials in the fold bases")
      ->check(CLI::Range(0, 10000))
      ->capture_default_str();
  command.add_option("--grid", options.grid, "cells of the fold bases: theta_h, theta_d, phi_d")
      ->delimiter(',')
      ->expected(3)
      ->capture_default_str();
}

}  // namespace

void add_basis_validate(CLI::App& basis, int& exit_code) {
  auto options = std::make_shared<ValidateOptions>();
  CLI::App* command = basis.add_subcommand(
      "validate", "reconstruction error per material from 298 exact directions");
  command->add_option("basis", options->basis, "basis file");
  command
      ->add_option("--materials", options->materials,
                   "MERL .binary files: folders, files, lists of paths")
      ->required();
  command->add_option("--only", options->only,
                      "test on these materials: names with commas, or a file of names");
  command
      ->add_option("--method", options->methods.names,
                   "estimator, may be repeated; the basis' own and ridge when not given")
      ->check(CLI::IsMember(estimator_names()));
  command->add_option("--eta", options->methods.eta, "ridge parameter")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  add_fold_options(*command, *options);
  command->add_option("--csv", options->csv, "table to write");
  command->add_option("--picture", options->picture, "PNG to write (needs gnuplot)");
  command->add_flag("--json", options->json, "print one JSON document on stdout");
  command->callback([options, &exit_code] {
    const BasisValidation validation = validate(*options);
    write_outputs(validation, *options);
    if (options->json) {
      print_json(validation, *options);
    } else {
      print_text(validation);
    }
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
