#include "config/yaml_reader.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <numeric>

namespace brdfgate {
namespace {

std::string range_text(const YamlRange& range) {
  const bool low = std::isfinite(range.least);
  const bool high = std::isfinite(range.most);
  const std::string least = number_text(range.least);
  const std::string most = number_text(range.most);
  if (low && high && range.open) return "a number above " + least + " and below " + most;
  if (low && high) return "a number in " + least + ".." + most;
  if (low) return (range.open ? "a number above " : "a number of at least ") + least;
  if (high) return (range.open ? "a number below " : "a number of at most ") + most;
  return "a number";
}

bool inside(double value, const YamlRange& range) {
  if (range.open) return value > range.least && value < range.most;
  return value >= range.least && value <= range.most;
}

/// from_chars takes no leading plus; people write one before an angle.
std::string_view without_plus(std::string_view text) {
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  return text;
}

/// Levenshtein's distance.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0]++;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({substituted, row[j] + 1, diagonal + 1});
    }
  }
  return row.back();
}

/// The known key that was probably meant; empty when none is near.
template <typename Keys>
std::string nearest(std::string_view word, const Keys& keys) {
  std::string best;
  std::size_t least = std::max<std::size_t>(2, word.size() / 3) + 1;
  if (word.size() > 64) return best;
  for (const std::string& key : keys) {
    const std::size_t distance = edit_distance(word, key);
    if (distance < least && distance < key.size()) {
      least = distance;
      best = key;
    }
  }
  return best;
}

template <typename Words>
std::string joined(const Words& words) {
  std::string list;
  for (const std::string& word : words)
    list += (list.empty() ? "" : ", ") + word;
  return list;
}

template <typename Words>
std::string hint(std::string_view word, const Words& words) {
  const std::string near = nearest(word, words);
  return near.empty() ? "" : ", did you mean '" + near + "'?";
}

const char* kind(const YAML::Node& node) {
  if (node.IsMap()) return "a mapping";
  if (node.IsSequence()) return "a sequence";
  if (node.IsScalar()) return "a single value";
  return "empty";
}

}  // namespace

std::string number_text(double value) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  return {text.data(), end};
}

std::string shown(std::string_view text) {
  constexpr std::size_t kLongest = 60;
  std::string out = "'";
  for (const char c : text.substr(0, kLongest)) {
    if (static_cast<unsigned char>(c) >= 0x20 && c != 0x7f) {
      out += c;
      continue;
    }
    std::array<char, 5> escaped{};
    std::snprintf(escaped.data(), escaped.size(), "\\x%02x",
                  static_cast<unsigned>(static_cast<unsigned char>(c)));
    out += escaped.data();
  }
  return out + (text.size() > kLongest ? "...'" : "'");
}

YamlNode::YamlNode(const YAML::Node& node, Place place)
    : node_(node),
      place_(std::move(place)),
      asked_(std::make_shared<std::set<std::string, std::less<>>>()) {}

std::string YamlNode::where() const {
  const std::string at =
      place_.file + ":" + std::to_string(place_.line) + ":" + std::to_string(place_.column);
  return place_.path.empty() ? at : at + " (" + place_.path + ")";
}

void YamlNode::fail(const std::string& what, const std::string& expected) const {
  throw InputError(where(), what, expected);
}

void YamlNode::fail_at(std::string_view key, const std::string& what,
                       const std::string& expected) const {
  if (has(key)) at(key).fail(what, expected);
  const YamlNode absent(YAML::Node(), child_place(key, YAML::Node(), node_.Mark()));
  absent.fail(what, expected);
}

bool YamlNode::is_map() const {
  return node_.IsMap();
}

bool YamlNode::is_sequence() const {
  return node_.IsSequence();
}

std::size_t YamlNode::size() const {
  return is_map() || is_sequence() ? node_.size() : 0;
}

void YamlNode::need_map() const {
  if (!is_map()) fail(kind(node_), "a mapping (key: value)");
}

YamlNode::Place YamlNode::child_place(std::string_view key, const YAML::Node& value,
                                      const YAML::Mark& at) const {
  // An empty value's own mark is that of the next token, often a line or more away.
  const YAML::Mark mark = value.IsNull() ? at : value.Mark();
  const std::string prefix = place_.path.empty() ? "" : place_.path + ".";
  return {place_.file, mark.line + 1, mark.column + 1, prefix + std::string(key)};
}

bool YamlNode::has(std::string_view key) const {
  need_map();
  asked_->emplace(key);
  return std::any_of(node_.begin(), node_.end(),
                     [key](const auto& entry) { return entry.first.Scalar() == key; });
}

YamlNode YamlNode::at(std::string_view key) const {
  need_map();
  asked_->emplace(key);
  // Not operator[]: on a mutable node it inserts what it does not find.
  for (const auto& entry : node_) {
    if (entry.first.Scalar() != key) continue;
    return {entry.second, child_place(key, entry.second, entry.first.Mark())};
  }
  fail_at(key, "missing", "this key" + misspelling(key));
}

