// What an InputError says, for tests that check its words with either Catch2.
#pragma once

#include <string>
#include <string_view>

#include "model/error.hpp"

namespace brdfgate::test {

/// The message of the InputError that `call` throws; "(no error)" when it returns. Any other
/// exception passes through and fails the test.
template <typename Call>
std::string input_error(Call&& call) {
  try {
    static_cast<void>(call());
  } catch (const InputError& error) {
    return error.what();
  }
  return "(no error)";
}

inline bool contains(std::string_view text, std::string_view part) {
  return text.find(part) != std::string_view::npos;
}

}  // namespace brdfgate::test
