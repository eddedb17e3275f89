// The one exception for an unusable input: what is wrong, where, and what would be right.
#pragma once

#include <stdexcept>
#include <string>

namespace brdfgate {

/// Thrown at the boundary where an unusable input is first seen. The programs print it as one line
/// "where: what; expected" and leave with exit code 2; the daemon's cycle turns it into "not
/// judged".
class InputError : public std::runtime_error {
 public:
  /// @param where     file, file:line:column or field path
  /// @param what      what is wrong with it, with the value seen
  /// @param expected  what would be right; may be empty
  InputError(const std::string& where, const std::string& what, const std::string& expected = "")
      : std::runtime_error(where + ": " + what +
                           (expected.empty() ? "" : "; expected " + expected)) {}
};

}  // namespace brdfgate
