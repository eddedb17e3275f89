#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>

#include "catch.hpp"
#include "model/verdict.hpp"
#include "support/synthetic_part.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

const SyntheticStation& station() {
  static const SyntheticStation s;
  return s;
}

std::vector<Defect> defects_of(const SyntheticPart& part, const JudgeSettings& settings = {}) {
  const std::vector<Reflectance> r = render(station(), part);
  std::vector<TaughtAppearance> taught;
  for (const BrdfPtr& m : part.materials)
    taught.push_back(taught_from(station(), m));
  const Regions regions =
      assign_regions(r, station().map.bins, true_not_part(station(), part.region), taught,
                     settings.assign_tolerance);
  return find_defects(r, station().map, regions, taught, settings);
}

BrdfPtr satin(double albedo) {
  return shiny(Rgb::Constant(albedo), Rgb::Constant(0.05), 0.3);
}

struct Spot {
  double x_mm, y_mm, size_mm;
  Rgb factor;
};
std::function<Rgb(double, double)> spots(const std::vector<Spot>& all) {
  return [all](double x, double y) {
    Rgb f = Rgb::Constant(1);
    for (const Spot& s : all)
      if (std::hypot(x * 1e3 - s.x_mm, y * 1e3 - s.y_mm) < s.size_mm / 2) f *= s.factor;
    return f;
  };
}

}  // namespace

TEST_CASE("A clean noisy part has no defects, whatever its material") {
  const BrdfPtr material = GENERATE(matte({0.9, 0.9, 0.9}), matte({0.005, 0.005, 0.005}),
                                    shiny(Rgb::Constant(0.03), Rgb::Constant(0.05), 0.35),
                                    shiny({0.4, 0.1, 0.05}, Rgb::Constant(0.04), 0.08),
                                    shiny(Rgb::Zero(), Rgb::Constant(0.6), 0.1),
                                    shiny(Rgb::Zero(), {0.95, 0.7, 0.35}, 0.2));
  SyntheticPart part;
  part.materials = {material};
  part.seed = GENERATE(1U, 2U);
  CHECK(defects_of(part).empty());
}

TEST_CASE("Borders between materials are not defects") {
  SyntheticPart part;
  part.region = [](double x, double y) {
    return plain_part(x, y) == kNotPart ? int(kNotPart) : int(std::hypot(x, y) < 0.02);
  };
  part.materials = {matte({0.5, 0.5, 0.5}), matte({0.1, 0.1, 0.3})};
  CHECK(defects_of(part).empty());
}

TEST_CASE("A spot is found where it is, as large as it is and named for what it does") {
  struct Case {
    Rgb factor;
    std::string kind;
  };
  const std::vector<Case> cases{{Rgb::Constant(0.7), "darker"}, {Rgb::Constant(1.4), "lighter"},
                                {Rgb(1.0, 0.6, 0.6), "colour"}, {Rgb(1.3, 1.0, 0.75), "colour"},
                                {Rgb::Constant(0.3), "darker"}, {Rgb::Constant(2.5), "lighter"}};
  for (const Case& c : cases) {
    for (const BrdfPtr& material :
         {matte({0.3, 0.2, 0.3}), satin(0.2), shiny(Rgb::Zero(), Rgb::Constant(0.6), 0.25)}) {
      SyntheticPart part;
      part.materials = {material};
      part.change = spots({{12, -18, 5, c.factor}});
      const std::vector<Defect> found = defects_of(part);
      INFO(c.kind << " " << c.factor.transpose());
      REQUIRE(found.size() == 1);
      CHECK(found[0].kind == c.kind);
      CHECK(found[0].at_mm[0] == Approx(12).margin(0.3));
      CHECK(found[0].at_mm[1] == Approx(-18).margin(0.3));
      CHECK(found[0].size_mm == Approx(5).epsilon(0.15));
      CHECK(found[0].score > 1);
    }
  }
}

TEST_CASE("Size and place do not depend on where the camera sees the spot") {
  SyntheticPart part;
  part.materials = {matte({0.5, 0.5, 0.5})};
  for (const double x : {-33.0, 0.0, 33.0}) {
    for (const double y : {-33.0, 0.0, 33.0}) {
      part.change = spots({{x, y, 4, Rgb::Constant(0.6)}});
      const std::vector<Defect> found = defects_of(part);
      INFO(x << " " << y);
      REQUIRE(found.size() == 1);
      CHECK(found[0].at_mm[0] == Approx(x).margin(0.4));
      CHECK(found[0].at_mm[1] == Approx(y).margin(0.4));
      CHECK(found[0].size_mm == Approx(4).epsilon(0.15));
    }
  }
}

