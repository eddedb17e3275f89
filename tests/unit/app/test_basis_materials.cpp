#include "app/commands/basis_commands.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

/// Two fits of three materials; nobody opens them here.
struct Folders {
  TempDir dir;
  Folders() {
    for (const char* name : {"first/brass.binary", "first/chrome.binary", "first/felt.binary",
                             "second/brass.binary", "second/felt.binary", "other/wood.binary"})
      dir.write(name, "x");
    dir.write("first/readme.txt", "no material");
  }
};

std::string names_of(const MaterialFiles& files) {
  std::string names;
  for (const auto& [name, file] : files)
    names += name + " ";
  return names;
}

std::string error_of(const std::filesystem::path& path) {
  return input_error([&] { return find_materials({path}); });
}

}  // namespace

TEST_CASE("materials are a folder's tables, single files, and the lines of a list") {
  const Folders f;
  CHECK(names_of(find_materials({f.dir / "first"})) == "brass chrome felt ");
  CHECK(names_of(find_materials({f.dir / "first/felt.binary"})) == "felt ");
  const auto list =
      f.dir.write("list.txt", "# metals\nfirst/brass.binary\n\n  first/chrome.binary  # shiny\r\n" +
                                  (f.dir / "other").string() + "\n");
  const MaterialFiles listed = find_materials({list, f.dir / "second/felt.binary"});
  CHECK(names_of(listed) == "brass chrome felt wood ");
  CHECK(listed.at("brass") == f.dir / "first/brass.binary");
}

TEST_CASE("what is no set of materials is refused with its place") {
  const Folders f;
  f.dir.write("empty/x.txt", "");
  const auto missing = f.dir.write("missing.txt", "first/brass.binary\nfirst/gold.binary\n");
  const auto empty = f.dir.write("empty.txt", "# nothing\n\n");
  const auto picture = f.dir.write("list.bin", std::string("\x89PNG\0\0", 6));
  const auto strange = f.dir.write("strange.txt", "first/readme.txt\n");
  const auto twice = f.dir.write("twice.txt", "first/brass.binary\nsecond/brass.binary\n");
  CHECK(contains(error_of(f.dir / "gone"), "gone: does not exist"));
  CHECK(contains(error_of(f.dir / "empty"), "holds no MERL .binary file"));
  CHECK(contains(error_of(missing), "missing.txt:2: "));
  CHECK(contains(error_of(missing), "gold.binary does not exist"));
  CHECK(contains(error_of(empty), "names no material"));
  CHECK(contains(error_of(picture), "neither a folder"));
  CHECK(contains(error_of(strange), "readme.txt is no MERL"));
  CHECK(contains(error_of(twice), "twice.txt:2: "));
  CHECK(contains(error_of(twice), "first/brass.binary"));
  CHECK(contains(input_error([&] { return find_materials({f.dir / "first", f.dir / "second"}); }),
                 "once"));
}

TEST_CASE("refits of materials that are trained on are further fits; others are ignored") {
  const Folders f;
  MaterialFiles files = find_materials({f.dir / "first"});
  leave_out(files, "felt");
  std::set<std::string> ignored;
  const auto set = with_refits(files, {f.dir / "second"}, ignored);
  REQUIRE(set.size() == 3);
  CHECK(set[0].fit == 0);
  CHECK(set[2].name == "brass");
  CHECK(set[2].fit == 1);
  CHECK(set[2].file == f.dir / "second/brass.binary");
  CHECK(ignored == std::set<std::string>{"felt"});  // left out is left out in every fit
  CHECK(with_refits(files, {}, ignored).size() == 2);
  CHECK(contains(input_error([&] { return with_refits(files, {f.dir / "other"}, ignored); }),
                 "has no material that is trained on"));
}

TEST_CASE("names to keep and to leave out must be there") {
  const Folders f;
  MaterialFiles files = find_materials({f.dir / "first"});
  CHECK(contains(input_error([&] { leave_out(files, "felt,gold"); }),
                 "--leave-out: no material of the name gold"));
  CHECK(contains(input_error([&] { keep_only(files, "gold"); }), "--only"));
  CHECK(files.size() == 3);
  const auto list = f.dir.write("names.txt", "felt\nbrass\n");
  keep_only(files, list.string());
  CHECK(names_of(files) == "brass felt ");
  leave_out(files, "brass");
  CHECK(names_of(files) == "felt ");
}
