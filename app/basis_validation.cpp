#include "app/basis_validation.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <numeric>
#include <set>

#include "app/plot.hpp"
#include "app/temp_folder.hpp"
#include "model/merl.hpp"
#include "model/parallel.hpp"

namespace brdfgate {
namespace {

using Estimators = std::vector<std::shared_ptr<const Estimator>>;

Estimators make_estimators(const std::shared_ptr<const Basis>& basis,
                           const ValidationMethods& methods) {
  std::vector<std::string> names = methods.names;
  if (names.empty()) names = {"", "ridge"};
  Estimators estimators;
  std::set<std::string> made;
  for (const std::string& name : names) {
    auto estimator = make_estimator({name, methods.eta}, basis);
    if (made.insert(estimator->name()).second) estimators.push_back(std::move(estimator));
  }
  return estimators;
}

std::set<std::string> trained_on(const Basis& basis) {
  std::set<std::string> names;
  const std::string& list = basis.info().training_set;
  for (std::size_t start = 0; start <= list.size();) {
    const std::size_t end = std::min(list.find(',', start), list.size());
    names.insert(list.substr(start, end - start));
    start = end + 1;
  }
  return names;
}

std::vector<ReconstructionError> errors_of_material(const Basis& basis,
                                                    const Estimators& estimators,
                                                    const std::filesystem::path& file) {
  const auto truth = MerlBrdf::open(file);
  const BinnedSamples samples = observe_exactly(*truth);
  std::vector<ReconstructionError> errors;
  errors.reserve(estimators.size());
  for (const auto& estimator : estimators)
    errors.push_back(reconstruction_error(*truth, basis, estimator->estimate(samples)));
  return errors;
}

/// Materials of one fold to train on, and to test with.
struct Fold {
  std::vector<TrainingMaterial> training;
  std::vector<TestMaterial> tests;
};
Fold make_fold(const std::vector<TrainingMaterial>& training,
               const std::vector<TestMaterial>& tests, const std::vector<int>& fold_of,
               int number) {
  Fold fold;
  std::set<std::string> left_out;
  for (std::size_t i = 0; i < tests.size(); ++i) {
    if (fold_of[i] != number) continue;
    fold.tests.push_back(tests[i]);
    left_out.insert(tests[i].name);
  }
  std::copy_if(training.begin(), training.end(), std::back_inserter(fold.training),
               [&](const TrainingMaterial& m) { return left_out.count(m.name) == 0; });
  return fold;
}

/// A part of a longer work's progress.
ShareDone part_of(const ShareDone& whole, double start, double length) {
  if (!whole) return {};
  return [&whole, start, length](double share) { whole(start + length * share); };
}

}  // namespace

std::vector<double> BasisValidation::errors_of(std::size_t method) const {
  std::vector<double> errors;
  errors.reserve(materials.size());
  for (const MaterialErrors& m : materials)
    errors.push_back(m.errors[method].mapped_rms);
  return errors;
}

std::vector<std::size_t> BasisValidation::worst_first(std::size_t method) const {
  std::vector<std::size_t> order(materials.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return materials[a].errors[method].mapped_rms > materials[b].errors[method].mapped_rms;
  });
  return order;
}

BasisValidation validate_basis(const std::shared_ptr<const Basis>& basis,
                               const std::vector<TestMaterial>& materials,
                               const ValidationMethods& methods, const ShareDone& progress) {
  constexpr int kAtOnce = 4;  // materials between two reports of progress
  const Estimators estimators = make_estimators(basis, methods);
  const std::set<std::string> trained = trained_on(*basis);
  BasisValidation validation;
  for (const auto& estimator : estimators)
    validation.methods.push_back(estimator->name());
  validation.materials.resize(materials.size());
  const int count = static_cast<int>(materials.size());
  for (int first = 0; first < count; first += kAtOnce) {
    parallel_for_each(std::min(kAtOnce, count - first), [&](int i) {
      const auto number = static_cast<std::size_t>(first) + static_cast<std::size_t>(i);
      const TestMaterial& m = materials[number];
      validation.materials[number] = {m.name, trained.count(m.name) != 0, -1,
                                      errors_of_material(*basis, estimators, m.file)};
    });
    if (progress) progress(std::min(1.0, double(first + kAtOnce) / count));
  }
  return validation;
}

