#include <array>
#include <string>
#include <vector>

#include "catch.hpp"
#include "config/chart_reader.hpp"
#include "support/input_error.hpp"
#include "support/mutate.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::replaced;
using brdfgate::test::TempDir;

namespace {

constexpr const char* kChart = R"(schema: brdfgate.chart/1
name: two greys
illuminant: D50
observer_deg: 2
columns: 2
rows: 1
pitch_mm: 20
patch_mm: 15
patches:
  - {name: light, lab: [80, 0, 0]}
  - {name: dark, xyz: [0.0964, 0.1, 0.0825]}
)";

}  // namespace

TEST_CASE("A chart's colours are brought to D65, its lengths to metres") {
  const TempDir dir;
  const ColourChart chart = read_chart(dir.write("a.yaml", kChart));
  CHECK(chart.name == "two greys");
  CHECK(chart.illuminant == "D50");
  CHECK(chart.pitch_m == 0.02);
  REQUIRE(chart.patches.size() == 2);
  // A grey is grey under any light.
  CHECK((xyz_to_lab(chart.patches[0].xyz) - Lab(80, 0, 0)).abs().maxCoeff() < 1e-9);
  CHECK((xyz_to_lab(chart.patches[1].xyz) - Lab(37.84, 0, 0)).abs().maxCoeff() < 0.02);
  const ColourChart d65 =
      read_chart(dir.write("b.yaml", replaced(kChart, "illuminant: D50", "illuminant: D65")));
  CHECK((xyz_to_lab(d65.patches[0].xyz) - Lab(80, 0, 0)).abs().maxCoeff() < 1e-9);
  CHECK(d65.patches[1].xyz[2] == 0.0825);
}

TEST_CASE("A chart's file that cannot be right is refused by its field") {
  const TempDir dir;
  for (const auto& [from, to, what] : std::vector<std::array<std::string, 3>>{
           {"illuminant: D50", "illuminant: A", "(illuminant)"},
           {"observer_deg: 2", "observer_deg: 10", "(observer_deg)"},
           {"columns: 2", "columns: 3", "(patches): 2 patches; expected 3"},
           {"patch_mm: 15", "patch_mm: 25", "(patch_mm): patches larger"},
           {"[80, 0, 0]", "[80, 0]", "(patches[0].lab)"},
           {"name: dark, ", "", "(patches[1].name)"},
           {"rows: 1", "rows: 1\nrow: 1", "row"}}) {
    CAPTURE(to);
    const auto file = dir.write("a.yaml", replaced(kChart, from, to));
    CHECK(contains(input_error([&] { return read_chart(file); }), what));
  }
}
