#include <cmath>
#include <numbers>
#include <random>
#include <string>

#include "catch.hpp"
#include "model/error.hpp"
#include "model/local_defects.hpp"
#include "support/synthetic_part.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

const SyntheticStation& station() {
  static const SyntheticStation s;
  return s;
}
const DefectBlocks& blocks() {
  static const DefectBlocks b(station().geometry, station().map.cells);
  return b;
}

Regions regions_of(const SyntheticPart& part) {
  return {true_labels(station(), part.region), static_cast<int>(part.materials.size()), 1.0};
}

DefectEvidence evidence(const SyntheticPart& part, const std::vector<BrdfPtr>& taught) {
  return defect_evidence(render(station(), part), home_labels(regions_of(part)), blocks(), {},
                         taught);
}

BrdfPtr satin(double albedo, double alpha = 0.2, double gloss = 1) {
  return shiny(Rgb::Constant(albedo), Rgb::Constant(0.05 * gloss), alpha);
}

/// Good parts of one kind: 0.5 % in albedo, 1 % in gloss and in roughness.
SyntheticPart produced(double albedo, double alpha, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  SyntheticPart part;
  part.seed = seed + 1000;
  const double a = 1 + 0.005 * normal(random), r = 1 + 0.01 * normal(random);
  part.materials = {satin(albedo * a, alpha * r, 1 + 0.01 * normal(random))};
  return part;
}

const DefectReference& reference() {
  static const DefectReference taught = [] {
    std::vector<DefectEvidence> parts;
    for (unsigned seed = 0; seed < 12; ++seed)
      parts.push_back(evidence(produced(0.2, 0.2, seed), {satin(0.2)}));
    return teach_defects(parts, blocks(), 0.001);
  }();
  return taught;
}

std::vector<Defect> found(const SyntheticPart& part) {
  const std::vector<BrdfPtr> taught{satin(0.2)};
  return find_defects(evidence(part, taught), blocks(), reference(), taught, {});
}

struct Spot {
  double x_mm, y_mm, size_mm;
  Rgb factor;
};
std::function<Rgb(double, double)> spot(const Spot& s) {
  return [s](double x, double y) -> Rgb {
    const bool in = std::hypot(x * 1e3 - s.x_mm, y * 1e3 - s.y_mm) < s.size_mm / 2;
    return in ? s.factor : Rgb::Constant(1);
  };
}

/// A part of two materials: the second is a disc somewhere.
SyntheticPart with_patch(const BrdfPtr& patch, double x_mm, double y_mm, double size_mm) {
  SyntheticPart part = produced(0.2, 0.2, 500);
  part.materials.push_back(patch);
  part.region = [=](double x, double y) {
    if (plain_part(x, y) == kNotPart) return int(kNotPart);
    return int(std::hypot(x * 1e3 - x_mm, y * 1e3 - y_mm) < size_mm / 2);
  };
  return part;
}

/// The patch is not known as a material of its own.
std::vector<Defect> found_in_patched(const SyntheticPart& part) {
  Regions regions = regions_of(part);
  regions.label.setTo(0, regions.label == 1);
  const std::vector<BrdfPtr> taught{satin(0.2)};
  return find_defects(
      defect_evidence(render(station(), part), home_labels(regions), blocks(), {}, taught),
      blocks(), reference(), taught, {});
}

}  // namespace

TEST_CASE("Fresh good parts show no local defects") {
  for (unsigned seed = 100; seed < 115; ++seed)
    CHECK(found(produced(0.2, 0.2, seed)).empty());
}

TEST_CASE("A spot is found where it is, about as large as it is, and named for what it does") {
  struct Case {
    Rgb factor;
    std::string kind;
  };
  const std::vector<Case> cases{{Rgb::Constant(0.7), "darker"},
                                {Rgb::Constant(1.4), "lighter"},
                                {Rgb(1.0, 0.6, 0.6), "colour"},
                                {Rgb(1.3, 1.0, 0.75), "colour"},
                                {Rgb::Constant(0.3), "darker"}};
  for (const Case& c : cases) {
    SyntheticPart part = produced(0.2, 0.2, 77);
    part.change = spot({12, -9, 6, c.factor});
    const std::vector<Defect> defects = found(part);
    REQUIRE(defects.size() == 1);
    CHECK(defects[0].kind == c.kind);
    CHECK(defects[0].at_mm[0] == Approx(12).margin(0.4));
    CHECK(defects[0].at_mm[1] == Approx(-9).margin(0.4));
    CHECK(defects[0].size_mm == Approx(6).epsilon(0.2));
    CHECK(defects[0].score > 1);
    // What teaching takes a limit from is what a blob is scored by.
    CHECK(defect_peak(evidence(part, {satin(0.2)}), blocks(), reference()) ==
          Approx(defects[0].score * reference().limit));
  }
}

