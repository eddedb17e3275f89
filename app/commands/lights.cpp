// brdfgate lights: switches the station's lights by hand, and off for good.
#include <fmt/core.h>

#include <thread>

#include "app/commands/commands.hpp"
#include "app/session.hpp"
#include "hal/gpio/gpio_lights.hpp"

namespace brdfgate {
namespace {

struct LightsOptions {
  SessionOptions session;
  bool off = false;
  int on = 0;
  double seconds = 1;
};

/// Taking the lines drives them dark; they stay so where the driver keeps what was driven, and
/// where the wiring pulls them.
void switch_lights(const LightsOptions& options, const GpioLightsSettings& settings) {
  GpioLights lights(settings);
  lights.verify();
  if (options.on > 0) {
    lights.on(options.on);
    std::this_thread::sleep_for(std::chrono::duration<double>(options.seconds));
    lights.verify();
  }
  lights.all_off();
  lights.verify();
}

}  // namespace

void add_lights(CLI::App& tool, int& exit_code) {
  auto options = std::make_shared<LightsOptions>();
  CLI::App* command = tool.add_subcommand("lights", "switch the lights by hand");
  options->session.add_to(*command);
  CLI::Option* off =
      command->add_flag("--off", options->off, "all off: what the service's unit does last");
  CLI::Option* on = command->add_option("--on", options->on, "this light, then off again")
                        ->check(CLI::Range(1, 18));
  command->add_option("--seconds", options->seconds, "how long")
      ->check(CLI::Range(0.001, 600.0))
      ->needs(on);
  off->excludes(on);
  command->callback([options, &exit_code] {
    if (!options->off && options->on == 0) {
      throw InputError("command line: lights", "nothing to do", "--off or --on N");
    }
    const StationConfig config = load_config(options->session);
    const bool real = !config.lights.gpio.chip.empty();
    if (real) switch_lights(*options, config.lights.gpio);
    const std::string done =
        real ? "all lights are off" : "the lights are simulated: there is nothing to switch";
    if (options->session.json) {
      fmt::print("{}\n", R"({"schema": "brdfgate.lights/1", "off": true})");
    } else {
      fmt::print("{}\n", done);
    }
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
