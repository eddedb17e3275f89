#include <filesystem>
#include <fstream>
#include <iterator>

#include "app/plc/counters.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {
Counters counted() {
  return {10, 5, 3, 2, 4, 1, 7, 6, 5000};
}

std::string read(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}
void write(const std::filesystem::path& file, const std::string& text) {
  std::ofstream(file, std::ios::binary) << text;
}
}  // namespace

TEST_CASE("Counters come back after a restart, which is counted, with fresh result ids") {
  const TempDir dir;
  CounterFile(dir.path() / "state").store(counted());
  const CounterFile again(dir.path() / "state");
  Counters expected = counted();
  ++expected.restarts;
  expected.last_result_id += kResultIdGap;
  CHECK(again.at_start() == expected);
  CHECK(again.warning().empty());
}

TEST_CASE("The first start counts itself and has no warning") {
  const TempDir dir;
  const CounterFile first(dir.path() / "a" / "b");
  CHECK(first.at_start().restarts == 1);
  CHECK(first.at_start().inspected == 0);
  CHECK(first.warning().empty());
  CHECK(std::filesystem::exists(dir.path() / "a" / "b" / "counters.json"));
}

TEST_CASE("A start is on disk before anything else is stored") {
  const TempDir dir;
  for (std::uint32_t i = 1; i <= 3; ++i)
    CHECK(CounterFile(dir.path()).at_start().restarts == i);
}

TEST_CASE("A damaged file is put aside with a warning, and counting begins at zero") {
  const TempDir dir;
  const auto file = dir.path() / "counters.json";
  CounterFile(dir.path()).store(counted());
  const std::string good = read(file);
  std::string changed = good;
  changed.replace(changed.find("\"passed\": 5"), 11, "\"passed\": 6");
  for (const std::string& bad :
       {std::string(), std::string("{"), std::string("null"), std::string("[1, 2]"),
        good.substr(0, good.size() / 2), changed, std::string(100, '\0'),
        std::string("{\"schema\": \"brdfgate.counters/1\"}")}) {
    INFO(bad);
    write(file, bad);
    const CounterFile counters(dir.path());
    CHECK(contains(counters.warning(), "counters.json: damaged"));
    CHECK(counters.at_start().inspected == 0);
    CHECK(counters.at_start().restarts == 1);
    CHECK(read(dir.path() / "counters.json.damaged") == bad);
  }
}

TEST_CASE("Storing the same counters again does not write") {
  const TempDir dir;
  CounterFile counters(dir.path());
  counters.store(counted());
  std::filesystem::remove(dir.path() / "counters.json");
  counters.store(counted());
  CHECK_FALSE(std::filesystem::exists(dir.path() / "counters.json"));
  Counters more = counted();
  ++more.inspected;
  counters.store(more);
  CHECK(std::filesystem::exists(dir.path() / "counters.json"));
}

TEST_CASE("A directory that cannot be written is told by name") {
  const TempDir dir;
  write(dir.path() / "file", "x");
  CHECK(contains(input_error([&] {
                   CounterFile c(dir.path() / "file" / "state");
                   return 0;
                 }),
                 "file"));
  CounterFile counters(dir.path() / "state");
  std::filesystem::remove_all(dir.path() / "state");
  CHECK(contains(input_error([&] {
                   counters.store(counted());
                   return 0;
                 }),
                 "counters.json"));
}
