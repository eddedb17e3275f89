// brdfgate study: is the gate, as a gauge, good enough for a tolerance?
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "app/commands/commands.hpp"
#include "app/plot.hpp"
#include "app/progress.hpp"
#include "app/result_json.hpp"
#include "app/session.hpp"
#include "app/study_input.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// AIAG: over this share of the total variation a gauge is not acceptable.
constexpr double kMostGrr = 0.3;
constexpr double kFewestCategories = 5;

struct StudyOptions {
  SessionOptions session;
  std::vector<fs::path> from;
  fs::path table;
  fs::path picture;
  ReadingChoice reading;
  double tolerance = 0;
  double reference = 0;
  double reference_sigma = 0;
  bool reference_given = false;
  bool average_range = false;
};

json finite(double v) {
  return std::isfinite(v) ? json(v) : json(nullptr);
}

json read_results(const fs::path& file) {
  std::ifstream in(file);
  json document;
  try {
    document = json::parse(in);
  } catch (const json::exception& error) {
    throw InputError(file.string(), std::string("is no JSON: ") + error.what());
  }
  if (document.value("schema", "") != "brdfgate.result/1" || !document["parts"].is_array()) {
    throw InputError(file.string(), "is no result", "schema: brdfgate.result/1");
  }
  return document["parts"];
}

/// The reading of parts out of recordings and result files; opens the station on first need.
class ReadingSource {
 public:
  explicit ReadingSource(const StudyOptions& options) : options_(options) {}

  /// All under one path: a result file, or a folder of recordings and result files.
  std::vector<double> values(const fs::path& path) {
    std::vector<double> out;
    if (path.extension() == ".json") {
      for (const json& part : read_results(path))
        out.push_back(reading_of(part, options_.reading, path.string()));
      return out;
    }
    std::vector<fs::path> results;
    std::error_code error;
    for (fs::directory_iterator entry(path, error), end; !error && entry != end;
         entry.increment(error)) {
      if (entry->path().extension() == ".json") results.push_back(entry->path());
    }
    std::sort(results.begin(), results.end());
    for (const fs::path& file : results) {
      const auto more = values(file);
      out.insert(out.end(), more.begin(), more.end());
    }
    if (!results.empty()) return out;
    for (const fs::path& dir : find_recordings(path))
      out.push_back(inspected(dir));
    return out;
  }

 private:
  struct Gate {
    StationConfig config;
    Inspector inspector;
    std::optional<RecipeInForce> recipe;
  };

  double inspected(const fs::path& dir) {
    if (!gate_) {
      const StationConfig config = load_config(options_.session);
      gate_ = std::make_unique<Gate>(Gate{config, load_inspector(config), std::nullopt});
      gate_->recipe = load_recipe(config, gate_->inspector);
    }
    const Recording recording =
        load_part(dir, gate_->config, gate_->inspector, !options_.session.calibration.empty());
    const Inspection part =
        gate_->inspector.inspect(recording.capture, gate_->recipe ? &*gate_->recipe : nullptr);
    return reading_of(part_to_json(recording.name, part.result, {}), options_.reading,
                      dir.string());
  }

  const StudyOptions& options_;
  std::unique_ptr<Gate> gate_;
};

void require_source(const StudyOptions& options, const char* from) {
  if (options.from.empty() == options.table.empty()) {
    throw InputError("study", "takes its values from one source",
                     std::string(from) + " or --table");
  }
}

std::vector<double> type1_values(const StudyOptions& options) {
  require_source(options, "--from");
  std::vector<double> out;
  if (!options.table.empty()) {
    for (const StudyValue& value : read_study_table(options.table))
      out.push_back(value.value);
    return out;
  }
  ReadingSource source(options);
  Progress progress("reading", static_cast<int>(options.from.size()));
  for (const fs::path& path : options.from) {
    const auto more = source.values(path);
    out.insert(out.end(), more.begin(), more.end());
    progress.advance();
  }
  return out;
}

/// One folder an operator, its subfolders the parts, in each the trials.
std::vector<StudyValue> grr_values(const StudyOptions& options) {
  require_source(options, "--operators");
  if (!options.table.empty()) return read_study_table(options.table);
  ReadingSource source(options);
  std::vector<StudyValue> out;
  Progress progress("reading", static_cast<int>(options.from.size()));
  for (const fs::path& folder : options.from) {
    std::vector<fs::path> parts;
    std::error_code error;
    for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
         entry.increment(error)) {
      if (entry->is_directory()) parts.push_back(entry->path());
    }
    if (error || parts.empty()) {
      throw InputError(folder.string(), "holds no part", "a folder per part with its trials");
    }
    std::sort(parts.begin(), parts.end());
    for (const fs::path& part : parts) {
      for (const double value : source.values(part))
        out.push_back({folder.filename().string(), part.filename().string(), value});
    }
    progress.advance();
  }
  return out;
}

