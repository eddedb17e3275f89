// brdfgate bracket: the fewest exposures for a material, from a recording of it.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "app/calibration_file.hpp"
#include "app/commands/commands.hpp"
#include "app/session.hpp"
#include "model/bracket_choice.hpp"
#include "model/reflectance.hpp"

namespace brdfgate {
namespace {

struct BracketOptions {
  SessionOptions session;
  std::vector<std::filesystem::path> from;
  BracketLimits limits;
  double budget_ms = 0;    ///< for both lights; 0: none
  double readout_ms = -1;  ///< under 0: as recorded
  double shortest_ms = 0;  ///< 0: the shortest recorded
  double longest_ms = 0;   ///< 0: the longest recorded
};

/// Time between the end of one exposure and the start of the next, the median under the lights.
double readout_s(const Capture& capture) {
  std::vector<double> gaps;
  for (std::size_t i = 1; i < capture.frames.size(); ++i) {
    const RawFrame& before = capture.frames[i - 1];
    const RawFrame& frame = capture.frames[i];
    if (frame.light == kNoLight || frame.light != before.light) continue;
    gaps.push_back(1e-9 * static_cast<double>(frame.timestamp_ns - before.timestamp_ns) -
                   before.exposure_s);
  }
  if (gaps.empty()) return 0;
  const auto middle = gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 2);
  std::nth_element(gaps.begin(), middle, gaps.end());
  return std::max(0.0, *middle);
}

/// Radiance under each light and the cells of the part.
struct MeasuredPart {
  std::vector<Radiance> lights;
  cv::Mat cells;
};

MeasuredPart measure(const Recording& recording, const StationConfig& config,
                     const Calibration& calibration) {
  const RadianceSet radiance = to_radiance(recording.capture, calibration);
  const cv::Size2d region(config.inspection.region_mm[0] * 1e-3,
                          config.inspection.region_mm[1] * 1e-3);
  MeasuredPart part;
  part.cells = cell_geometry(calibration.geometry, calibration.sensor, region).inside;
  part.cells.setTo(0,
                   fixture_cells(to_reflectance(radiance, calibration), config.inspection.fixture));
  // What is chosen has to serve the frames as they are, ambient light and all.
  for (const Radiance& lit : radiance.lights) {
    Radiance seen = lit;
    cv::add(lit.value, radiance.ambient.value, seen.value);
    part.lights.push_back(seen);
  }
  return part;
}

/// From the shortest to the longest exposure that was recorded, both included, by about a stop.
std::vector<double> candidates_of(const BracketOptions& options, const Capture& capture) {
  double shortest = HUGE_VAL, longest = 0;
  for (const RawFrame& frame : capture.frames) {
    if (frame.light == kNoLight) continue;
    shortest = std::min(shortest, frame.exposure_s * frame.gain);
    longest = std::max(longest, frame.exposure_s * frame.gain);
  }
  if (options.shortest_ms > 0) shortest = options.shortest_ms * 1e-3;
  if (options.longest_ms > 0) longest = options.longest_ms * 1e-3;
  if (!(longest > shortest)) return {shortest};
  constexpr double kMostSteps = 15;
  const double steps = std::clamp(std::round(std::log2(longest / shortest)), 1.0, kMostSteps);
  return exposure_ladder(shortest, longest, std::pow(longest / shortest, 1 / steps));
}

/// Four significant digits, as a person would write it.
std::string written_ms(double seconds) {
  return fmt::format("{:.4g}", 1e3 * seconds);
}

void print(const BracketOptions& options, const BracketChoice& choice, std::size_t lights) {
  const double time_ms = 1e3 * choice.time_s * static_cast<double>(lights);
  std::string list;
  nlohmann::json exposures = nlohmann::json::array();
  for (const double t : choice.exposures_s) {
    list += (list.empty() ? "" : ", ") + written_ms(t);
    exposures.push_back(std::stod(written_ms(t)));
  }
  if (options.session.json) {
    fmt::print("{}\n", nlohmann::json{{"schema", "brdfgate.bracket/1"},
                                      {"bracket_ms", exposures},
                                      {"masked_share", choice.masked},
                                      {"time_ms", time_ms}}
                           .dump(2));
    return;
  }
  fmt::print(
      "camera:\n  bracket_ms: [{}]  # leaves {:.3f} % of the part masked; {:.0f} ms with both "
      "lights\n",
      list, 100 * choice.masked, time_ms);
}

int run(BracketOptions options) {
  const StationConfig config = load_config(options.session);
  const Calibration calibration = read_calibration(config.files.calibration);
  check_calibration_of(calibration, config);
  std::vector<MeasuredPart> parts;
  std::vector<double> candidates;
  for (const auto& dir : find_all_recordings(options.from)) {
    const Recording recording = read_recording(dir);
    if (recording.station_hash != config.station_hash) {
      throw InputError((dir / "recording.yaml").string(), "was captured on another sensor or rig",
                       "station " + config.station_hash.substr(0, 16));
    }
    parts.push_back(measure(recording, config, calibration));
    if (candidates.empty()) candidates = candidates_of(options, recording.capture);
    if (options.readout_ms < 0) options.readout_ms = 1e3 * readout_s(recording.capture);
  }
  std::vector<BracketNeed> needs;
  for (const MeasuredPart& part : parts) {
    for (const Radiance& light : part.lights)
      needs.push_back({&light, &part.cells});
  }
  const std::size_t lights = calibration.geometry.lights_W.size();
  options.limits.readout_s = 1e-3 * options.readout_ms;
  if (options.budget_ms > 0)
    options.limits.budget_s = 1e-3 * options.budget_ms / static_cast<double>(lights);
  print(options,
        choose_bracket(calibration.sensor, calibration.noise, needs, candidates, options.limits),
        lights);
  return kExitYes;
}

}  // namespace

void add_bracket(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<BracketOptions>();
  options->limits.least_snr = 5;
  CLI::App* command = tool.add_subcommand(
      "bracket", "the fewest exposures for a material, as YAML for the station file");
  options->session.add_to(*command);
  command->add_option("--calibration", options->session.calibration,
                      "calibration instead of the configuration's");
  command
      ->add_option("--from", options->from,
                   "recordings of the material, with a bracket that shows all of it")
      ->required();
  command->add_option("--max-masked", options->limits.most_masked, "share of the part's cells")
      ->check(CLI::Range(0.0, 1.0));
  command
      ->add_option("--min-snr", options->limits.least_snr,
                   "signal-to-noise ratio of the weakest channel; 5 keeps noise off the mask")
      ->check(CLI::Range(1.0, 1000.0));
  command
      ->add_option("--budget-ms", options->budget_ms,
                   "for exposures and readouts under all lights; 0: none")
      ->check(CLI::Range(0.0, 3.6e6));
  command->add_option("--readout-ms", options->readout_ms, "per frame; else as recorded")
      ->check(CLI::Range(0.0, 60000.0));
  command->add_option("--shortest-ms", options->shortest_ms, "else the shortest recorded");
  command->add_option("--longest-ms", options->longest_ms, "else the longest recorded");
  command->callback([options, &exit_code] { exit_code = run(*options); });
}

}  // namespace brdfgate