BasisValidation cross_validate(const std::vector<TrainingMaterial>& training,
                               const std::vector<TestMaterial>& tests,
                               const CrossValidation& options, const ShareDone& progress) {
  constexpr double kTrainingShare = 0.6;  // of a fold's time, for the progress bar
  const std::vector<int> fold_of =
      assign_folds(static_cast<int>(tests.size()), options.folds, options.seed);
  const TempFolder folder;
  BasisValidation all;
  for (int number = 0; number < options.folds; ++number) {
    const Fold fold = make_fold(training, tests, fold_of, number);
    const double start = double(number) / options.folds;
    TrainingOptions with = options.training;
    with.progress = part_of(progress, start, kTrainingShare / options.folds);
    const auto file = folder / "fold.basis";
    train_basis(fold.training, with, file);
    BasisValidation one = validate_basis(Basis::open(file), fold.tests, options.methods,
                                         part_of(progress, start + kTrainingShare / options.folds,
                                                 (1 - kTrainingShare) / options.folds));
    all.methods = one.methods;
    for (MaterialErrors& m : one.materials) {
      m.fold = number;
      all.materials.push_back(std::move(m));
    }
  }
  std::sort(all.materials.begin(), all.materials.end(),
            [](const MaterialErrors& a, const MaterialErrors& b) { return a.name < b.name; });
  return all;
}

std::string to_csv(const BasisValidation& validation) {
  std::string csv = "name,seen,fold,method,mapped_rms,mapped_rms_r,mapped_rms_g,mapped_rms_b\n";
  for (const MaterialErrors& m : validation.materials) {
    for (std::size_t i = 0; i < validation.methods.size(); ++i) {
      const ReconstructionError& e = m.errors[i];
      csv += fmt::format("{},{},{},{},{:.6f},{:.6f},{:.6f},{:.6f}\n", m.name, m.seen ? 1 : 0,
                         m.fold < 0 ? "" : std::to_string(m.fold), validation.methods[i],
                         e.mapped_rms, e.per_channel[0], e.per_channel[1], e.per_channel[2]);
    }
  }
  return csv;
}

void draw_errors(const BasisValidation& validation, const std::string& title,
                 const std::filesystem::path& png) {
  Plot plot;
  plot.title = title;
  plot.y_label = "RMS error, mapped units";
  const std::vector<std::size_t> order = validation.worst_first(0);
  for (auto i = order.rbegin(); i != order.rend(); ++i)
    plot.x_names.push_back(validation.materials[*i].name +
                           (validation.materials[*i].seen ? " (seen)" : ""));
  for (std::size_t method = 0; method < validation.methods.size(); ++method) {
    const std::string& name = validation.methods[method];
    PlotSeries series;
    series.label = name;
    for (auto i = order.rbegin(); i != order.rend(); ++i)
      series.y.push_back(validation.materials[*i].errors[method].mapped_rms);
    plot.series.push_back(std::move(series));
    const ErrorSummary s = summarise(validation.errors_of(method));
    plot.levels.push_back({fmt::format("{}, mean {:.3f}", name, s.mean), s.mean, method});
    plot.levels.push_back({fmt::format("{}, median {:.3f}", name, s.median), s.median, method});
    plot.levels.push_back({fmt::format("{}, 90th percentile {:.3f}", name, s.p90), s.p90, method});
  }
  plot.width_px = std::max(900, 200 + 16 * static_cast<int>(order.size()));
  write_plot(plot, png);
}

}  // namespace brdfgate
