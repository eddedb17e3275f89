// Seeded damage to a text: what typing errors, bad merges and broken disks do to a file.
#pragma once

#include <array>
#include <random>
#include <stdexcept>
#include <string>
#include <string_view>

namespace brdfgate::test {

/// `text` with its only or first `from` replaced; throws when there is none, so that a test cannot
/// pass by changing nothing.
inline std::string replaced(std::string text, std::string_view from, std::string_view to) {
  const std::size_t at = text.find(from);
  if (at == std::string::npos) throw std::logic_error("no '" + std::string(from) + "' in the text");
  return text.replace(at, from.size(), to);
}

/// "line:column" of an offset, both from 1.
inline std::string place_of(std::string_view text, std::size_t offset) {
  std::size_t line = 1;
  std::size_t start = 0;
  for (std::size_t i = 0; i < offset && i < text.size(); ++i) {
    if (text[i] == '\n') {
      ++line;
      start = i + 1;
    }
  }
  return std::to_string(line) + ":" + std::to_string(offset - start + 1);
}

/// One to three edits: a byte changed, a stretch removed or doubled, a token put in, the end cut.
inline std::string mutated(std::string text, std::mt19937_64& random) {
  static constexpr std::array<std::string_view, 24> kTokens{
      "{",  "}", "[", "]",    ": ",    "- ",   "\n", "\t", "#",     "&a ", "*a",   "!!x ",
      "\"", "'", "~", ".nan", "-.inf", "1e99", "-1", "0",  "---\n", "? ",  "| \n", "<<: "};
  const auto below = [&](std::size_t n) { return n == 0 ? 0 : random() % n; };
  for (std::size_t edits = 1 + below(3); edits > 0; --edits) {
    const std::size_t at = below(text.size());
    switch (below(5)) {
      case 0:
        if (!text.empty()) text[at] = static_cast<char>(random());
        break;
      case 1:
        text.erase(at, 1 + below(20));
        break;
      case 2:
        text.insert(at, text.substr(at, 1 + below(80)));
        break;
      case 3:
        text.insert(at, kTokens[below(kTokens.size())]);
        break;
      default:
        if (below(4) == 0) text.resize(at);
    }
  }
  return text;
}

}  // namespace brdfgate::test
