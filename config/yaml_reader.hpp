// Strict YAML: every complaint has file:line:column and the field's path.
#pragma once

#include <yaml-cpp/yaml.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "model/error.hpp"

namespace brdfgate {

/// Where a number must lie; `open`: the ends themselves are excluded.
struct YamlRange {
  double least = -std::numeric_limits<double>::infinity();
  double most = std::numeric_limits<double>::infinity();
  bool open = false;
};

/// The shortest decimal text that reads back as the same double: what YAML files are written with.
std::string number_text(double value);
/// Outside text made fit for one line of an error message: quoted, escaped, cut when long.
std::string shown(std::string_view text);
/// A regular file's bytes. Throws InputError: missing, not a regular file, unreadable, over
/// `max_bytes`.
std::string read_bytes(const std::filesystem::path& file, std::uintmax_t max_bytes);

/// A node with its place. Keys that nobody asked for are errors when finish() is called; a
/// duplicate key is an error too. All readers throw InputError. finish() knows the keys asked of
/// this node and its copies: keep the node that at() returned, do not call at() again.
class YamlNode {
 public:
  static constexpr std::uintmax_t kMaxBytes = 16u << 20;  ///< of a file
  static constexpr int kMaxDepth = 64;                    ///< of nested mappings and sequences

  /// Reads a file; syntax errors, an empty or binary file, several documents, an anchor that holds
  /// itself and a file that is not a mapping are InputErrors.
  static YamlNode load_file(const std::filesystem::path& file);
  static YamlNode load_text(const std::string& text, const std::string& name);

  YamlNode at(std::string_view key) const;  ///< required
  bool has(std::string_view key) const;
  std::vector<YamlNode> items() const;  ///< of a sequence
  std::size_t size() const;             ///< of a sequence or mapping, 0 of anything else
  bool is_map() const;
  bool is_sequence() const;

  double number(std::string_view key, YamlRange range = {}) const;
  double number_or(std::string_view key, double fallback, YamlRange range = {}) const;
  int integer(std::string_view key, int least, int most) const;
  int integer_or(std::string_view key, int fallback, int least, int most) const;
  std::int64_t integer64(std::string_view key, std::int64_t least, std::int64_t most) const;
  bool boolean(std::string_view key) const;
  bool boolean_or(std::string_view key, bool fallback) const;
  std::string text(std::string_view key) const;
  std::string text_or(std::string_view key, const std::string& fallback) const;
  /// Index of the text among `choices`; the error lists them.
  std::size_t choice(std::string_view key, const std::vector<std::string>& choices) const;
  /// `count` 0: any number.
  std::vector<double> numbers(std::string_view key, std::size_t count, YamlRange range = {}) const;
  std::vector<std::string> texts(std::string_view key) const;
  double as_number(YamlRange range = {}) const;  ///< this node itself
  std::int64_t as_integer(std::int64_t least, std::int64_t most) const;
  std::string as_text() const;

  /// Refuses every key of this mapping that was not asked for; call after the last field.
  void finish() const;

  /// "file:line:column (path)", both counted from 1; the root has no path.
  std::string where() const;
  [[noreturn]] void fail(const std::string& what, const std::string& expected = "") const;
  /// The same at a key of this mapping: at its value, or at the mapping where it is missing.
  [[noreturn]] void fail_at(std::string_view key, const std::string& what,
                            const std::string& expected = "") const;

 private:
  struct Place {
    std::string file;
    int line = 1;    ///< from 1
    int column = 1;  ///< from 1
    std::string path;
  };
  YamlNode(const YAML::Node& node, Place place);
  std::string scalar(const char* expected) const;
  std::string plain_scalar(const std::string& expected) const;
  void need_map() const;
  /// A question about the key that may have been meant as the missing one; empty when none is near.
  std::string misspelling(std::string_view key) const;
  Place child_place(std::string_view key, const YAML::Node& value, const YAML::Mark& at) const;

  YAML::Node node_;
  Place place_;
  std::shared_ptr<std::set<std::string, std::less<>>> asked_;
};

}  // namespace brdfgate
