// brdfgate calibrate: dark and white recordings to one calibration file.
#include <fmt/core.h>

#include <ctime>
#include <nlohmann/json.hpp>

#include "app/calibration_file.hpp"
#include "app/commands/commands.hpp"
#include "app/progress.hpp"
#include "app/session.hpp"

namespace brdfgate {
namespace {

struct CalibrateOptions {
  SessionOptions session;
  std::vector<std::filesystem::path> from;
  std::filesystem::path out;
  double white_reflectance = 0.99;
};

CalibrationInput gather(const CalibrateOptions& options, const StationConfig& config) {
  CalibrationInput input;
  input.geometry = make_geometry(config.rig, config.camera.sensor);
  input.nominal = config.camera.noise;
  input.white_reflectance.fill(options.white_reflectance);
  const auto folders = find_all_recordings(options.from);
  Progress progress("reading recordings", static_cast<int>(folders.size()));
  for (const auto& dir : folders) {
    Recording recording = read_recording(dir);
    if (recording.station_hash != config.station_hash) {
      throw InputError((dir / "recording.yaml").string(), "was captured on another sensor or rig",
                       "station " + config.station_hash.substr(0, 16));
    }
    if (recording.role == RecordingRole::dark) input.darks.push_back(std::move(recording.capture));
    if (recording.role == RecordingRole::white)
      input.whites.push_back(std::move(recording.capture));
    progress.advance();
  }
  return input;
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

nlohmann::json report(const Calibration& c, const CalibrationInput& input) {
  return {{"schema", "brdfgate.calibration_report/1"},
          {"hash", c.hash},
          {"darks", input.darks.size()},
          {"whites", input.whites.size()},
          {"black_level_dn", c.sensor.black_level_dn},
          {"read_noise_dn", c.noise.read_noise_dn},
          {"gain_dn_per_electron", c.noise.gain_dn_per_e}};
}

}  // namespace

void add_calibrate(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<CalibrateOptions>();
  CLI::App* command = tool.add_subcommand(
      "calibrate", "black level, noise and white reference from dark and white recordings");
  options->session.add_to(*command);
  command->add_option("--from", options->from, "folders with dark and white recordings")
      ->required();
  command->add_option("--out", options->out, "calibration file to write (.exr)")->required();
  command
      ->add_option("--white-reflectance", options->white_reflectance,
                   "certified, of the white plate")
      ->check(CLI::Range(0.5, 1.0));
  command->callback([options, &exit_code] {
    const StationConfig config = load_config(options->session);
    const CalibrationInput input = gather(*options, config);
    Calibration calibration = calibrate(input);
    calibration.station_hash = config.station_hash;
    calibration.created = utc_now();
    calibration.hash = write_calibration(options->out, calibration);
    const nlohmann::json summary = report(calibration, input);
    if (options->session.json) {
      fmt::print("{}\n", summary.dump(2));
    } else {
      fmt::print(
          "{}: black level {:.2f} DN, read noise {:.3f} DN, gain {:.4f} DN per electron, from {} "
          "dark and "
          "{} white recordings\n",
          options->out.string(), calibration.sensor.black_level_dn, calibration.noise.read_noise_dn,
          calibration.noise.gain_dn_per_e, input.darks.size(), input.whites.size());
    }
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