std::string YamlNode::misspelling(std::string_view key) const {
  for (const auto& entry : node_) {
    const std::string& word = entry.first.Scalar();
    const bool near = !nearest(word, std::array{std::string(key)}).empty();
    if (!near || asked_->count(word) != 0) continue;
    return " (is " + shown(word) + " in line " + std::to_string(entry.first.Mark().line + 1) +
           " a misspelling of it?)";
  }
  return "";
}

std::vector<YamlNode> YamlNode::items() const {
  if (!is_sequence()) fail(kind(node_), "a sequence ([a, b, ...])");
  std::vector<YamlNode> out;
  out.reserve(node_.size());
  for (const auto& item : node_) {
    const YAML::Mark mark = item.IsNull() ? node_.Mark() : item.Mark();
    out.push_back(YamlNode(item, {place_.file, mark.line + 1, mark.column + 1,
                                  place_.path + "[" + std::to_string(out.size()) + "]"}));
  }
  return out;
}

std::string YamlNode::scalar(const char* expected) const {
  if (!node_.IsScalar()) fail(kind(node_), expected);
  return node_.Scalar();
}

std::string YamlNode::plain_scalar(const std::string& expected) const {
  std::string text = scalar(expected.c_str());
  // yaml-cpp tags a quoted scalar "!".
  if (node_.Tag() == "!") fail("the text " + shown(text), expected + ", without quotes");
  return text;
}

double YamlNode::as_number(YamlRange range) const {
  const std::string text = plain_scalar(range_text(range));
  const std::string_view digits = without_plus(text);
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  const bool all = error == std::errc() && end == digits.data() + digits.size();
  if (!all || !std::isfinite(value)) fail(shown(text) + " is no finite number", range_text(range));
  if (!inside(value, range)) fail(text + " is out of range", range_text(range));
  return value;
}

std::int64_t YamlNode::as_integer(std::int64_t least, std::int64_t most) const {
  const std::string expected =
      "a whole number in " + std::to_string(least) + ".." + std::to_string(most);
  const std::string text = plain_scalar(expected);
  const std::string_view digits = without_plus(text);
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (end != digits.data() + digits.size() || error == std::errc::invalid_argument) {
    fail(shown(text) + " is no whole number", expected);
  }
  if (error != std::errc() || value < least || value > most) {
    fail(text + " is out of range", expected);
  }
  return value;
}

std::string YamlNode::as_text() const {
  return scalar("a text");
}

double YamlNode::number(std::string_view key, YamlRange range) const {
  return at(key).as_number(range);
}

double YamlNode::number_or(std::string_view key, double fallback, YamlRange range) const {
  return has(key) ? number(key, range) : fallback;
}

std::int64_t YamlNode::integer64(std::string_view key, std::int64_t least,
                                 std::int64_t most) const {
  return at(key).as_integer(least, most);
}

int YamlNode::integer(std::string_view key, int least, int most) const {
  return static_cast<int>(integer64(key, least, most));
}

int YamlNode::integer_or(std::string_view key, int fallback, int least, int most) const {
  return has(key) ? integer(key, least, most) : fallback;
}

bool YamlNode::boolean(std::string_view key) const {
  const YamlNode node = at(key);
  const std::string text = node.plain_scalar("true or false");
  if (text != "true" && text != "false") node.fail(shown(text), "true or false");
  return text == "true";
}

bool YamlNode::boolean_or(std::string_view key, bool fallback) const {
  return has(key) ? boolean(key) : fallback;
}

std::string YamlNode::text(std::string_view key) const {
  return at(key).as_text();
}

std::string YamlNode::text_or(std::string_view key, const std::string& fallback) const {
  return has(key) ? text(key) : fallback;
}

std::size_t YamlNode::choice(std::string_view key, const std::vector<std::string>& choices) const {
  const YamlNode node = at(key);
  const std::string expected = choices.size() == 1 ? choices.front() : "one of " + joined(choices);
  const std::string text = node.scalar(expected.c_str());
  const auto found = std::find(choices.begin(), choices.end(), text);
  if (found == choices.end()) node.fail(shown(text) + hint(text, choices), expected);
  return static_cast<std::size_t>(found - choices.begin());
}

std::vector<double> YamlNode::numbers(std::string_view key, std::size_t count,
                                      YamlRange range) const {
  const YamlNode list = at(key);
  const std::vector<YamlNode> nodes = list.items();
  if (count != 0 && nodes.size() != count) {
    list.fail(std::to_string(nodes.size()) + " values", std::to_string(count) + " of them");
  }
  std::vector<double> out;
  out.reserve(nodes.size());
  for (const YamlNode& node : nodes)
    out.push_back(node.as_number(range));
  return out;
}

std::vector<std::string> YamlNode::texts(std::string_view key) const {
  std::vector<std::string> out;
  for (const YamlNode& node : at(key).items())
    out.push_back(node.as_text());
  return out;
}

void YamlNode::finish() const {
  need_map();
  for (const auto& entry : node_) {
    const std::string& key = entry.first.Scalar();
    if (asked_->count(key) != 0) continue;
    const YamlNode unknown(entry.second, child_place(key, YAML::Node(), entry.first.Mark()));
    unknown.fail("unknown key" + hint(key, *asked_), "one of " + joined(*asked_));
  }
}

}  // namespace brdfgate
