// What most commands share: the configuration and the files it names, with the command line's
// overrides.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "app/inspector.hpp"
#include "app/recording.hpp"
#include "config/station_config.hpp"
#include "model/error.hpp"

namespace brdfgate {

/// Exit codes of the command reference.
enum ExitCode : int { kExitYes = 0, kExitNo = 1, kExitUnusable = 2, kExitNotJudged = 3 };

/// The worst of several verdicts, in the order reject, not judged, pass.
int exit_code_of(const std::vector<Verdict>& verdicts);

/// Parses the command line (callbacks run). The exit code to leave with: help and version print and
/// give 0; a wrong command line or anything thrown gives one line on stderr and kExitUnusable;
/// nothing: go on.
std::optional<int> parse_command_line(CLI::App& app, int argc, char** argv);

/// --config, --basis, --calibration, --recipe and --json as given.
struct SessionOptions {
  std::filesystem::path config;
  std::filesystem::path basis;
  std::filesystem::path calibration;
  std::filesystem::path recipe;
  bool json = false;

  void add_to(CLI::App& command);            ///< --config and --json
  void add_overrides_to(CLI::App& command);  ///< --basis, --calibration, --recipe
};

/// The station file used when --config is not given: /etc/brdfgate/station.yaml where it exists,
/// else the simulated station that comes with the programs.
std::filesystem::path default_config();

/// The folder of the simulated station's scenes that comes with the programs.
std::filesystem::path shipped_scenes();

/// Reads the configuration and applies the overrides to its files.
StationConfig load_config(const SessionOptions& options);

/// Throws InputError where the calibration belongs to another station than the configuration's.
void check_calibration_of(const Calibration& calibration, const StationConfig& config);

/// Opens basis and calibration.
Inspector load_inspector(const StationConfig& config);

/// The configuration's first recipe, if it names one.
std::optional<RecipeInForce> load_recipe(const StationConfig& config, const Inspector& inspector);

/// Opens everything the configuration names: basis, calibration, recipes, scenes. Throws
/// InputError.
void check_station(const StationConfig& config);

/// A part recording, checked against the station and the calibration in force. An explicitly given
/// calibration (--calibration) may differ from the recorded one as long as the station is the same.
Recording load_part(const std::filesystem::path& dir, const StationConfig& config,
                    const Inspector& inspector, bool calibration_given);

/// All recordings under several --from folders.
std::vector<std::filesystem::path> find_all_recordings(
    const std::vector<std::filesystem::path>& from);

}  // namespace brdfgate
