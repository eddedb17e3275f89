// Scene files (cli.md, "Scene file") from YAML, with their materials and masks.
#pragma once

#include <filesystem>

#include "hal/sim/scene.hpp"

namespace brdfgate {

/// Reads, validates and loads what it names (MERL files, regions.png); paths relative to the file.
/// Throws InputError with file:line:column and field path. Optional keys default as cli.md shows.
Scene read_scene(const std::filesystem::path& file);

}  // namespace brdfgate
