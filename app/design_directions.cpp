#include "app/design_directions.hpp"

#include <fmt/core.h>

#include <array>
#include <fstream>
#include <numbers>
#include <optional>
#include <string_view>

#include "app/number_text.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr const char* kHeader = "theta_h_deg,theta_d_deg,phi_d_deg";

std::string_view trimmed(std::string_view text) {
  constexpr const char* kBlank = " \t\r";
  const std::size_t first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::optional<HalfDiff> parse(std::string_view line) {
  std::array<double, 3> degrees{};
  for (std::size_t i = 0; i < degrees.size(); ++i) {
    const std::size_t comma = line.find(',');
    const bool last = i + 1 == degrees.size();
    if ((comma == std::string_view::npos) != last) return std::nullopt;
    const auto value = finite_number(trimmed(line.substr(0, comma)));
    if (!value) return std::nullopt;
    degrees[i] = *value * kDegree;
    line = last ? std::string_view() : line.substr(comma + 1);
  }
  return HalfDiff{degrees[0], degrees[1], degrees[2]};
}

}  // namespace

std::vector<HalfDiff> read_directions(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) throw InputError(file, "cannot be read", "a CSV file of directions");
  std::vector<HalfDiff> directions;
  bool header_seen = false;
  std::string line;
  for (int n = 1; std::getline(in, line); ++n) {
    const std::string_view words = trimmed(line);
    if (words.empty() || words.front() == '#') continue;
    const std::string where = fmt::format("{}:{}", file.string(), n);
    if (!header_seen) {
      if (words != kHeader) throw InputError(where, "is not the header", kHeader);
      header_seen = true;
      continue;
    }
    const auto direction = parse(words);
    if (!direction) throw InputError(where, "'" + std::string(words) + "'", "three numbers");
    if (!cosines(*direction).above_horizon()) {
      throw InputError(where, "the direction lies below the horizon",
                       "light and camera above the sample");
    }
    directions.push_back(*direction);
  }
  if (directions.empty()) throw InputError(file, "holds no direction", kHeader);
  return directions;
}

std::string directions_csv(const std::vector<HalfDiff>& directions) {
  std::string csv = std::string(kHeader) + "\n";
  for (const HalfDiff& d : directions) {
    csv += fmt::format("{:.6f},{:.6f},{:.6f}\n", d.theta_h / kDegree, d.theta_d / kDegree,
                       d.phi_d / kDegree);
  }
  return csv;
}

}  // namespace brdfgate
