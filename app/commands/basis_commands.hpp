// What the basis subcommands share: which materials a command line means.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "model/training_sources.hpp"

namespace brdfgate {

using MaterialFiles = std::map<std::string, std::filesystem::path>;

/// MERL .binary files by name, sorted: the training set's order. Each path is a folder of them, one
/// of them, or a list: a text file of such paths, one per line, relative to the list's folder, with
/// # before comments. Throws InputError for a path that is none of that, an empty folder or list
/// and a name that appears twice.
MaterialFiles find_materials(const std::vector<std::filesystem::path>& paths);

/// Names separated by commas, or the lines of a file of that name.
std::set<std::string> read_names(const std::string& list);

/// Removes all but the listed ones. Throws InputError for a name that is not there.
void keep_only(MaterialFiles& materials, const std::string& list);

/// Removes the listed ones. Throws InputError for a name that is not there.
void leave_out(MaterialFiles& materials, const std::string& list);

/// The materials as the first fit, and what `refits` has of the same names as the second, third ...
/// A refit of another name (left out, or not among the materials) is ignored and added to
/// `ignored`. Throws InputError where a folder has no refit of any of them.
std::vector<TrainingMaterial> with_refits(const MaterialFiles& materials,
                                          const std::vector<std::filesystem::path>& refits,
                                          std::set<std::string>& ignored);

void add_basis_validate(CLI::App& basis, int& exit_code);
void add_basis_goniometer(CLI::App& basis, int& exit_code);

}  // namespace brdfgate
