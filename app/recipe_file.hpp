// Recipes on disk: one readable YAML file.
#pragma once

#include <filesystem>

#include "model/recipe.hpp"

namespace brdfgate {

/// Atomic. Throws InputError where it cannot write.
void write_recipe(const std::filesystem::path& file, const Recipe& recipe);
/// Throws InputError with file:line:column and field path; more than 8 clusters are refused.
Recipe read_recipe(const std::filesystem::path& file);

}  // namespace brdfgate
