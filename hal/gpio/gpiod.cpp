#include "hal/gpio/gpiod.hpp"

#include <charconv>

namespace brdfgate {

std::optional<unsigned> gpio_line_number(const std::string& line) {
  unsigned number = 0;
  const char* const end = line.data() + line.size();
  const auto [rest, error] = std::from_chars(line.data(), end, number);
  if (error != std::errc() || rest != end) return std::nullopt;
  return number;
}

}  // namespace brdfgate
