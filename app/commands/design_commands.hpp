// What the design subcommands share.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

namespace brdfgate {

void add_design_points(CLI::App& design, int& exit_code);
void add_design_spheres(CLI::App& design, int& exit_code);
void add_design_camera(CLI::App& design, int& exit_code);
void add_design_rig(CLI::App& design, int& exit_code);
void add_design_path(CLI::App& design, int& exit_code);

/// Writes the whole file or throws InputError naming it.
void write_text(const std::filesystem::path& file, const std::string& text);

}  // namespace brdfgate