TEST_CASE("A stain of a thousandth of the part is found wherever it lies") {
  const double size_mm = 2 * std::sqrt(0.001 * 80 * 80 / std::numbers::pi);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-26, 26);
  for (int i = 0; i < 12; ++i) {
    SyntheticPart part = with_patch(satin(0.1), place(random), place(random), size_mm);
    CHECK(found_in_patched(part).size() == 1);
  }
}

TEST_CASE("A rougher patch is duller in the highlight and a smoother one glossier") {
  const double size_mm = 2 * std::sqrt(0.002 * 80 * 80 / std::numbers::pi);
  const std::vector<Defect> dull = found_in_patched(with_patch(satin(0.2, 0.3), 2, 3, size_mm));
  REQUIRE(dull.size() == 1);
  CHECK(dull[0].kind == "duller");
  CHECK(dull[0].change < 0);
  const std::vector<Defect> bright = found_in_patched(with_patch(satin(0.2, 0.13), 2, 3, size_mm));
  REQUIRE_FALSE(bright.empty());
  CHECK(bright[0].kind == "glossier");
}

TEST_CASE("Borders between materials are not defects") {
  SyntheticPart part = with_patch(matte({0.6, 0.1, 0.1}), 5, 5, 30);
  const std::vector<BrdfPtr> taught{satin(0.2), matte({0.6, 0.1, 0.1})};
  CHECK(find_defects(evidence(part, taught), blocks(), {}, taught, {}).empty());
}

TEST_CASE("What taught parts show of another material says nothing of a part that lies elsewhere") {
  // The disc is known wrongly, by an error that varies over the highlight: teaching takes it up.
  const Rgb red(0.6, 0.1, 0.1), gloss = Rgb::Constant(0.05);
  const BrdfPtr disc = shiny(red, gloss, 0.12);
  const std::vector<BrdfPtr> known{satin(0.2), shiny(red, gloss, 0.144)};
  constexpr double kDisc = 30, kX = 15, kY = 3, kShift = 4;  // mm
  const SyntheticPart at_home = with_patch(disc, kX, kY, kDisc);
  const cv::Mat taught = home_labels(regions_of(at_home));
  std::vector<DefectEvidence> good;
  for (unsigned seed = 0; seed < 12; ++seed) {
    SyntheticPart part = at_home;
    part.seed = seed;
    good.push_back(defect_evidence(render(station(), part), taught, blocks(), {}, known, taught));
  }
  CHECK(cv::countNonZero(good[0].elsewhere) == 0);
  const DefectReference limits = teach_defects(good, blocks(), 0.001);
  SyntheticPart moved = with_patch(disc, kX + kShift, kY, kDisc);
  moved.seed = 70;
  const auto seen = [&](const cv::Mat& shown) {
    return defect_evidence(render(station(), moved), home_labels(regions_of(moved)), blocks(), {},
                           known, shown);
  };
  const auto block_at = [](double x_mm, double y_mm) {
    cv::Mat away;
    std::vector<cv::Mat> xy;
    cv::split(blocks().position_m(), xy);
    cv::magnitude(xy[0] - 1e-3 * x_mm, xy[1] - 1e-3 * y_mm, away);
    cv::Point at;
    cv::minMaxLoc(away, nullptr, nullptr, &at);
    return at;
  };
  const DefectEvidence part = seen(taught);
  CHECK(part.elsewhere.at<unsigned char>(block_at(2, kY)) != 0);   // was disc
  CHECK(part.elsewhere.at<unsigned char>(block_at(32, kY)) != 0);  // is disc now
  CHECK(part.elsewhere.at<unsigned char>(block_at(-6, kY)) == 0);
  CHECK(part.elsewhere.at<unsigned char>(block_at(17, kY)) == 0);
  const auto score = [&](const DefectEvidence& e, const cv::Point& at) {
    return std::abs(largest_scores(e, blocks(), limits)[0](at));
  };
  CHECK_FALSE(find_defects(seen({}), blocks(), limits, known, {}).empty());
  CHECK(find_defects(part, blocks(), limits, known, {}).empty());
  CHECK(score(part, block_at(2, kY)) < 0.5 * score(seen({}), block_at(2, kY)));
  moved.change = spot({2, kY, 3, Rgb::Constant(0.6)});
  CHECK(find_defects(seen(taught), blocks(), limits, known, {}).size() == 1);
}

