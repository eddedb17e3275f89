// brdfgate teach: a recipe from good parts.
#include <fmt/core.h>

#include <nlohmann/json.hpp>

#include "app/commands/commands.hpp"
#include "app/progress.hpp"
#include "app/recipe_file.hpp"
#include "app/rules_json.hpp"
#include "app/session.hpp"
#include "app/station.hpp"
#include "app/teacher.hpp"
#include "config/rules_yaml.hpp"
#include "model/teaching_checks.hpp"

namespace brdfgate {
namespace {

struct TeachOptions {
  SessionOptions session;
  std::vector<std::filesystem::path> from;
  bool live = false;
  int parts = 10;
  std::filesystem::path out;
  std::filesystem::path rules;  ///< empty: none
  std::string name;
  int id = 0;  ///< 0: not given
};

/// A rule on a cluster that the first part does not have is told before all of them are taught.
void check_rules(const TeachOptions& options, const Teacher& teacher) {
  if (options.rules.empty() || teacher.parts() != 1) return;
  const std::vector<TaughtCluster> clusters = teacher.clusters();
  (void)read_rules_file(options.rules, &clusters);
}

void teach_from_recordings(const TeachOptions& options, const StationConfig& config,
                           const Inspector& inspector, Teacher& teacher) {
  const auto folders = find_all_recordings(options.from);
  Progress progress("teaching", static_cast<int>(folders.size()));
  for (const auto& dir : folders) {
    const bool given = !options.session.calibration.empty();
    teacher.add(dir.string(), load_part(dir, config, inspector, given).capture);
    check_rules(options, teacher);
    progress.advance();
  }
}

void teach_live(const TeachOptions& options, const StationConfig& config, Teacher& teacher) {
  const auto station = open_station(config);
  Progress progress("teaching", options.parts);
  for (int i = 0; i < options.parts; ++i) {
    station->next_part(1);
    teacher.add(fmt::format("live part {}", i + 1), capture_part(*station, config.camera));
    check_rules(options, teacher);
    progress.advance();
  }
}

/// With how many parts the limits are compared: the issue's own figure for a production recipe.
constexpr int kManyParts = 50;

void print_reach(const TaughtCluster& c, const Recipe& recipe) {
  const int clusters = static_cast<int>(recipe.clusters.size());
  const int more = std::max(kManyParts, 2 * recipe.parts);
  fmt::print("    monitored; a change alone is rejected from");
  for (const Reach& r : reach_of(c, recipe.settings, clusters, more))
    fmt::print(" {} {:.1f} % ({:.1f} %),", r.name, 100 * r.now, 100 * r.with_more);
  fmt::print(" in brackets: if {} such parts had been taught\n", more);
}

void print_recipe(const Recipe& recipe, const std::filesystem::path& file) {
  fmt::print("{}: recipe {} '{}' from {} part(s)\n", file.string(), recipe.id, recipe.name,
             recipe.parts);
  for (const TaughtCluster& c : recipe.clusters) {
    fmt::print(
        "  {:<10} {:5.1f} % of the part, gloss 60: {:.1f} GU, L*a*b* {:.1f} {:.1f} {:.1f}, limits "
        "T2 {:.1f}, "
        "SPE {:.2f}\n",
        c.name, 100 * c.area_share, c.gloss_gu[1], c.lab[0], c.lab[1], c.lab[2], c.t2_limit,
        c.spe_limit);
    print_reach(c, recipe);
  }
  for (const Rule& rule : recipe.rules.rules)
    fmt::print("  rule: {}\n", rule_text(rule, recipe));
  for (const std::string& warning : recipe.warnings)
    fmt::print(stderr, "warning: {}\n", warning);
}

nlohmann::json recipe_to_json(const Recipe& recipe, const std::filesystem::path& file) {
  nlohmann::json clusters = nlohmann::json::array();
  for (const TaughtCluster& c : recipe.clusters) {
    nlohmann::json monitored = nlohmann::json::array();
    const int more = std::max(kManyParts, 2 * recipe.parts);
    for (const Reach& r :
         reach_of(c, recipe.settings, static_cast<int>(recipe.clusters.size()), more)) {
      monitored.push_back({{"name", r.name},
                           {"rejected_from", r.now},
                           {"rejected_from_with_more_parts", r.with_more},
                           {"more_parts", more}});
    }
    clusters.push_back(
        {{"name", c.name},
         {"area_share", c.area_share},
         {"gloss_gu", {{"20", c.gloss_gu[0]}, {"60", c.gloss_gu[1]}, {"85", c.gloss_gu[2]}}},
         {"lab", {c.lab[0], c.lab[1], c.lab[2]}},
         {"monitored", monitored},
         {"t2_limit", c.t2_limit},
         {"spe_limit", c.spe_limit}});
  }
  return {{"schema", "brdfgate.teach/1"},
          {"file", file.string()},
          {"id", recipe.id},
          {"name", recipe.name},
          {"parts", recipe.parts},
          {"clusters", clusters},
          {"rules", rules_to_json(recipe)},
          {"warnings", recipe.warnings}};
}

void finish(const TeachOptions& options, const Recipe& recipe) {
  write_recipe(options.out, recipe);
  if (options.session.json) {
    fmt::print("{}\n", recipe_to_json(recipe, options.out).dump(2));
  } else {
    print_recipe(recipe, options.out);
  }
}

void teach(const TeachOptions& options) {
  // What is wrong with the rules whatever is taught is told before it is.
  if (!options.rules.empty()) (void)read_rules_file(options.rules, nullptr);
  const StationConfig config = load_config(options.session);
  const Inspector inspector = load_inspector(config);
  Teacher teacher(inspector);
  if (options.live) {
    teach_live(options, config, teacher);
  } else {
    teach_from_recordings(options, config, inspector, teacher);
  }
  const std::string name = options.name.empty() ? options.out.stem().string() : options.name;
  Recipe recipe = teacher.recipe(name, std::max(1, options.id));
  if (!options.rules.empty()) {
    recipe.rules = read_rules_file(options.rules, &recipe.clusters);
    (void)inspector.bring_into_force(recipe);
  }
  finish(options, recipe);
}

/// Another recipe's clusters and limits with these rules instead of its own.
void change_rules(const TeachOptions& options) {
  if (options.rules.empty() || options.session.recipe.empty()) {
    throw InputError("command line", "neither --from nor --live",
                     "good parts; or --rules F --recipe REF, to give a recipe other rules");
  }
  Recipe recipe = read_recipe(options.session.recipe);
  recipe.rules = read_rules_file(options.rules, &recipe.clusters);
  if (!options.name.empty()) recipe.name = options.name;
  if (options.id != 0) recipe.id = options.id;
  finish(options, recipe);
}

}  // namespace

void add_teach(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<TeachOptions>();
  CLI::App* command = tool.add_subcommand("teach", "teach the reference material from good parts");
  options->session.add_to(*command);
  options->session.add_overrides_to(*command);
  auto* source = command->add_option_group("source", "where the good parts come from");
  source->add_option("--from", options->from, "recordings of good parts");
  source->add_flag("--live", options->live, "capture them now");
  source->require_option(0, 1);
  command->add_option("--parts", options->parts, "with --live: how many")
      ->check(CLI::Range(1, 1000));
  command->add_option("--out", options->out, "recipe file to write (.yaml)")->required();
  command->add_option("--rules", options->rules,
                      "limits on readings (.yaml), kept in the recipe; with --recipe and no parts: "
                      "instead of that recipe's own");
  command->add_option("--name", options->name, "of the recipe; default: the file's name");
  command->add_option("--id", options->id, "the number the PLC selects it by")
      ->check(CLI::Range(1, 65535));
  command->callback([options, &exit_code] {
    const bool parts = options->live || !options->from.empty();
    parts ? teach(*options) : change_rules(*options);
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