void draw_type1(const StudyOptions& options, const std::vector<double>& values,
                const Type1Result& r) {
  Plot plot;
  plot.title = fmt::format("{}: {} repeats, Cg {:.2f}", options.reading.name, r.count, r.cg);
  plot.x_label = "repeat";
  plot.y_label = options.reading.name;
  plot.series = {{options.reading.name, {}, values, PlotSeries::Style::LinesPoints}};
  plot.levels = {{"mean", r.mean, 0},
                 {"mean + 3 s", r.mean + 3 * r.s, 1},
                 {"mean - 3 s", r.mean - 3 * r.s, 1}};
  const double centre = options.reference_given ? options.reference : r.mean;
  plot.levels.push_back({"+ 0.1 T", centre + 0.1 * options.tolerance, 2});
  plot.levels.push_back({"- 0.1 T", centre - 0.1 * options.tolerance, 2});
  write_plot(plot, options.picture);
}

json type1_json(const StudyOptions& options, const std::vector<double>& values,
                const Type1Result& r) {
  json out = {{"schema", "brdfgate.study_type1/1"},
              {"reading", options.reading.name},
              {"cluster", options.reading.cluster},
              {"values", values},
              {"tolerance", options.tolerance},
              {"count", r.count},
              {"mean", r.mean},
              {"s", r.s},
              {"cg", finite(r.cg)},
              {"least_tolerance", r.least_tolerance},
              {"capable", r.capable()}};
  if (r.bias) {
    out["reference"] = options.reference;
    out["bias"] = *r.bias;
    out["cgk"] = finite(*r.cgk);
    out["bias_t"] = finite(*r.bias_t);
    out["q_ms"] = *r.q_ms;
  }
  return out;
}

void print_type1(const StudyOptions& options, const Type1Result& r) {
  fmt::print("{} repeats of {}: mean {:.5g}, s {:.3g}\n", r.count, options.reading.name, r.mean,
             r.s);
  fmt::print("Cg    {:.2f}  0.2 T / (6 s), T = {:.5g}; {:.2f} or more (Bosch booklet 10)\n", r.cg,
             options.tolerance, Type1Result::kCapable);
  if (r.bias) {
    fmt::print("Cgk   {:.2f}  (0.1 T - |bias|) / (3 s); bias {:+.3g}, t = {:.2f} with {} degrees\n",
               *r.cgk, *r.bias, *r.bias_t, r.count - 1);
    fmt::print("Q_MS  {:.1f} %  2 U / T with k = 2; {:.0f} % or less (VDA 5)\n", 100 * *r.q_ms,
               100 * Type1Result::kMostQms);
  }
  fmt::print("Cg reaches {:.2f} from T = {:.4g} on\n", Type1Result::kCapable, r.least_tolerance);
  if (r.count < 25) fmt::print("note: {} repeats; a study takes 25 to 50\n", r.count);
  fmt::print("{}\n", r.capable() ? "capable" : "not capable");
}

int type1(const StudyOptions& options) {
  const std::vector<double> values = type1_values(options);
  Type1Input input{values, options.tolerance, {}, options.reference_sigma};
  if (options.reference_given) input.reference = options.reference;
  const Type1Result r = type1_study(input);
  if (!options.picture.empty()) draw_type1(options, values, r);
  if (options.session.json) {
    fmt::print("{}\n", type1_json(options, values, r).dump(2));
  } else {
    print_type1(options, r);
  }
  return r.capable() ? kExitYes : kExitNo;
}

bool acceptable(const GrrResult& r) {
  return r.grr_share <= kMostGrr && std::floor(r.ndc) >= kFewestCategories;
}

json grr_json(const StudyOptions& options, const GrrLayout& layout, const GrrResult& r) {
  json out = {{"schema", "brdfgate.study_grr/1"},
              {"reading", options.reading.name},
              {"cluster", options.reading.cluster},
              {"method", options.average_range ? "average_range" : "anova"},
              {"parts", layout.parts},
              {"operators", layout.operators},
              {"trials", layout.input.values.front().cols()},
              {"ev", r.ev},
              {"av", r.av},
              {"interaction", r.interaction},
              {"grr", r.grr},
              {"pv", r.pv},
              {"tv", r.tv},
              {"grr_percent", 100 * r.grr_share},
              {"ndc", finite(std::floor(r.ndc))},
              {"acceptable", acceptable(r)}};
  if (r.tolerance_share) out["tolerance_percent"] = 100 * *r.tolerance_share;
  for (const VarianceLine& line : r.table) {
    out["anova"].push_back({{"source", line.source},
                            {"dof", line.dof},
                            {"ss", line.ss},
                            {"ms", line.ms},
                            {"f", finite(line.f)},
                            {"p", line.p}});
  }
  return out;
}

