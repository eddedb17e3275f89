// brdfgate simulate and capture: parts into recordings.
#include <fmt/core.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "app/calibration_file.hpp"
#include "app/commands/commands.hpp"
#include "app/progress.hpp"
#include "app/session.hpp"
#include "app/station.hpp"
#include "config/scene_reader.hpp"

namespace brdfgate {
namespace {

struct CaptureOptions {
  SessionOptions session;
  std::filesystem::path scene;
  std::filesystem::path out;
  int parts = 1;
  std::uint64_t seed = 0;
  std::string role;  ///< empty: the scene's, or a part's
  int sweep_points = 24;
};

const std::vector<std::string> kRoles{"part",  "white",  "dark",  "ptc",
                                      "board", "mirror", "black", "chart"};

RecordingRole role_named(const std::string& name) {
  return static_cast<RecordingRole>(std::find(kRoles.begin(), kRoles.end(), name) - kRoles.begin());
}

RecordingRole role_of(const Scene& scene) {
  if (!scene.lights_on) return RecordingRole::dark;
  switch (scene.target) {
    case SceneTarget::part:
      return RecordingRole::part;
    case SceneTarget::white:
      return RecordingRole::white;
    case SceneTarget::board:
      return RecordingRole::board;
    case SceneTarget::mirror:
      return RecordingRole::mirror;
    case SceneTarget::black:
      return RecordingRole::black;
    case SceneTarget::chart:
      return RecordingRole::chart;
  }
  return RecordingRole::part;
}

/// Hash of the configured calibration, or nothing where there is none yet: dark and white
/// recordings come before the first calibration.
std::string calibration_in_force(const StationConfig& config) {
  std::error_code none;
  if (!std::filesystem::exists(config.files.calibration, none)) return {};
  return read_calibration(config.files.calibration).hash;
}

Capture capture_as(RecordingRole role, Station& station, const CaptureOptions& options,
                   const CameraConfig& camera) {
  switch (role) {
    case RecordingRole::dark:
      return capture_dark(station, camera);
    case RecordingRole::ptc:
      return capture_sweep(station, camera, options.sweep_points);
    default:
      return capture_part(station, camera);
  }
}

void record_parts(const CaptureOptions& options, const StationConfig& config, RecordingRole role) {
  const auto station = open_station(config);
  const std::string calibration =
      role == RecordingRole::part ? calibration_in_force(config) : std::string();
  nlohmann::json written = nlohmann::json::array();
  Progress progress("capturing", options.parts);
  for (int i = 0; i < options.parts; ++i) {
    station->next_part(0);
    Recording recording;
    recording.role = role;
    recording.station_hash = config.station_hash;
    recording.calibration_hash = calibration;
    recording.capture = capture_as(role, *station, options, config.camera);
    const auto dir = options.out / fmt::format("part_{:04}", i + 1);
    write_recording(dir, recording);
    written.push_back(dir.string());
    progress.advance();
  }
  if (options.session.json) {
    fmt::print("{}\n",
               nlohmann::json{{"schema", "brdfgate.capture/1"}, {"recordings", written}}.dump(2));
  } else {
    fmt::print("{} recording(s) in {}\n", options.parts, options.out.string());
  }
}

void add_common(CLI::App& command, CaptureOptions& options) {
  options.session.add_to(command);
  command.add_option("--out", options.out, "folder for the recordings")->required();
  command.add_option("--parts", options.parts, "how many")->check(CLI::Range(1, 9999));
  command
      .add_option(
          "--role", options.role,
          "what the recordings are for; ptc: a photon-transfer sweep of the white reference")
      ->check(CLI::IsMember(kRoles));
  command
      .add_option("--sweep-points", options.sweep_points, "exposures of a photon-transfer sweep")
      ->check(CLI::Range(8, 200));
}

}  // namespace

void add_simulate(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<CaptureOptions>();
  CLI::App* command = tool.add_subcommand("simulate", "capture parts on the simulated station");
  add_common(*command, *options);
  command->add_option("--scene", options->scene, "scene file: what lies under the camera")
      ->required();
  const CLI::Option* seed =
      command->add_option("--seed", options->seed, "of poses, variation and noise");
  command->callback([options, seed, &exit_code] {
    StationConfig config = load_config(options->session);
    config.camera.scenes = {options->scene};
    if (seed->count() > 0) config.camera.seed = options->seed;
    record_parts(
        *options, config,
        options->role.empty() ? role_of(read_scene(options->scene)) : role_named(options->role));
    exit_code = kExitYes;
  });
}

void add_capture(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<CaptureOptions>();
  CLI::App* command = tool.add_subcommand("capture", "capture parts with the configured camera");
  add_common(*command, *options);
  command->callback([options, &exit_code] {
    record_parts(*options, load_config(options->session),
                 options->role.empty() ? RecordingRole::part : role_named(options->role));
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
