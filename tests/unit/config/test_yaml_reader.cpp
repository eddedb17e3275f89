#include <cmath>
#include <random>

#include "catch.hpp"
#include "config/yaml_reader.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using brdfgate::YamlNode;
using brdfgate::YamlRange;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

YamlNode load(const std::string& text) {
  return YamlNode::load_text(text, "f.yaml");
}

std::string repeated(const std::string& text, int times) {
  std::string out;
  for (int i = 0; i < times; ++i)
    out += text;
  return out;
}

/// Reads every key that the malformed documents below may have.
int read_all(const std::string& text) {
  const YamlNode root = load(text);
  const YamlNode a = root.at("a");
  a.number("x", {0, 1});
  a.number_or("above", 1, {0, 10, true});
  a.integer_or("n", 3, 1, 5);
  a.boolean_or("on", true);
  if (a.has("kind")) a.choice("kind", {"stain", "dust"});
  if (a.has("list")) a.numbers("list", 3, {-1, 1});
  if (a.has("words")) a.texts("words");
  a.text_or("name", "");
  a.finish();
  root.finish();
  return 0;
}

}  // namespace

TEST_CASE("A document is read by key, with defaults for what may be missing") {
  const YamlNode root = load(
      "a: &anchor {x: +0.25, n: -3, on: true, kind: dust}\n"
      "b: *anchor\n"
      "list: [1, 2.5e-3, -4]\n"
      "words: [one, '2', \"thr ee\"]\n"
      "big: 9223372036854775807\n");
  for (const char* key : {"a", "b"}) {
    const YamlNode node = root.at(key);
    CHECK(node.number("x") == 0.25);
    CHECK(node.integer("n", -5, 5) == -3);
    CHECK(node.boolean("on"));
    CHECK(node.choice("kind", {"stain", "dust"}) == 1);
    CHECK(node.number_or("none", 7) == 7);
    CHECK(node.integer_or("none", 8, 0, 9) == 8);
    CHECK_FALSE(node.boolean_or("none", false));
    CHECK(node.text_or("none", "fallback") == "fallback");
    CHECK_NOTHROW(node.finish());
  }
  CHECK(root.numbers("list", 3) == std::vector<double>{1, 0.0025, -4});
  CHECK(root.numbers("list", 0).size() == 3);
  CHECK(root.texts("words") == std::vector<std::string>{"one", "2", "thr ee"});
  CHECK(root.integer64("big", 0, INT64_MAX) == INT64_MAX);
  CHECK(root.size() == 5);
  CHECK_NOTHROW(root.finish());
}

