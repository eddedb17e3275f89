// brdfgate check: is this station file usable, with everything it names? And do its lights settle
// in time?
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "app/commands/commands.hpp"
#include "app/light_curve.hpp"
#include "app/progress.hpp"
#include "app/session.hpp"

namespace brdfgate {
namespace {

struct CheckOptions {
  std::filesystem::path file;
  bool json = false;
  bool lights = false;
};

/// Every frame from the configured settle time on shows the steady light.
bool holds(const LightCurve& curve, double settle_ms) {
  return curve.seen &&
         std::none_of(curve.points.begin(), curve.points.end(), [&](const LightCurvePoint& point) {
           return 1e3 * point.after_s >= settle_ms && std::abs(point.level - 1) > kSettled;
         });
}

void print_curve(const LightCurve& curve, double settle_ms) {
  if (!curve.seen) {
    fmt::print("light {}: not seen: switching it changes the frames' mean by {:.2f} DN\n",
               curve.light, curve.contrast_dn);
    return;
  }
  fmt::print("light {}: {:.1f} DN over no light in {:g} ms\n", curve.light, curve.contrast_dn,
             1e3 * curve.exposure_s);
  fmt::print("   after ms   level\n");
  for (const LightCurvePoint& point : curve.points) {
    const int bar = std::clamp(static_cast<int>(40 * point.level), 0, 60);
    fmt::print("   {:8.2f}  {:6.3f}  {}\n", 1e3 * point.after_s, point.level,
               std::string(bar, '#'));
  }
  fmt::print("   within {:g} % from {:.2f} ms on; lights.settle_ms {:g} {}\n", 100 * kSettled,
             1e3 * curve.settled_s, settle_ms, holds(curve, settle_ms) ? "holds" : "is too short");
}

nlohmann::json to_json(const LightCurve& curve, double settle_ms) {
  nlohmann::json points = nlohmann::json::array();
  for (const LightCurvePoint& point : curve.points)
    points.push_back({{"after_ms", 1e3 * point.after_s}, {"level", point.level}});
  return {{"light", curve.light},
          {"seen", curve.seen},
          {"contrast_dn", curve.contrast_dn},
          {"exposure_ms", 1e3 * curve.exposure_s},
          {"settled_ms", 1e3 * curve.settled_s},
          {"settle_ms", settle_ms},
          {"holds", holds(curve, settle_ms)},
          {"curve", points}};
}

int check_lights(const StationConfig& config, bool json) {
  const auto station = open_station(config);
  station->next_part(0);
  const double settle_ms =
      std::chrono::duration<double, std::milli>(config.lights.gpio.settle).count();
  nlohmann::json lights = nlohmann::json::array();
  bool all = true;
  Progress progress("switching lights", station->lights().count());
  for (LightIndex light = 1; light <= station->lights().count(); ++light) {
    const LightCurve curve = measure_light_curve(*station, config.camera, light);
    progress.advance();
    all &= holds(curve, settle_ms);
    lights.push_back(to_json(curve, settle_ms));
    if (!json) print_curve(curve, settle_ms);
  }
  if (json) {
    const nlohmann::json document = {
        {"schema", "brdfgate.check/1"}, {"usable", all}, {"lights", lights}};
    fmt::print("{}\n", document.dump(2));
  }
  return all ? kExitYes : kExitNo;
}

void print_resolved(const StationConfig& config, bool json) {
  const std::string resolved = to_yaml(config);
  if (json) {
    const nlohmann::json document = {{"schema", "brdfgate.check/1"},
                                     {"usable", true},
                                     {"config_hash", config.hash},
                                     {"station_hash", config.station_hash},
                                     {"resolved", resolved}};
    fmt::print("{}\n", document.dump(2));
  } else {
    fmt::print("{}\n# usable; configuration {}, station {}\n", resolved, config.hash.substr(0, 16),
               config.station_hash.substr(0, 16));
  }
}

}  // namespace

void add_check(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<CheckOptions>();
  CLI::App* command =
      tool.add_subcommand("check", "validate a station file and everything it names");
  command->add_option("file", options->file, "station file")
      ->default_str(default_config().string());
  command->add_flag("--json", options->json, "print one JSON document on stdout");
  command->add_flag("--lights", options->lights,
                    "switch each light and measure how it rises, seen by the camera; needs no "
                    "calibration");
  command->callback([options, &exit_code] {
    const StationConfig config =
        read_station_config(options->file.empty() ? default_config() : options->file);
    if (options->lights) {
      exit_code = check_lights(config, options->json);
      return;
    }
    check_station(config);
    print_resolved(config, options->json);
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
