// brdfgate inspect and reconstruct: recordings to verdicts, weights and BRDF files.
#include <fmt/core.h>

#include "app/commands/commands.hpp"
#include "app/explain.hpp"
#include "app/fit_export.hpp"
#include "app/image_export.hpp"
#include "app/pictures.hpp"
#include "app/progress.hpp"
#include "app/result_json.hpp"
#include "app/session.hpp"
#include "app/stopwatch.hpp"
#include "model/estimators.hpp"
#include "model/hash.hpp"
#include "model/mapped_file.hpp"
#include "model/parsimony.hpp"
#include "model/reconstruction.hpp"

namespace brdfgate {
namespace {

struct InspectOptions {
  SessionOptions session;
  std::vector<std::filesystem::path> from;
  std::filesystem::path export_dir;
  std::filesystem::path evidence_dir;
  std::filesystem::path images_dir;
  std::string fit;     ///< analytic model to export as well; empty: none
  std::string method;  ///< empty: the configuration's
  bool sufficient_model = false;
};

/// One folder for one recording; a folder of the recording's name in it where there are several.
std::filesystem::path folder_for(const std::filesystem::path& base, const std::string& recording,
                                 bool several) {
  const auto dir = several ? base / recording : base;
  std::error_code failed;
  std::filesystem::create_directories(dir, failed);
  if (failed) throw InputError(dir.string(), "cannot be created: " + failed.message());
  return dir;
}

/// cluster_<n>.binary for every cluster with valid weights; names, empty where there is none.
std::vector<std::string> export_brdfs(const std::filesystem::path& dir, const Inspection& part,
                                      const Basis& basis) {
  std::vector<std::string> files;
  for (const ClusterResult& cluster : part.result.clusters) {
    files.emplace_back();
    if (!cluster.valid.weights) continue;
    files.back() = "cluster_" + std::to_string(cluster.index) + ".binary";
    write_merl(dir / files.back(), tabulate(basis, cluster.raw));
  }
  return files;
}

/// Adds to each cluster with valid weights the smallest model that explains its samples.
void add_sufficient_models(nlohmann::json& part_json, const Inspection& part, const Basis& basis) {
  for (std::size_t i = 0; i < part.result.clusters.size(); ++i) {
    if (!part.result.clusters[i].valid.weights) continue;
    const Parsimony parsimony = smallest_sufficient_model(part.samples.at(i), basis);
    const ModelScore& choice = parsimony.choice();
    const bool components = choice.kind == ModelScore::Kind::components;
    part_json["clusters"][i]["sufficient_model"] = {
        {"kind", components ? "components" : std::string(describe(choice.lobe).name)},
        {"components", choice.components},
        {"parameters", choice.parameters},
        {"log_evidence", choice.log_evidence}};
  }
}

void print_part(const std::string& name, const PartResult& r) {
  fmt::print("{}: {}\n", name, r.verdict == Verdict::none ? "measured" : to_text(r.verdict));
  for (const Finding& f : r.findings)
    fmt::print("  {}\n", f.text);
  for (const ClusterResult& c : r.clusters) {
    fmt::print("  {:<10} {:5.1f} % of the part, {} bins", c.name, 100 * c.area_share, c.bins);
    if (!c.valid.weights) {
      fmt::print(", weights not valid\n");
      continue;
    }
    fmt::print(", residual {:.3f}, gloss 20/60/85: {:.1f}/{:.1f}/{:.1f} GU{}", c.raw.residual_rms,
               c.gloss_gu[0], c.gloss_gu[1], c.gloss_gu[2], c.valid.gloss ? "" : " (extrapolated)");
    if (c.valid.colour) fmt::print(", L*a*b* {:.1f} {:.1f} {:.1f}", c.lab[0], c.lab[1], c.lab[2]);
    if (c.deviation.t2_limit > 0) {
      fmt::print(", T2 {:.1f} of {:.1f}, SPE {:.2f} of {:.2f}", c.deviation.t2,
                 c.deviation.t2_limit, c.deviation.spe, c.deviation.spe_limit);
    }
    fmt::print("\n");
  }
}

/// What all parts of one run have in common.
struct Run {
  const InspectOptions& options;
  const StationConfig& config;
  const Inspector& inspector;
  const RecipeInForce* recipe = nullptr;  ///< nullptr: none
  std::function<Inspection(const Capture&)> measure;
  std::string recipe_hash;
};

/// Pictures and the page that explains them; prints the page's text.
void write_evidence(const Run& run, const Inspection& part, const Recording& recording,
                    const CycleTimes& times, bool several) {
  const auto dir = folder_for(run.options.evidence_dir, recording.name, several);
  // A part whose lights did not work has nothing to show.
  if (!part.reflectance.empty()) write_pictures(dir, draw(part, run.inspector));
  const ExplainSource source{part,           run.inspector,           run.recipe,
                             recording.name, run.config.station_hash, run.recipe_hash,
                             times};
  write_explanation(dir, source);
  if (!run.options.session.json) fmt::print("{}", explain_text(source));
}

/// Inspects one recording, writes what was asked for and returns its JSON.
nlohmann::json process(const Run& run, const Recording& recording, bool several) {
  const InspectOptions& options = run.options;
  const Inspector& inspector = run.inspector;
  const Stopwatch watch;
  const Inspection part = run.measure(recording.capture);
  const CycleTimes times{0, watch.elapsed_ms()};
  const bool exporting = !options.export_dir.empty();
  const auto dir =
      exporting ? folder_for(options.export_dir, recording.name, several) : options.export_dir;
  std::vector<std::string> brdfs;
  if (exporting) {
    brdfs = export_brdfs(dir, part, inspector.basis());
    export_fits(dir, part, inspector.basis(), options.fit);
  }
  nlohmann::json json = part_to_json(recording.name, part.result, times, brdfs);
  if (options.sufficient_model) add_sufficient_models(json, part, inspector.basis());
  if (exporting) write_text_file(dir / "result.json", result_document({json}).dump(2) + "\n");
  if (!options.images_dir.empty()) {
    export_images(folder_for(options.images_dir, recording.name, several), recording.capture, part,
                  inspector);
  }
  if (!options.evidence_dir.empty()) {
    write_evidence(run, part, recording, times, several);
  } else if (!options.session.json) {
    print_part(recording.name, part.result);
  }
  return json;
}

std::vector<Verdict> process_all(const Run& run) {
  const InspectOptions& options = run.options;
  const auto folders = find_all_recordings(options.from);
  std::vector<nlohmann::json> parts;
  std::vector<Verdict> verdicts;
  Progress progress("inspecting", static_cast<int>(folders.size()));
  for (const auto& dir : folders) {
    const Recording recording =
        load_part(dir, run.config, run.inspector, !options.session.calibration.empty());
    parts.push_back(process(run, recording, folders.size() > 1));
    const std::string verdict = parts.back()["verdict"];
    verdicts.push_back(verdict == "pass"     ? Verdict::pass
                       : verdict == "reject" ? Verdict::reject
                                             : Verdict::not_judged);
    progress.advance();
  }
  if (options.session.json) fmt::print("{}\n", result_document(parts).dump(2));
  return verdicts;
}

int inspect(const InspectOptions& options) {
  const StationConfig config = load_config(options.session);
  const Inspector inspector = load_inspector(config);
  const auto recipe = load_recipe(config, inspector);
  const RecipeInForce* in_force = recipe ? &*recipe : nullptr;
  Run run{options, config, inspector, in_force, {}, {}};
  run.measure = [&](const Capture& capture) { return inspector.inspect(capture, in_force); };
  if (in_force != nullptr)
    run.recipe_hash = sha256_hex(MappedFile(config.files.recipes.front()).bytes());
  return exit_code_of(process_all(run));
}

void add_sufficient_model_option(CLI::App& command, InspectOptions& options) {
  command.add_flag("--sufficient-model", options.sufficient_model,
                   "also tell the smallest model each cluster calls for: half a second each");
}

/// 0 where every part gave weights, else 3.
int reconstruct(const InspectOptions& options) {
  StationConfig config = load_config(options.session);
  if (!options.method.empty()) config.inspection.method = options.method;
  const Inspector inspector = load_inspector(config);
  bool all_measured = true;
  Run run{options, config, inspector, nullptr, {}, {}};
  run.measure = [&](const Capture& capture) {
    Inspection part = inspector.measure(capture);
    all_measured &= std::any_of(part.result.clusters.begin(), part.result.clusters.end(),
                                [](const ClusterResult& c) { return c.valid.weights; });
    return part;
  };
  process_all(run);
  return all_measured ? kExitYes : kExitNotJudged;
}

}  // namespace

void add_inspect(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<InspectOptions>();
  CLI::App* command = tool.add_subcommand("inspect", "judge recordings against the recipe");
  options->session.add_to(*command);
  options->session.add_overrides_to(*command);
  command->add_option("--from", options->from, "a recording, or a folder of recordings")
      ->required();
  command->add_option("--export-brdf", options->export_dir,
                      "write each cluster's BRDF and result.json here");
  add_fit_option(*command, options->fit)->needs("--export-brdf");
  command->add_option("--evidence", options->evidence_dir,
                      "write pictures and explain.html here, and say why");
  command->add_option("--export-images", options->images_dir,
                      "write radiance.exr and reflectance.exr here");
  add_sufficient_model_option(*command, *options);
  command->callback([options, &exit_code] { exit_code = inspect(*options); });
}

void add_reconstruct(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<InspectOptions>();
  CLI::App* command = tool.add_subcommand(
      "reconstruct", "cluster, reconstruct and export BRDFs: no recipe, no verdict");
  options->session.add_to(*command);
  options->session.add_overrides_to(*command);
  command->add_option("--from", options->from, "a recording, or a folder of recordings")
      ->required();
  command->add_option("--out", options->export_dir, "folder for cluster_<n>.binary and result.json")
      ->required();
  add_fit_option(*command, options->fit);
  command->add_option("--evidence", options->evidence_dir, "write pictures and explain.html here");
  command->add_option("--export-images", options->images_dir,
                      "write radiance.exr and reflectance.exr here");
  add_sufficient_model_option(*command, *options);
  command->add_option("--method", options->method, "estimator; else the configuration's")
      ->check(CLI::IsMember(estimator_names()));
  command->callback([options, &exit_code] { exit_code = reconstruct(*options); });
}

}  // namespace brdfgate