TEST_CASE("Across a border between materials a stain is found, labels that err are none") {
  const std::vector<BrdfPtr> taught{satin(0.2), matte({0.6, 0.1, 0.1})};
  const double stain_mm = 2 * std::sqrt(0.001 * 80 * 80 / std::numbers::pi);
  constexpr double kDisc = 30, kX = 5, kY = 4;  // mm
  const auto seen_with = [&](const SyntheticPart& part, const SyntheticPart& labels) {
    return defect_evidence(render(station(), part), home_labels(regions_of(labels)), blocks(), {},
                           taught);
  };
  std::vector<DefectEvidence> good;
  for (unsigned seed = 0; seed < 12; ++seed) {
    SyntheticPart part = with_patch(taught[1], kX + 0.04 * seed, kY - 0.04 * seed, kDisc);
    part.seed = seed;
    good.push_back(seen_with(part, part));
  }
  const DefectReference limits = teach_defects(good, blocks(), 0.001);
  for (int i = 0; i < 12; ++i) {
    // Labels are half a millimetre off, a cell or two, one way or the other.
    const SyntheticPart labels = with_patch(taught[1], kX, kY, kDisc + (i % 2 == 0 ? 1 : -1));
    SyntheticPart part = with_patch(taught[1], kX, kY, kDisc);
    part.seed = 900 + static_cast<unsigned>(i);
    CHECK(find_defects(seen_with(part, labels), blocks(), limits, taught, {}).empty());
    const double angle = 2 * std::numbers::pi * i / 12;
    const double x = kX + kDisc / 2 * std::cos(angle), y = kY + kDisc / 2 * std::sin(angle);
    part.change = spot({x, y, stain_mm, Rgb::Constant(0.5)});
    const std::vector<Defect> defects =
        find_defects(seen_with(part, labels), blocks(), limits, taught, {});
    CAPTURE(i, x, y);
    REQUIRE(defects.size() == 1);
    CHECK(std::hypot(defects[0].at_mm[0] - x, defects[0].at_mm[1] - y) < 0.8);
    CHECK(defects[0].kind == "darker");
  }
}

TEST_CASE("A stain that looks like another taught material is told from it by the taught layout") {
  SyntheticPart part = with_patch(satin(0.1), 10, 10, 6);
  const Regions mistaken = regions_of(part);  // label 1 where the stain is
  cv::Mat expected = true_labels(station(), plain_part);
  const std::vector<BrdfPtr> taught{satin(0.2), satin(0.1)};
  const auto defects = [&](const cv::Mat& home) {
    return find_defects(defect_evidence(render(station(), part), home, blocks(), {}, taught),
                        blocks(), reference(), taught, {});
  };
  CHECK(defects(home_labels(mistaken)).empty());
  CHECK(defects(home_labels(mistaken, expected)).size() == 1);
}

TEST_CASE("Unknown cells take the material around them") {
  Regions regions{cv::Mat(20, 20, CV_8UC1, cv::Scalar(3)), 4, 1.0};
  regions.label(cv::Rect(5, 5, 4, 4)) = kUnknown;
  CHECK(cv::countNonZero(home_labels(regions) == 3) == 400);
}

TEST_CASE("The limit holds its false-alarm rate on fresh maxima") {
  // Maxima of 3000 Gaussians: nearly Gumbel. 200 teachings of 20, each with many fresh parts.
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(1e-9, 1);
  const auto maximum = [&] { return 20 - 2 * std::log(-std::log(uniform(random))); };
  double beyond = 0;
  constexpr int kTeachings = 200, kFresh = 500;
  for (int t = 0; t < kTeachings; ++t) {
    std::vector<double> taught(20);
    for (double& x : taught)
      x = maximum();
    const double limit = defect_limit(taught, 10, 0.01);
    for (int i = 0; i < kFresh; ++i)
      beyond += maximum() > limit;
  }
  CHECK(beyond / (kTeachings * kFresh) == Approx(0.01).margin(0.004));
}

TEST_CASE("Few parts fall back on noise with a margin, and noise is a floor for many") {
  const double few = defect_limit({7, 7}, 1e4, 0.001);
  const double many = defect_limit({1, 1.1, 0.9, 1.05, 0.95, 1}, 1e4, 0.001);
  CHECK(few == Approx(1.5 * many));
  CHECK(many == Approx(5.33).margin(0.02));  // P(|z| > 5.33) = 1e-7 = 0.001 / 1e4
  CHECK_THROWS_AS(defect_limit({}, 10, 0.7), InputError);
  CHECK_THROWS_AS(teach_defects({}, blocks(), 0.001), InputError);
}