TEST_CASE("Every malformed value is refused at its place with its path") {
  const auto [text, where, what] = GENERATE(table<std::string, std::string, std::string>({
      {"a: {x: 2}", "f.yaml:1:8 (a.x): ", "2 is out of range; expected a number in 0..1"},
      {"a: {x: -0.001}", "f.yaml:1:8 (a.x): ", "out of range"},
      {"a: {x: 0, above: 0}", "f.yaml:1:18 (a.above): ", "above 0 and below 10"},
      {"a: {x: 0, above: 10}", "f.yaml:1:18 (a.above): ", "above 0 and below 10"},
      {"a:\n  x: .nan", "f.yaml:2:6 (a.x): ", "'.nan' is no finite number"},
      {"a:\n  x: nan", "f.yaml:2:6 (a.x): ", "no finite number"},
      {"a:\n  x: -.inf", "f.yaml:2:6 (a.x): ", "no finite number"},
      {"a:\n  x: inf", "f.yaml:2:6 (a.x): ", "no finite number"},
      {"a:\n  x: 1e999", "f.yaml:2:6 (a.x): ", "no finite number"},
      {"a:\n  x: 0.5mm", "f.yaml:2:6 (a.x): ", "'0.5mm' is no finite number"},
      {"a:\n  x: 0x1", "f.yaml:2:6 (a.x): ", "no finite number"},
      {"a:\n  x: 0,5", "f.yaml:2:6 (a.x): ", "no finite number"},
      {"a:\n  x: '0.5'", "f.yaml:2:6 (a.x): ", "without quotes"},
      {"a:\n  x:\n  n: 3", "f.yaml:2:3 (a.x): ", "empty; expected a number in 0..1"},
      {"a:\n  x: [1]", "f.yaml:2:6 (a.x): ", "a sequence; expected a number"},
      {"a:\n  n: 3", "f.yaml:2:3 (a.x): ", "missing"},
      {"b: 1", "f.yaml:1:1 (a): ", "missing"},
      {"a: 5", "f.yaml:1:4 (a): ", "a single value; expected a mapping"},
      {"a: [5]", "f.yaml:1:4 (a): ", "a sequence; expected a mapping"},
      {"a: {x: 0, n: 6}",
       "f.yaml:1:14 (a.n): ", "6 is out of range; expected a whole number in 1..5"},
      {"a: {x: 0, n: 2.0}", "f.yaml:1:14 (a.n): ", "'2.0' is no whole number"},
      {"a: {x: 0, n: 99999999999999999999}", "f.yaml:1:14 (a.n): ", "out of range"},
      {"a: {x: 0, on: yes}", "f.yaml:1:15 (a.on): ", "'yes'; expected true or false"},
      {"a: {x: 0, on: 'true'}", "f.yaml:1:15 (a.on): ", "without quotes"},
      {"a: {x: 0, kind: strain}",
       "f.yaml:1:17 (a.kind): ", "'strain', did you mean 'stain'?; expected one of stain, dust"},
      {"a: {x: 0, kind: 77}", "f.yaml:1:17 (a.kind): ", "'77'; expected one of stain, dust"},
      {"a: {x: 0, list: [0, 0]}", "f.yaml:1:17 (a.list): ", "2 values; expected 3 of them"},
      {"a: {x: 0, list: 7}", "f.yaml:1:17 (a.list): ", "a single value; expected a sequence"},
      {"a: {x: 0, list: [0, 0, 3]}", "f.yaml:1:24 (a.list[2]): ", "a number in -1..1"},
      {"a: {x: 0, words: [[]]}", "f.yaml:1:19 (a.words[0]): ", "a sequence; expected a text"},
      {"a: {x: 0, name: {}}", "f.yaml:1:17 (a.name): ", "a mapping; expected a text"},
      {"a: {x: 0, name: ~}", "f.yaml:1:11 (a.name): ", "empty; expected a text"},
      {"a:\n  x: 0\n  nmae: b", "f.yaml:3:3 (a.nmae): ", "unknown key, did you mean 'name'?"},
      {"a: {x: 0}\nzzzzzz: 1", "f.yaml:2:1 (zzzzzz): ", "unknown key; expected one of a"},
      {"a: {x: 0}\na: {x: 1}", "f.yaml:2:1: ", "duplicate key 'a'; expected every key once"},
      {"a:\n  x: 0\n  n: 1\n  x: 0", "f.yaml:4:3: ", "duplicate key 'x'"},
      {"a: {x: 0}\nb: [{c: 1, c: 2}]", "f.yaml:2:12: ", "duplicate key 'c'"},
      {"a: {x: 0}\n[1]: 2", "f.yaml:2:1: ", "a key that is no text"},
      {"a: {x: 0}\n? {b: c}\n: 2", "f.yaml:2:3: ", "a key that is no text"},
      {"a: {x: 0}\n---\na: {x: 0}", "f.yaml:2:1: ", "a second document"},
      {"a: &x [1, *x]", "f.yaml:1:11: ", "an alias of what holds it"},
      {"a: {x: *none}", "f.yaml:1:8: ", "not YAML"},
      {"a: {x: 0", "f.yaml:1:1: ", "not YAML: end of map flow not found"},
      {"a: [1, 2}", "f.yaml:1:9: ", "not YAML"},
      {"a: b: c", "f.yaml:1:5: ", "not YAML"},
      {"a:\n\tx: 0", "f.yaml:2:3: ", "not YAML"},
      {"a: \"open", "f.yaml:1:", "not YAML"},
      {"", "f.yaml: ", "empty; expected a YAML mapping"},
      {"# only words\n", "f.yaml: ", "empty; expected a YAML mapping"},
      {"~", "f.yaml: ", "empty; expected a YAML mapping"},
      {"[1, 2]", "f.yaml:1:1: ", "a sequence; expected a mapping"},
      {"just text", "f.yaml:1:1: ", "a single value; expected a mapping"},
      {std::string("a: {x: 0}\0", 10), "f.yaml: ", "byte 9 is a control character"},
      {"\x7f"
       "ELF",
       "f.yaml: ", "control character; expected a YAML text file"},
  }));
  CAPTURE(text);
  const std::string message = input_error([&given = text] { return read_all(given); });
  CAPTURE(message, where, what);
  CHECK(message.rfind(where, 0) == 0);
  CHECK(contains(message, what));
  CHECK_FALSE(contains(message, "\n"));
}

