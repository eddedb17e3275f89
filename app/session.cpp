#include "app/session.hpp"

#include <fmt/core.h>

#include "app/calibration_file.hpp"
#include "app/recipe_file.hpp"
#include "config/scene_reader.hpp"

namespace brdfgate {

int exit_code_of(const std::vector<Verdict>& verdicts) {
  int worst = kExitYes;
  for (const Verdict verdict : verdicts) {
    if (verdict == Verdict::reject) return kExitNo;
    if (verdict != Verdict::pass) worst = kExitNotJudged;
  }
  return worst;
}

std::optional<int> parse_command_line(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
    return std::nullopt;
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    fmt::print(stderr, "{}: command line: {}; see --help\n", app.get_name(), error.what());
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}: {}\n", app.get_name(), error.what());
  }
  return kExitUnusable;
}

std::filesystem::path default_config() {
  for (const char* place : {"/etc/brdfgate/station.yaml", BRDFGATE_INSTALLED_CONFIG}) {
    if (std::filesystem::exists(place)) return place;
  }
  return BRDFGATE_SOURCE_CONFIG;
}

std::filesystem::path shipped_scenes() {
  const std::filesystem::path installed = BRDFGATE_INSTALLED_CONFIG;
  const std::filesystem::path source = BRDFGATE_SOURCE_CONFIG;
  return (std::filesystem::exists(installed) ? installed : source).parent_path() / "scenes";
}

void SessionOptions::add_to(CLI::App& command) {
  command.add_option("--config", config, "station file")->default_str(default_config().string());
  command.add_flag("--json", json, "print one JSON document on stdout");
}

void SessionOptions::add_overrides_to(CLI::App& command) {
  command.add_option("--basis", basis, "reflectance basis instead of the configuration's");
  command.add_option("--calibration", calibration, "calibration instead of the configuration's");
  command.add_option("--recipe", recipe, "recipe instead of the configuration's");
}

StationConfig load_config(const SessionOptions& options) {
  StationConfig config =
      read_station_config(options.config.empty() ? default_config() : options.config);
  if (!options.basis.empty()) config.files.basis = options.basis;
  if (!options.calibration.empty()) config.files.calibration = options.calibration;
  if (!options.recipe.empty()) config.files.recipes = {options.recipe};
  return config;
}

void check_calibration_of(const Calibration& calibration, const StationConfig& config) {
  if (calibration.station_hash == config.station_hash) return;
  throw InputError(config.files.calibration.string(),
                   "station_hash " + calibration.station_hash.substr(0, 16) +
                       " belongs to another sensor or rig",
                   config.station_hash.substr(0, 16) + " (run brdfgate calibrate)");
}

Inspector load_inspector(const StationConfig& config) {
  return {config, Basis::open(config.files.basis), read_calibration(config.files.calibration)};
}

std::optional<RecipeInForce> load_recipe(const StationConfig& config, const Inspector& inspector) {
  if (config.files.recipes.empty()) return std::nullopt;
  return inspector.bring_into_force(read_recipe(config.files.recipes.front()));
}

void check_station(const StationConfig& config) {
  const Inspector inspector = load_inspector(config);
  (void)load_recipe(config, inspector);
  for (const auto& scene : config.camera.scenes)
    (void)read_scene(scene);
}

Recording load_part(const std::filesystem::path& dir, const StationConfig& config,
                    const Inspector& inspector, bool calibration_given) {
  Recording recording = read_recording(dir);
  const std::string where = (dir / "recording.yaml").string();
  if (recording.role != RecordingRole::part)
    throw InputError(where, "role is not a part's", "role: part");
  if (recording.station_hash != config.station_hash) {
    throw InputError(
        where, "station " + recording.station_hash.substr(0, 16) + " has another sensor or rig",
        config.station_hash.substr(0, 16));
  }
  const std::string& in_force = inspector.calibration().hash;
  if (!calibration_given && !recording.calibration_hash.empty() &&
      recording.calibration_hash != in_force) {
    throw InputError(
        where,
        "calibration " + recording.calibration_hash.substr(0, 16) + " is not the one in force",
        in_force.substr(0, 16) + " (or name the recording's own with --calibration)");
  }
  return recording;
}

std::vector<std::filesystem::path> find_all_recordings(
    const std::vector<std::filesystem::path>& from) {
  std::vector<std::filesystem::path> all;
  for (const auto& dir : from) {
    const auto found = find_recordings(dir);
    all.insert(all.end(), found.begin(), found.end());
  }
  return all;
}

}  // namespace brdfgate
