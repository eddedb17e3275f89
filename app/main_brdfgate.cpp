// brdfgate: the technician's tool. Exit codes: 0 yes, 1 no, 3 not judged, 2 unusable input or
// environment.
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>

#include "app/commands/commands.hpp"
#include "app/session.hpp"

int main(int argc, char** argv) {
  // Standard output is the answer's, one JSON document with --json.
  spdlog::set_default_logger(spdlog::stderr_logger_mt("brdfgate"));
  CLI::App tool("brdfgate: measures how a surface reflects light, and judges it", "brdfgate");
  tool.require_subcommand(1);
  tool.set_version_flag("--version", BRDFGATE_VERSION);
  int exit_code = brdfgate::kExitUnusable;
  brdfgate::add_all_commands(tool, exit_code);
  if (const auto leave = brdfgate::parse_command_line(tool, argc, argv)) return *leave;
  return exit_code;
}
