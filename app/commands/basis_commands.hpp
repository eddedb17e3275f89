// What the basis subcommands share: which materials a command line means.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace brdfgate {

/// The folders' MERL .binary files by name, sorted: the training set's order. Throws InputError for
/// a path that is no folder, an empty one, a name that appears twice.
std::map<std::string, std::filesystem::path> find_materials(
    const std::vector<std::filesystem::path>& folders);

/// Names separated by commas, or the lines of a file of that name.
std::set<std::string> read_names(const std::string& list);

/// Removes all but the listed ones. Throws InputError for a name that is not there.
void keep_only(std::map<std::string, std::filesystem::path>& materials, const std::string& list);

void add_basis_validate(CLI::App& basis, int& exit_code);

}  // namespace brdfgate
