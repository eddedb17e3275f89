// A folder for files that nobody keeps.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>

#include "model/error.hpp"

namespace brdfgate {

/// Made under the system's temporary folder (TMPDIR), gone with the object.
class TempFolder {
 public:
  /// Throws InputError where it cannot be made.
  TempFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "brdfgate-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) {
      throw InputError(name, "cannot make a temporary folder", "a writable TMPDIR");
    }
    path_ = name;
  }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;
  ~TempFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }

  std::filesystem::path operator/(std::string_view name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace brdfgate