TEST_CASE("The score is the mean deviation over the threshold") {
  SyntheticPart part;
  part.materials = {matte({0.5, 0.5, 0.5})};
  part.change = spots({{0, 0, 12, Rgb::Constant(std::exp(-0.4))}});
  const std::vector<Defect> found = defects_of(part);
  REQUIRE(found.size() == 1);
  CHECK(found[0].score == Approx(2).epsilon(0.08));
}

TEST_CASE("Several defects are reported one by one, the heaviest first") {
  SyntheticPart part;
  part.materials = {matte({0.5, 0.5, 0.5})};
  part.change = spots({{-20, 20, 2, Rgb::Constant(0.7)},
                       {0, 0, 6, Rgb::Constant(0.4)},
                       {20, -20, 3, Rgb::Constant(1.5)}});
  const std::vector<Defect> found = defects_of(part);
  REQUIRE(found.size() == 3);
  CHECK(found[0].at_mm[0] == Approx(0).margin(0.3));
  CHECK(found[1].kind == "lighter");
  CHECK(found[2].at_mm[0] == Approx(-20).margin(0.3));
}

TEST_CASE("Smaller than the least area or weaker than the threshold is no defect") {
  SyntheticPart part;
  part.materials = {matte({0.5, 0.5, 0.5})};
  SECTION("half a millimetre") {
    part.change = spots({{0, 0, 0.5, Rgb::Constant(0.3)}});
    CHECK(defects_of(part).empty());
  }
  SECTION("15 per cent") {
    part.change = spots({{0, 0, 10, Rgb::Constant(0.85)}});
    CHECK(defects_of(part).empty());
    JudgeSettings strict;
    strict.defect_log_threshold = 0.1;
    CHECK(defects_of(part, strict).size() == 1);
  }
}

TEST_CASE("A lamp that drifted or a part a little darker all over is no local defect") {
  SyntheticPart part;
  part.materials = {satin(0.3)};
  part.change = [](double, double) { return Rgb(0.75, 0.8, 0.75); };
  CHECK(defects_of(part).empty());
}

TEST_CASE("A spot that no taught material explains is a defect of the material around it") {
  SyntheticPart part;
  part.materials = {matte({0.5, 0.5, 0.5})};
  part.change = spots({{10, 10, 8, Rgb::Constant(0.2)}});
  const std::vector<Reflectance> r = render(station(), part);
  const std::vector<TaughtAppearance> taught{taught_from(station(), part.materials[0])};
  const Regions regions =
      assign_regions(r, station().map.bins, true_not_part(station(), plain_part), taught, 0.45);
  REQUIRE(cv::countNonZero(regions.label == kUnknown) > 100);
  JudgeSettings blunt;  // so that only being unknown makes it one
  blunt.defect_log_threshold = 5;
  const std::vector<Defect> found = find_defects(r, station().map, regions, taught, blunt);
  REQUIRE(found.size() == 1);
  CHECK(found[0].kind == "darker");
  CHECK(found[0].at_mm[0] == Approx(10).margin(0.3));
  CHECK(found[0].size_mm == Approx(8).epsilon(0.15));
}

TEST_CASE("Noise on a black part does not add up to defects at a fine threshold") {
  SyntheticPart part;
  part.materials = {matte({0.004, 0.004, 0.004})};
  JudgeSettings fine;
  fine.defect_log_threshold = 0.05;
  CHECK(defects_of(part, fine).empty());
}

TEST_CASE("A mono sensor's defects are darker or lighter") {
  const SyntheticStation mono(364, 272, Mosaic::mono);
  SyntheticPart part;
  part.materials = {matte({0.5, 0.5, 0.5})};
  part.change = spots({{10, 10, 4, Rgb::Constant(0.6)}});
  const std::vector<Reflectance> r = render(mono, part);
  const std::vector<TaughtAppearance> taught{taught_from(mono, part.materials[0])};
  const Regions regions =
      assign_regions(r, mono.map.bins, true_not_part(mono, plain_part), taught, 0.45);
  const std::vector<Defect> found = find_defects(r, mono.map, regions, taught, {});
  REQUIRE(found.size() == 1);
  CHECK(found[0].kind == "darker");
}
