// Numbers that people and other programs write.
#pragma once

#include <optional>
#include <string_view>

namespace brdfgate {

/// The whole text as a finite decimal number; empty where it is none, or more than one.
std::optional<double> finite_number(std::string_view text);

}  // namespace brdfgate
