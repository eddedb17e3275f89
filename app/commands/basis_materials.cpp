#include <algorithm>
#include <fstream>
#include <iterator>

#include "app/commands/basis_commands.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

std::string trimmed(const std::string& text) {
  constexpr const char* kBlank = " \t\r\n";
  const std::size_t first = text.find_first_not_of(kBlank);
  return first == std::string::npos ? ""
                                    : text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

bool is_table(const fs::path& file) {
  return file.extension() == ".binary";
}

void add_file(MaterialFiles& found, const fs::path& file, const std::string& where) {
  const auto [at, added] = found.emplace(file.stem(), file);
  if (!added) {
    throw InputError(where, "has the name of " + at->second.string(), "each material once");
  }
}

void add_folder(MaterialFiles& found, const fs::path& folder) {
  std::vector<fs::path> tables;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (is_table(entry.path())) tables.push_back(entry.path());
  }
  if (tables.empty()) throw InputError(folder, "holds no MERL .binary file");
  std::sort(tables.begin(), tables.end());
  for (const fs::path& table : tables)
    add_file(found, table, table);
}

/// One path of a list file.
void add_entry(MaterialFiles& found, const fs::path& path, const std::string& where) {
  if (fs::is_directory(path)) {
    add_folder(found, path);
  } else if (!fs::exists(path)) {
    throw InputError(where, path.string() + " does not exist", "a MERL .binary file or a folder");
  } else if (!is_table(path)) {
    throw InputError(where, path.string() + " is no MERL .binary file");
  } else {
    add_file(found, path, where + ": " + path.string());
  }
}

void add_list(MaterialFiles& found, const fs::path& list) {
  std::ifstream in(list);
  if (!in) throw InputError(list, "cannot read");
  const std::size_t before = found.size();
  int number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    // A binary file taken for a list is refused at its first line.
    if (line.find('\0') != std::string::npos) {
      throw InputError(list, "is neither a folder, a .binary file nor a list of paths");
    }
    const std::string entry = trimmed(line.substr(0, line.find('#')));
    if (entry.empty()) continue;
    add_entry(found, list.parent_path() / entry, list.string() + ":" + std::to_string(number));
  }
  if (found.size() == before) throw InputError(list, "names no material", "one path per line");
}

/// Names of a list that are not there.
std::string unknown_names(const MaterialFiles& materials, const std::set<std::string>& names) {
  std::string unknown;
  for (const std::string& name : names) {
    if (materials.count(name) == 0) unknown += (unknown.empty() ? "" : ", ") + name;
  }
  return unknown;
}

}  // namespace

MaterialFiles find_materials(const std::vector<fs::path>& paths) {
  MaterialFiles found;
  for (const fs::path& path : paths) {
    if (fs::is_directory(path)) {
      add_folder(found, path);
    } else if (!fs::exists(path)) {
      throw InputError(path, "does not exist", "a folder, a MERL .binary file or a list of them");
    } else if (is_table(path)) {
      add_file(found, path, path);
    } else {
      add_list(found, path);
    }
  }
  return found;
}

std::set<std::string> read_names(const std::string& list) {
  std::string text = list;
  std::error_code not_a_path;  // a long list is no valid file name
  if (fs::is_regular_file(list, not_a_path)) {
    std::ifstream in(list);
    text.assign(std::istreambuf_iterator<char>(in), {});
    std::replace(text.begin(), text.end(), '\n', ',');
  }
  std::set<std::string> names;
  for (std::size_t start = 0; start <= text.size();) {
    const std::size_t end = std::min(text.find(',', start), text.size());
    const std::string name = trimmed(text.substr(start, end - start));
    if (!name.empty()) names.insert(name);
    start = end + 1;
  }
  return names;
}

void keep_only(MaterialFiles& materials, const std::string& list) {
  const std::set<std::string> names = read_names(list);
  const std::string unknown = unknown_names(materials, names);
  if (!unknown.empty()) {
    throw InputError("--only", "no material of the name " + unknown,
                     "names of files under --materials");
  }
  std::erase_if(materials, [&](const auto& entry) { return names.count(entry.first) == 0; });
}

void leave_out(MaterialFiles& materials, const std::string& list) {
  const std::set<std::string> names = read_names(list);
  const std::string unknown = unknown_names(materials, names);
  if (!unknown.empty()) {
    throw InputError("--leave-out", "no material of the name " + unknown,
                     "names of files under --materials");
  }
  std::erase_if(materials, [&](const auto& entry) { return names.count(entry.first) != 0; });
}

std::vector<TrainingMaterial> with_refits(const MaterialFiles& materials,
                                          const std::vector<fs::path>& refits,
                                          std::set<std::string>& ignored) {
  std::vector<TrainingMaterial> set;
  for (const auto& [name, file] : materials)
    set.push_back({name, file, 0});
  int fit = 0;
  for (const fs::path& path : refits) {
    ++fit;
    const std::size_t before = set.size();
    for (const auto& [name, file] : find_materials({path})) {
      if (materials.count(name) != 0) {
        set.push_back({name, file, fit});
      } else {
        ignored.insert(name);
      }
    }
    if (set.size() == before) {
      throw InputError("--refit " + path.string(), "has no material that is trained on",
                       "second fits under the names of --materials");
    }
  }
  return set;
}

}  // namespace brdfgate
