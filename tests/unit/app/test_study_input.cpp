#include "app/study_input.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;
using nlohmann::json;

namespace {

json part() {
  return json::parse(R"({"t2_ratio": 0.5, "tilt_deg": [0.1, -0.2], "ambient": null, "clusters": [
    {"index": 0, "valid": {"gloss": true, "colour": false, "weights": true},
     "gloss_gu": {"20": 1.5, "60": 7.25, "85": 20}, "lab": [50, 1, 2], "t2": 3.5,
     "weights": [[1, 2], [3, 4], [5, 6]]},
    {"index": 1, "valid": {"gloss": false, "colour": true, "weights": true},
     "gloss_gu": {"20": 9, "60": 9, "85": 9}, "lab": [60, -3, 4], "weights": [[0, 0]]}]})");
}

double read(const std::string& name, int cluster = 0) {
  return reading_of(part(), {name, cluster}, "part_0001");
}

std::string refusal(const std::string& name, int cluster = 0) {
  return input_error([&] { return read(name, cluster); });
}

}  // namespace

TEST_CASE("Readings are found by their names in a result") {
  CHECK(read("gloss_60") == 7.25);
  CHECK(read("t2") == 3.5);
  CHECK(read("tilt_y") == -0.2);
  CHECK(read("t2_ratio") == 0.5);
  CHECK(read("weight_G_2") == 4);
  CHECK(read("a*", 1) == -3);
  CHECK(read("/gloss_gu/85") == 20);
}

TEST_CASE("A reading that is not there or not valid is refused by name") {
  CHECK(contains(refusal("gloss_60", 1), "part_0001: gloss_60 is not valid there"));
  CHECK(contains(refusal("L*"), "L* is not valid"));
  CHECK(contains(refusal("gloss"), "there is no reading 'gloss'; expected gloss_20, gloss_60"));
  CHECK(contains(refusal("weight_R_9"), "has no number for weight_R_9"));
  CHECK(contains(refusal("weight_X_1"), "there is no reading"));
  CHECK(contains(refusal("weight_R_0"), "there is no reading"));
  CHECK(contains(refusal("ambient"), "has no number for ambient"));
  CHECK(contains(refusal("gloss_60", 5), "has no cluster 5"));
  CHECK(contains(refusal("/none"), "has no number"));
  CHECK(contains(refusal("/a~b"), "--reading"));
}

TEST_CASE("A table is read with its columns in any order") {
  const TempDir dir;
  const auto file = dir.write("a.csv",
                              "# a study\noperator, value ,part\r\nA,1.5,\"p1\"\n\nA,2,p2\n"
                              "B,-3e-1,p1\nB,4,p2\nA,1.6,p1\nA,2.1,p2\nB,-0.4,p1\nB,4.1,p2\n");
  const auto values = read_study_table(file);
  REQUIRE(values.size() == 8);
  CHECK(values[2].value == -0.3);
  CHECK(values[2].operator_name == "B");
  CHECK(values[0].part == "p1");
  const GrrLayout layout = grr_layout(values);
  CHECK(layout.parts == std::vector<std::string>{"p1", "p2"});
  CHECK(layout.operators == std::vector<std::string>{"A", "B"});
  REQUIRE(layout.input.values.size() == 2);
  CHECK(layout.input.values[0](1, 1) == -0.4);
  CHECK(layout.input.values[1](0, 0) == 2);
}

TEST_CASE("A table that cannot be used is refused with its line") {
  const TempDir dir;
  const auto table = [&](const std::string& text) {
    const auto file = dir.write("a.csv", text);
    return input_error([&] { return grr_layout(read_study_table(file)); });
  };
  CHECK(contains(table("part,x\np,1\n"), "a.csv:1: the heading has no column 'value'"));
  CHECK(contains(table("part,value\np,1\np,one\n"), "a.csv:3: 'one' is no number"));
  CHECK(contains(table("part,value\np,1\np\n"), "a.csv:3"));
  CHECK(contains(table("part,value\n"), "holds no row"));
  CHECK(contains(table("value\n1\n"), "without a part"));
  CHECK(contains(table("part,operator,value\np,A,1\np,A,2\nq,A,3\n"),
                 "part 'q', operator 'A': 1 trial(s); expected 2"));
  CHECK(contains(input_error([&] { return read_study_table(dir / "no.csv"); }), "no.csv"));
}