TEST_CASE("Outside text in a message is escaped and cut") {
  CHECK(brdfgate::shown("plain") == "'plain'");
  CHECK(brdfgate::shown("a\nb\x1b") == "'a\\x0ab\\x1b'");
  CHECK(brdfgate::shown(std::string(1000, 'x')).size() < 80);
  const std::string message = input_error([] { return read_all("a: {x: \"1\\n\\e[31m\"}"); });
  CHECK(contains(message, "'1\\x0a\\x1b[31m'"));
}

TEST_CASE("Nesting that would exhaust the stack is refused, sane nesting is not") {
  for (const char* open : {"[", "[\n", "{a: ", "{a:\n", "- ", "? ", "a:\n  ", "!!seq ["}) {
    const std::string message = input_error([&] { return load("a: " + repeated(open, 100'000)); });
    CAPTURE(open, message);
    CHECK(contains(message, "f.yaml:"));
  }
  for (const auto& [open, close] : std::vector<std::pair<std::string, std::string>>{
           {"[", "]"}, {"{a: ", "}"}, {"- ", "b"}, {"[\n", "]\n"}}) {
    const std::string text = repeated(open, 100) + repeated(close, 100);
    const std::string message = input_error([&] { return load(text); });
    CAPTURE(open, message);
    CHECK(contains(message, "nested too deeply; expected at most 64 levels"));
  }
  CHECK_NOTHROW(load("a: " + repeated("[", 63) + repeated("]", 63)));
}

TEST_CASE("A pile of aliases costs no more than its text") {
  std::string text = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n";
  for (int i = 1; i < 40; ++i) {
    const std::string before = "*a" + std::to_string(i - 1);
    const std::string name = "a" + std::to_string(i);
    text += name + ": &" + name + " [" + before + repeated(", " + before, 8) + "]\n";
  }
  const YamlNode root = load(text);
  CHECK(root.at("a39").items().size() == 9);
}

TEST_CASE("A file that cannot be read says why") {
  const TempDir dir;
  CHECK(contains(input_error([&] { return YamlNode::load_file(dir / "none.yaml"); }),
                 "none.yaml: no such file"));
  CHECK(
      contains(input_error([&] { return YamlNode::load_file(dir.path()); }), "not a regular file"));
  CHECK(contains(input_error([&] { return YamlNode::load_file(dir.write("empty.yaml", "")); }),
                 "empty.yaml: empty"));
  const auto large = dir.write("large.yaml", "a: 1\n");
  std::filesystem::resize_file(large, YamlNode::kMaxBytes + 1);
  CHECK(contains(input_error([&] { return YamlNode::load_file(large); }),
                 "16777217 bytes; expected at most 16777216"));
  CHECK(YamlNode::load_file(dir.write("good.yaml", "a: 1\n")).number("a") == 1);
}

TEST_CASE("A caller's own complaint is placed at the value, or at the mapping that lacks it") {
  const YamlNode node = load("top:\n  inner: {key: 1}\n").at("top").at("inner");
  CHECK(node.where() == "f.yaml:2:10 (top.inner)");
  CHECK(input_error([&] {
          node.fail("wrong", "right");
          return 0;
        }) == "f.yaml:2:10 (top.inner): wrong; expected right");
  CHECK(input_error([&] {
          node.fail_at("key", "wrong");
          return 0;
        }) == "f.yaml:2:16 (top.inner.key): wrong");
  CHECK(input_error([&] {
          node.fail_at("none", "wrong");
          return 0;
        }) == "f.yaml:2:10 (top.inner.none): wrong");
}

TEST_CASE("A written number reads back as the same double") {
  std::mt19937_64 random(7);
  for (int i = 0; i < 1000; ++i) {
    const double value =
        std::ldexp(static_cast<double>(random()) - 9e18, static_cast<int>(random() % 200) - 160);
    REQUIRE(load("a: " + brdfgate::number_text(value)).number("a") == value);
  }
  CHECK(brdfgate::number_text(0.0963) == "0.0963");
}
