#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "app/design_directions.hpp"
#include "app/design_drawing.hpp"
#include "app/design_report.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

constexpr double kDegree = std::numbers::pi / 180;

PolarDirection at_degrees(double theta, double phi) {
  return {theta * kDegree, phi * kDegree};
}

RigDrawing two_lights() {
  RigDrawing drawing;
  drawing.title = "Rig <A> & B";
  drawing.disc_radius_m = 0.04;
  drawing.fov = 25 * kDegree;
  drawing.parts = {{"Camera", true, at_degrees(55, 0), 0.18, "aims at the centre"},
                   {"Light 1", false, at_degrees(55, 180), 0.3, ""},
                   {"Light 2", false, at_degrees(20, 120), 0, ""}};
  return drawing;
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t n = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1))
    ++n;
  return n;
}

}  // namespace

TEST_CASE("Directions survive their CSV") {
  const TempDir dir;
  const std::vector<HalfDiff> some{{0, 1.1, 0}, {0.5, 0.25, 3.1}};
  const auto back = read_directions(dir.write("d.csv", directions_csv(some)));
  REQUIRE(back.size() == 2);
  for (std::size_t i = 0; i < 2; ++i) {
    CHECK(back[i].theta_h == Approx(some[i].theta_h).margin(1e-7));
    CHECK(back[i].theta_d == Approx(some[i].theta_d).margin(1e-7));
    CHECK(back[i].phi_d == Approx(some[i].phi_d).margin(1e-7));
  }
}

TEST_CASE("Comments, blanks and a Windows editor's line ends do not matter") {
  const TempDir dir;
  const auto file =
      dir.write("d.csv", "# chosen\r\ntheta_h_deg,theta_d_deg,phi_d_deg\r\n\r\n 0 , 66,0 \r\n");
  CHECK(read_directions(file).size() == 1);
}

TEST_CASE("A wrong line of directions is named with its number") {
  const TempDir dir;
  const std::string header = "theta_h_deg,theta_d_deg,phi_d_deg\n";
  const auto error_of = [&](const std::string& text) {
    return input_error([&] { return read_directions(dir.write("d.csv", text)); });
  };
  CHECK(contains(error_of("1,2,3\n"), "d.csv:1: is not the header"));
  CHECK(contains(error_of(header + "1,2\n"), "d.csv:2: '1,2'; expected three numbers"));
  CHECK(contains(error_of(header + "1,2,3,4\n"), "d.csv:2"));
  CHECK(contains(error_of(header + "1,x,3\n"), "d.csv:2"));
  CHECK(contains(error_of(header + "1,nan,3\n"), "d.csv:2"));
  CHECK(contains(error_of(header + "0,66,0\n80,60,0\n"), "d.csv:3: the direction lies below"));
  CHECK(contains(error_of(header), "holds no direction"));
  CHECK(contains(error_of(""), "holds no direction"));
  CHECK(contains(input_error([&] { return read_directions(dir / "none.csv"); }), "cannot be read"));
}

TEST_CASE("A rig's drawing shows every part in both views and in the table") {
  const std::string svg = draw_rig_svg(two_lights());
  CHECK(svg.starts_with("<svg"));
  CHECK(contains(svg, "Rig &lt;A> &amp; B"));
  for (const char* label : {"Camera", "Light 1", "Light 2"})
    CHECK(count(svg, std::string(">") + label) == 3);
  CHECK(contains(svg, "147.4"));  // the camera's x: 180 sin 55 deg
  CHECK(contains(svg, "103.2"));  // and z
  CHECK(contains(svg, "parallel light"));
  CHECK(contains(svg, "(seen askew)"));  // light 2 is out of the side view's plane
  CHECK(count(svg, "<text") == count(svg, "</text>"));
  CHECK(!contains(svg, "nan"));
}

TEST_CASE("A drawing's scale fits its views and is printed") {
  for (const double distance : {0.02, 0.18, 1.0, 4.0}) {
    RigDrawing drawing = two_lights();
    drawing.disc_radius_m = distance / 5;
    for (RigPart& part : drawing.parts)
      part.distance_m = distance;
    const std::string svg = draw_rig_svg(drawing);
    const std::size_t at = svg.find("Scale 1:");
    REQUIRE(at != std::string::npos);
    const double scale = std::stod(svg.substr(at + 8));
    CHECK(1e3 * distance / scale <= 46 + 1e-9);
    CHECK(1e3 * distance / scale > 10);
  }
}

TEST_CASE("A path's CSV has a line of seventeen columns for every stop") {
  Goniometer g;
  g.camera_radius = 0.35;
  g.lamp_step = 7.5 * kDegree;
  g.max_theta = 82.5 * kDegree;
  g.clearance = 10 * kDegree;
  g.longest_move = 15 * kDegree;
  const GoniometerPath path = plan_path(g, {{0, 1.0, 0}, {0.3, 0.5, 1}});
  const std::string csv = path_csv(path);
  CHECK(count(csv, "\n") == path.stops.size() + 1);
  std::size_t start = 0;
  for (std::size_t end = csv.find('\n'); end != std::string::npos; end = csv.find('\n', start)) {
    const std::string line = csv.substr(start, end - start);
    CHECK(count(line, ",") == 16);
    start = end + 1;
  }
  const nlohmann::json document = to_json(path);
  CHECK(document["stops"].size() == path.stops.size());
  CHECK(document["schema"] == "brdfgate.design/1");
}

TEST_CASE("An infinite condition number is null in JSON") {
  DesignSummary summary;
  summary.kind = "rig";
  summary.score.condition = std::numeric_limits<double>::infinity();
  summary.score.error = {0.25, 0.5};
  summary.goal.beta = 0.1;
  summary.costs = {0.30, 0.3001, 0.5, 0.31};
  const nlohmann::json parsed = nlohmann::json::parse(to_json(summary).dump());
  CHECK(parsed["condition_number"].is_null());
  CHECK(parsed["expected_error"].get<double>() == Approx(0.3));
  CHECK(parsed["search"]["starts"] == 4);
  CHECK(parsed["search"]["within_1_percent"] == 2);
}
