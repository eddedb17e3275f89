// Files as text, and the YAML files that the project ships, found from the sources' own place.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <string_view>

namespace brdfgate::test {

inline std::filesystem::path shipped_file(std::string_view name) {
  const std::filesystem::path here = std::filesystem::absolute(__FILE__);
  return (here.parent_path() / "../../config" / name).lexically_normal();
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