void print_grr(const StudyOptions& options, const GrrLayout& layout, const GrrResult& r) {
  fmt::print("{}: {} parts, {} operator(s), {} trials, {}\n", options.reading.name,
             layout.parts.size(), layout.operators.size(), layout.input.values.front().cols(),
             options.average_range ? "average and range" : "analysis of variance");
  for (const VarianceLine& line : r.table) {
    fmt::print("  {:<16} dof {:>4}  SS {:>11.5g}  MS {:>11.5g}", line.source, line.dof, line.ss,
               line.ms);
    if (line.f > 0) fmt::print("  F {:.3f}  p {:.3f}", line.f, line.p);
    fmt::print("\n");
  }
  const auto share = [&](const char* name, double sigma) {
    fmt::print("  {:<28} sigma {:>10.4g}  {:>6.2f} % of total\n", name, sigma,
               r.tv > 0 ? 100 * sigma / r.tv : 0);
  };
  share("repeatability (EV)", r.ev);
  share("reproducibility (AV)", r.av);
  if (r.interaction > 0) share("operator x part", r.interaction);
  share("gauge (GRR)", r.grr);
  share("parts (PV)", r.pv);
  if (r.tolerance_share) {
    fmt::print("  gauge: {:.2f} % of the tolerance {:.5g}\n", 100 * *r.tolerance_share,
               options.tolerance);
  }
  fmt::print("  distinct categories (ndc): {:.0f}\n", std::floor(r.ndc));
  fmt::print("{}\n",
             acceptable(r) ? "acceptable" : "not acceptable (AIAG: %GRR to 30, ndc from 5)");
}

void draw_grr(const StudyOptions& options, const GrrLayout& layout, const GrrResult& r) {
  Plot plot;
  plot.title = fmt::format("{}: %GRR {:.1f}, ndc {:.0f}", options.reading.name, 100 * r.grr_share,
                           std::floor(r.ndc));
  plot.x_label = "part";
  plot.y_label = options.reading.name;
  plot.x_names = layout.parts;
  for (std::size_t o = 0; o < layout.operators.size(); ++o) {
    PlotSeries series{layout.operators[o].empty() ? "all" : layout.operators[o],
                      {},
                      {},
                      PlotSeries::Style::Points};
    for (std::size_t p = 0; p < layout.parts.size(); ++p) {
      for (const double value : layout.input.values[p].row(static_cast<Eigen::Index>(o))) {
        series.x.push_back(static_cast<double>(p));
        series.y.push_back(value);
      }
    }
    plot.series.push_back(std::move(series));
  }
  write_plot(plot, options.picture);
}

int grr(const StudyOptions& options) {
  GrrLayout layout = grr_layout(grr_values(options));
  layout.input.tolerance = options.tolerance;
  const GrrResult r =
      options.average_range ? grr_average_range(layout.input) : grr_anova(layout.input);
  if (!options.picture.empty()) draw_grr(options, layout, r);
  if (options.session.json) {
    fmt::print("{}\n", grr_json(options, layout, r).dump(2));
  } else {
    print_grr(options, layout, r);
  }
  return acceptable(r) ? kExitYes : kExitNo;
}

void add_common(CLI::App& command, StudyOptions& o) {
  o.session.add_to(command);
  o.session.add_overrides_to(command);
  command.add_option("--table", o.table, "CSV with columns part, operator, value instead");
  command.add_option("--reading", o.reading.name, reading_names())->default_str("gloss_60");
  command.add_option("--cluster", o.reading.cluster, "which region's, from 0")
      ->check(CLI::Range(0, 7));
  command.add_option("--picture", o.picture, "PNG to draw");
}

}  // namespace

void add_study(CLI::App& tool, int& exit_code) {
  CLI::App* study = tool.add_subcommand("study", "gauge capability of a reading");
  study->require_subcommand(1);
  auto one = std::make_shared<StudyOptions>();
  CLI::App* first =
      study->add_subcommand("type1", "one part again and again: Cg, Cgk (booklet 10, VDA 5)");
  add_common(*first, *one);
  first->add_option("--from", one->from, "recordings, folders of them, or result.json files");
  first->add_option("--tolerance", one->tolerance, "width of the tolerance zone, T")->required();
  const CLI::Option* reference =
      first->add_option("--reference", one->reference, "the part's true value");
  first->add_option("--reference-sigma", one->reference_sigma, "its standard uncertainty");
  first->callback([one, reference, &exit_code] {
    one->reference_given = reference->count() > 0;
    exit_code = type1(*one);
  });
  auto many = std::make_shared<StudyOptions>();
  CLI::App* second =
      study->add_subcommand("grr", "parts by operators by trials: %GRR, ndc (AIAG MSA 4th ed.)");
  add_common(*second, *many);
  second->add_option("--operators", many->from,
                     "a folder per operator (shift, loading, station) with a folder per part with "
                     "its trials: recordings or result.json files");
  second->add_option("--tolerance", many->tolerance, "for the share of it");
  second->add_flag("--average-range", many->average_range, "instead of the analysis of variance");
  second->callback([many, &exit_code] { exit_code = grr(*many); });
}

}  // namespace brdfgate
