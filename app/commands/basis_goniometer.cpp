// brdfgate basis goniometer: from a few directions of a goniometric list, how well are the others
// predicted?
#include <fmt/core.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "app/commands/basis_commands.hpp"
#include "app/session.hpp"
#include "model/goniometric.hpp"
#include "model/prediction.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

struct GoniometerOptions {
  fs::path basis;
  fs::path list;
  std::vector<double> bands{650, 550, 450};
  int choose = 20;
  std::string criterion = "expected-error";
  bool json = false;
};

struct Outcome {
  std::size_t directions = 0;
  std::vector<std::size_t> chosen;
  std::vector<HalfDiff> angles;  ///< of the chosen
  std::vector<PredictionError> errors;
};

Outcome evaluate(const GoniometerOptions& options) {
  const auto basis = Basis::open(options.basis);
  const BinnedSamples all = to_samples(read_goniometric(options.list),
                                       {options.bands[0], options.bands[1], options.bands[2]});
  const auto criterion = options.criterion == "determinant" ? DirectionCriterion::determinant
                                                            : DirectionCriterion::expected_error;
  Outcome outcome;
  outcome.directions = all.bins.size();
  outcome.chosen = choose_directions(*basis, all.directions(), options.choose, criterion);
  for (const std::size_t i : outcome.chosen)
    outcome.angles.push_back(all.bins[i].angles);
  outcome.errors = predict_the_others(basis, all, outcome.chosen);
  return outcome;
}

nlohmann::json to_json(const GoniometerOptions& options, const Outcome& outcome) {
  nlohmann::json methods = nlohmann::json::array();
  for (const PredictionError& e : outcome.errors) {
    nlohmann::json row = {{"method", e.method}};
    if (e.failed.empty()) {
      row.update({{"mapped_rms", e.mapped_rms},
                  {"mapped_rms_per_channel", e.channels},
                  {"median_absolute", e.median}});
    } else {
      row["failed"] = e.failed;
    }
    methods.push_back(std::move(row));
  }
  return {{"schema", "brdfgate.goniometer/1"}, {"list", options.list.string()},
          {"directions", outcome.directions},  {"bands_nm", options.bands},
          {"criterion", options.criterion},    {"chosen", outcome.chosen},
          {"methods", std::move(methods)}};
}

void print_text(const GoniometerOptions& options, const Outcome& outcome) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  fmt::print("{} of {} directions, chosen by {} (theta_h theta_d phi_d, degrees):\n",
             outcome.chosen.size(), outcome.directions, options.criterion);
  for (const HalfDiff& a : outcome.angles) {
    fmt::print("  {:5.1f} {:5.1f} {:6.1f}\n", a.theta_h * kDegrees, a.theta_d * kDegrees,
               a.phi_d * kDegrees);
  }
  fmt::print("mapped error at the other {}:\n  {:<18}  {:>6}  {:>6}  {:>6}  {:>6}  {:>6}\n",
             outcome.directions - outcome.chosen.size(), "method", "RMS",
             fmt::format("{:.0f}", options.bands[0]), fmt::format("{:.0f}", options.bands[1]),
             fmt::format("{:.0f}", options.bands[2]), "median");
  for (const PredictionError& e : outcome.errors) {
    if (!e.failed.empty()) {
      fmt::print("  {:<18}  {}\n", e.method, e.failed);
      continue;
    }
    fmt::print("  {:<18}  {:6.3f}  {:6.3f}  {:6.3f}  {:6.3f}  {:6.3f}\n", e.method, e.mapped_rms,
               e.channels[0], e.channels[1], e.channels[2], e.median);
  }
}

}  // namespace

void add_basis_goniometer(CLI::App& basis, int& exit_code) {
  auto options = std::make_shared<GoniometerOptions>();
  CLI::App* command = basis.add_subcommand(
      "goniometer", "from a few directions of a goniometric list predict the others");
  command->add_option("basis", options->basis, "basis file")->required();
  command
      ->add_option("--list", options->list,
                   "text: theta_i phi_i theta_o phi_o values... (radians, 1/sr)")
      ->required();
  command
      ->add_option("--bands", options->bands,
                   "wavelengths taken as R, G, B where the list is spectral, nm")
      ->delimiter(',')
      ->expected(3)
      ->capture_default_str();
  command->add_option("--choose", options->choose, "directions to predict from")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command
      ->add_option("--criterion", options->criterion,
                   "how they are chosen, by the basis alone: least mean posterior variance, or "
                   "largest determinant")
      ->check(CLI::IsMember({"expected-error", "determinant"}))
      ->capture_default_str();
  command->add_flag("--json", options->json, "print one JSON document on stdout");
  command->callback([options, &exit_code] {
    const Outcome outcome = evaluate(*options);
    if (options->json) {
      fmt::print("{}\n", to_json(*options, outcome).dump(2));
    } else {
      print_text(*options, outcome);
    }
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
