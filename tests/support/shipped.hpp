// Files as text, and the YAML files that the project ships, found above the running program: builds
// lie inside the checkout, and paths compiled in are relative where a compiler cache is shared.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <string_view>

namespace brdfgate::test {

inline std::filesystem::path shipped_file(std::string_view name) {
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe");
  for (std::filesystem::path dir = program.parent_path(); dir.has_relative_path();
       dir = dir.parent_path()) {
    if (std::filesystem::exists(dir / "config/station.yaml")) return dir / "config" / name;
  }
  throw std::runtime_error("no config/station.yaml above " + program.string());
}

inline std::string read_text_file(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw std::runtime_error("cannot read " + file.string());
  return {std::istreambuf_iterator<char>(in), {}};
}

inline std::string shipped_text(std::string_view name) {
  return read_text_file(shipped_file(name));
}

}  // namespace brdfgate::test
