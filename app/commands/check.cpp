// brdfgate check: is this station file usable, with everything it names?
#include <fmt/core.h>

#include <nlohmann/json.hpp>

#include "app/commands/commands.hpp"
#include "app/session.hpp"

namespace brdfgate {

void add_check(CLI::App& tool, int& exit_code) {
  struct Options {
    std::filesystem::path file;
    bool json = false;
  };
  auto options = std::make_shared<Options>();
  CLI::App* command =
      tool.add_subcommand("check", "validate a station file and everything it names");
  command->add_option("file", options->file, "station file")
      ->default_str(default_config().string());
  command->add_flag("--json", options->json, "print one JSON document on stdout");
  command->callback([options, &exit_code] {
    const StationConfig config =
        read_station_config(options->file.empty() ? default_config() : options->file);
    check_station(config);
    const std::string resolved = to_yaml(config);
    if (options->json) {
      const nlohmann::json document = {{"schema", "brdfgate.check/1"},
                                       {"usable", true},
                                       {"config_hash", config.hash},
                                       {"station_hash", config.station_hash},
                                       {"resolved", resolved}};
      fmt::print("{}\n", document.dump(2));
    } else {
      fmt::print("{}\n# usable; configuration {}, station {}\n", resolved,
                 config.hash.substr(0, 16), config.station_hash.substr(0, 16));
    }
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
