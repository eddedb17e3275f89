// Loading: everything about a YAML file that is wrong whatever it should contain.
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <fstream>
#include <sstream>

#include "config/yaml_reader.hpp"

namespace brdfgate {
namespace {

std::string place(const std::string& name, const YAML::Mark& mark) {
  return name + ":" + std::to_string(mark.line + 1) + ":" + std::to_string(mark.column + 1);
}

/// Watches the parser's events for what yaml-cpp lets pass and a tree of nodes hides or trips over:
/// duplicate keys (it keeps both), keys that are no text, nesting deep enough to exhaust the stack,
/// anchors that hold themselves (a tree without end).
class DocumentCheck final : public YAML::EventHandler {
 public:
  explicit DocumentCheck(std::string name) : name_(std::move(name)) {}

  void OnDocumentStart(const YAML::Mark& mark) override {
    if (++documents_ > 1) fail(mark, "a second document", "one document per file");
  }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t) override { leaf(mark, nullptr); }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    for (const Level& level : open_) {
      if (level.anchor == anchor) fail(mark, "an alias of what holds it", "no endless structure");
    }
    leaf(mark, nullptr);
  }
  void OnScalar(const YAML::Mark& mark, const std::string&, YAML::anchor_t,
                const std::string& value) override {
    leaf(mark, &value);
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    descend(mark, anchor, false);
  }
  void OnSequenceEnd() override { open_.pop_back(); }
  void OnMapStart(const YAML::Mark& mark, const std::string&, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    descend(mark, anchor, true);
  }
  void OnMapEnd() override { open_.pop_back(); }

 private:
  struct Level {
    YAML::anchor_t anchor = YAML::NullAnchor;
    bool map = false;
    bool key_next = false;
    std::set<std::string> keys;
  };

  [[noreturn]] void fail(const YAML::Mark& mark, const std::string& what,
                         const std::string& expected) const {
    throw InputError(place(name_, mark), what, expected);
  }

  /// True when what comes now is a key of the innermost mapping.
  bool take_key_turn() {
    if (open_.empty() || !open_.back().map) return false;
    const bool key = open_.back().key_next;
    open_.back().key_next = !key;
    return key;
  }

  void leaf(const YAML::Mark& mark, const std::string* text) {
    if (!take_key_turn()) return;
    if (text == nullptr) fail(mark, "a key that is no text", "key: value");
    if (!open_.back().keys.insert(*text).second) {
      fail(mark, "duplicate key " + shown(*text), "every key once");
    }
  }

  void descend(const YAML::Mark& mark, YAML::anchor_t anchor, bool map) {
    if (take_key_turn()) fail(mark, "a key that is no text", "key: value");
    if (open_.size() >= static_cast<std::size_t>(YamlNode::kMaxDepth)) {
      fail(mark, "nested too deeply", "at most " + std::to_string(YamlNode::kMaxDepth) + " levels");
    }
    open_.push_back({anchor, map, map, {}});
  }

  std::string name_;
  int documents_ = 0;
  std::vector<Level> open_;
};

void check_document(const std::string& text, const std::string& name) {
  std::istringstream in(text);
  YAML::Parser parser(in);
  DocumentCheck check(name);
  while (parser.HandleNextDocument(check)) {
  }
}

/// Text has no control characters but white space and escape-free UTF-8; a NUL or the like means
/// that somebody named an image or a program.
void check_is_text(const std::string& text, const std::string& name) {
  const auto binary = std::find_if(text.begin(), text.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return (byte < 0x20 && c != '\t' && c != '\n' && c != '\r') || byte == 0x7f;
  });
  if (binary == text.end()) return;
  throw InputError(name,
                   "byte " + std::to_string(binary - text.begin()) + " is a control character",
                   "a YAML text file");
}

YAML::Node parse(const std::string& text, const std::string& name) {
  try {
    check_document(text, name);
    return YAML::Load(text);
  } catch (const YAML::ParserException& error) {
    throw InputError(place(name, error.mark), "not YAML: " + error.msg);
  } catch (const YAML::Exception& error) {
    throw InputError(name, std::string("not YAML: ") + error.what());
  }
}

}  // namespace

std::string read_bytes(const std::filesystem::path& file, std::uintmax_t max_bytes) {
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  if (!std::filesystem::exists(status)) throw InputError(file.string(), "no such file");
  // A FIFO or a device would block or never end.
  if (!std::filesystem::is_regular_file(status)) {
    throw InputError(file.string(), "not a regular file");
  }
  const auto size = std::filesystem::file_size(file, error);
  if (error) throw InputError(file.string(), "cannot be read: " + error.message());
  if (size > max_bytes) {
    throw InputError(file.string(), std::to_string(size) + " bytes",
                     "at most " + std::to_string(max_bytes));
  }
  std::ifstream in(file, std::ios::binary);
  if (!in) throw InputError(file.string(), "cannot be opened", "a readable file");
  std::string bytes(size, '\0');
  in.read(bytes.data(), static_cast<std::streamsize>(size));
  if (static_cast<std::uintmax_t>(in.gcount()) != size) {
    throw InputError(file.string(), "cannot be read to its end");
  }
  return bytes;
}

YamlNode YamlNode::load_file(const std::filesystem::path& file) {
  return load_text(read_bytes(file, kMaxBytes), file.string());
}

YamlNode YamlNode::load_text(const std::string& text, const std::string& name) {
  if (text.size() > kMaxBytes) {
    throw InputError(name, std::to_string(text.size()) + " bytes",
                     "at most " + std::to_string(kMaxBytes));
  }
  check_is_text(text, name);
  const YAML::Node root = parse(text, name);
  if (!root.IsDefined() || root.IsNull()) throw InputError(name, "empty", "a YAML mapping");
  const YamlNode node(root, {name, root.Mark().line + 1, root.Mark().column + 1, ""});
  node.need_map();
  return node;
}

}  // namespace brdfgate
