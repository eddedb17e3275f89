// The tool's subcommands: one function each, which adds the command and stores its exit code when
// it ran.
#pragma once

#include <CLI/CLI.hpp>

namespace brdfgate {

void add_check(CLI::App& tool, int& exit_code);
void add_simulate(CLI::App& tool, int& exit_code);
void add_capture(CLI::App& tool, int& exit_code);
void add_calibrate(CLI::App& tool, int& exit_code);
void add_bracket(CLI::App& tool, int& exit_code);
void add_teach(CLI::App& tool, int& exit_code);
void add_inspect(CLI::App& tool, int& exit_code);
void add_reconstruct(CLI::App& tool, int& exit_code);
void add_basis(CLI::App& tool, int& exit_code);
void add_design(CLI::App& tool, int& exit_code);
void add_lights(CLI::App& tool, int& exit_code);
void add_compare(CLI::App& tool, int& exit_code);
void add_study(CLI::App& tool, int& exit_code);
void add_plc(CLI::App& tool, int& exit_code);

/// All of them, in the order of the command reference.
inline void add_all_commands(CLI::App& tool, int& exit_code) {
  for (const auto add :
       {add_check, add_simulate, add_capture, add_calibrate, add_bracket, add_teach, add_inspect,
        add_reconstruct, add_basis, add_design, add_lights, add_compare, add_study, add_plc}) {
    add(tool, exit_code);
  }
}

}  // namespace brdfgate
