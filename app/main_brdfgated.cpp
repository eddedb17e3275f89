// brdfgated: the station's daemon. Exit codes: 0 stopped as told or --check holds, 2 unusable
// configuration or environment.
#include <fmt/core.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <thread>

#include "app/commands/commands.hpp"
#include "app/daemon.hpp"
#include "app/result_json.hpp"
#include "app/service_manager.hpp"
#include "app/session.hpp"

namespace {

struct DaemonOptions {
  brdfgate::SessionOptions session;
  bool check = false;
  int port = -1;
  std::filesystem::path port_file;
  std::filesystem::path state_dir;
  std::filesystem::path evidence;
};

void add_options(CLI::App& app, DaemonOptions& options) {
  options.session.add_overrides_to(app);
  app.add_option("--config", options.session.config, "station file")
      ->default_str(brdfgate::default_config().string());
  app.add_flag("--check", options.check, "validate the configuration and leave");
  app.add_option("--port", options.port,
                 "Modbus TCP port instead of the configuration's; 0: any free one")
      ->check(CLI::Range(0, 65535));
  app.add_option("--port-file", options.port_file, "write the port in use here once it is served");
  app.add_option("--state-dir", options.state_dir,
                 "where counters are kept, instead of the configuration's");
  app.add_option("--evidence", options.evidence, "keep pictures of the last part here");
}

/// SIGINT and SIGTERM, as a set that every thread blocks and one waits for.
sigset_t stop_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  return set;
}

int serve(const DaemonOptions& options) {
  brdfgate::StationConfig config = brdfgate::load_config(options.session);
  if (options.port >= 0) config.plc.tcp.port = options.port;
  if (!options.state_dir.empty()) config.files.state_dir = options.state_dir;
  if (options.check) {
    brdfgate::check_station(config);
    fmt::print("usable; configuration {}\n", config.hash.substr(0, 16));
    return brdfgate::kExitYes;
  }
  sigset_t signals = stop_signals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  brdfgate::Daemon daemon(config, options.evidence);
  spdlog::info("{}: Modbus TCP on {}:{}", config.name, config.plc.tcp.bind, daemon.port());
  if (!options.port_file.empty()) {
    brdfgate::write_text_file(options.port_file, std::to_string(daemon.port()) + "\n");
  }
  std::jthread inspections([&daemon](const std::stop_token& stop) { daemon.run(stop); });
  int signal = 0;
  sigwait(&signals, &signal);
  spdlog::info("stopping on signal {}", signal);
  brdfgate::notify_stopping();
  return brdfgate::kExitYes;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("brdfgated: inspects parts and tells a PLC over Modbus", "brdfgated");
  app.set_version_flag("--version", BRDFGATE_VERSION);
  DaemonOptions options;
  add_options(app, options);
  if (const auto leave = brdfgate::parse_command_line(app, argc, argv)) return *leave;
  spdlog::set_default_logger(spdlog::stderr_logger_mt("brdfgated"));
  try {
    return serve(options);
  } catch (const std::exception& error) {
    fmt::print(stderr, "brdfgated: {}\n", error.what());
    return brdfgate::kExitUnusable;
  }
}
