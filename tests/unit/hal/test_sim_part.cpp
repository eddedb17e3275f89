#include <algorithm>
#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "hal/sim/part.hpp"
#include "support/input_error.hpp"
#include "support/sim_rig.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using Eigen::Vector2d;
using std::numbers::pi;

namespace {

constexpr HalfDiff kAtPeak{.theta_h = 0.01, .theta_d = 0.9, .phi_d = 0.3};
constexpr HalfDiff kOnFlank{.theta_h = 0.25, .theta_d = 0.9, .phi_d = 0.3};
const GgxParameters kPlastic{Rgb(0.3, 0.2, 0.1), Rgb::Constant(0.04), 0.1};

Scene plastic_part() {
  return part_of({{"body", make_brdf(kPlastic)}});
}

Vector2d mm(double x, double y) {
  return Vector2d(x, y) * 1e-3;
}

double red(const PartSurface& surface, const Vector2d& p, const HalfDiff& angles = kOnFlank) {
  return surface.f(p, angles)[0];
}

PartSurface with_defect(DefectKind kind, double size_mm, double strength) {
  Scene scene = plastic_part();
  scene.defects = {{.kind = kind, .at_mm = {10, -5}, .size_mm = size_mm, .strength = strength}};
  return {scene, {}};
}

std::string refusal(const Scene& scene) {
  return input_error([&] { return PartSurface(scene, {}); });
}

}  // namespace

TEST_CASE("draws stay within the jitter's half-widths and reach toward them") {
  Scene scene;
  scene.pose.height_mm = 2;
  scene.jitter.shift_mm = {0.5, 0.2};
  scene.jitter.tilt_deg = {0.1, 0.3};
  scene.jitter.rotation_deg = 1;
  double largest = 0;
  for (std::uint64_t i = 0; i < 500; ++i) {
    const ScenePose pose = draw_part(scene, 3, i).pose;
    CHECK(std::abs(pose.shift_mm[0]) <= 0.5);
    CHECK(std::abs(pose.shift_mm[1]) <= 0.2);
    CHECK(std::abs(pose.tilt_deg[0]) <= 0.1);
    CHECK(std::abs(pose.tilt_deg[1]) <= 0.3);
    CHECK(std::abs(pose.rotation_deg) <= 1);
    CHECK(pose.height_mm == 2);
    largest = std::max(largest, pose.shift_mm[0]);
  }
  CHECK(largest > 0.49);
}

TEST_CASE("variation has the scene's standard deviation around one") {
  Scene scene;
  scene.variation = {.albedo = 0.02, .gloss = 0.05, .roughness = 0.1};
  constexpr int kParts = 4000;
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  Eigen::Array3d squares = Eigen::Array3d::Zero();
  for (std::uint64_t i = 0; i < kParts; ++i) {
    const BrdfChange v = draw_part(scene, 1, i).variation;
    const Eigen::Array3d off(v.albedo - 1, v.gloss - 1, v.roughness - 1);
    sum += off / kParts;
    squares += off.square() / kParts;
    CHECK(v.hue_deg == 0);
  }
  const Eigen::Array3d sigma(0.02, 0.05, 0.1);
  CHECK((sum.abs() < 4.5 * sigma / std::sqrt(kParts)).all());
  CHECK(((squares.sqrt() / sigma - 1).abs() < 4.5 / std::sqrt(2.0 * kParts)).all());
}

TEST_CASE("a draw is a function of seed and index, each figure in its own place") {
  Scene scene;
  scene.jitter.shift_mm = {1, 1};
  scene.variation.albedo = 0.1;
  const PartDraw a = draw_part(scene, 5, 7);
  CHECK(a.pose.shift_mm == draw_part(scene, 5, 7).pose.shift_mm);
  CHECK(a.pose.shift_mm != draw_part(scene, 5, 8).pose.shift_mm);
  CHECK(a.pose.shift_mm != draw_part(scene, 6, 7).pose.shift_mm);
  scene.jitter.tilt_deg = {1, 1};
  scene.variation.gloss = 0.1;
  const PartDraw b = draw_part(scene, 5, 7);
  CHECK(b.pose.shift_mm == a.pose.shift_mm);
  CHECK(b.variation.albedo == a.variation.albedo);
}

TEST_CASE("the pose turns about z first, then tilts by Ry Rx about the part's centre") {
  ScenePose pose;
  pose.shift_mm = {1, 2};
  pose.height_mm = 3;
  pose.rotation_deg = 90;
  pose.tilt_deg = {10, 20};
  const Eigen::Isometry3d X_WP = part_pose(pose);
  const double a = 10 * pi / 180;
  const double b = 20 * pi / 180;
  CHECK((X_WP.translation() - Eigen::Vector3d(1, 2, 3) * 1e-3).norm() < 1e-12);
  const Eigen::Vector3d normal(std::cos(a) * std::sin(b), -std::sin(a), std::cos(a) * std::cos(b));
  CHECK((X_WP.linear().col(2) - normal).norm() < 1e-12);
  // The part's x lies along Ry Rx e_y.
  const Eigen::Vector3d x(std::sin(a) * std::sin(b), std::cos(a), std::sin(a) * std::cos(b));
  CHECK((X_WP.linear().col(0) - x).norm() < 1e-12);
}

TEST_CASE("changes act on the named material only and join the variation") {
  Scene scene = part_of({lambert_material("body", 0.5), lambert_material("print", 0.5)});
  scene.regions = (cv::Mat_<std::uint8_t>(1, 2) << 0, 1);
  scene.changes = {{"print", {.albedo = 0.8}}, {"print", {.albedo = 0.5}}};
  BrdfChange variation;
  variation.albedo = 1.1;
  const PartSurface surface(scene, variation);
  CHECK(red(surface, mm(-20, 0)) == Approx(1.1 * 0.5 / pi));
  CHECK(red(surface, mm(20, 0)) == Approx(1.1 * 0.4 * 0.5 / pi));
}

TEST_CASE("a stain darkens the diffuse part inside its disc") {
  const PartSurface clean(plastic_part(), {});
  const PartSurface stained = with_defect(DefectKind::stain, 4, 0.6);
  const Rgb difference = clean.f(mm(10, -5), kAtPeak) - stained.f(mm(10, -5), kAtPeak);
  CHECK(difference[0] == Approx(0.6 * 0.3 / pi));
  CHECK(difference[2] == Approx(0.6 * 0.1 / pi));
  CHECK(red(stained, mm(10, -6.8)) == Approx(red(stained, mm(10, -5))));
  CHECK(red(stained, mm(10, -7.2)) == red(clean, mm(10, -7.2)));
  CHECK(red(stained, mm(-10, 5)) == red(clean, mm(-10, 5)));
}

TEST_CASE("a dull spot widens the lobe by its strength and leaves the diffuse part") {
  const PartSurface dull = with_defect(DefectKind::dull, 4, 0.5);
  const BrdfPtr wider = changed(make_brdf(kPlastic), {.roughness = 1.5});
  for (const HalfDiff& angles : {kAtPeak, kOnFlank}) {
    CHECK(red(dull, mm(10, -5), angles) == Approx(wider->eval(angles)[0]));
    CHECK(red(dull, mm(13, -5), angles) == Approx(make_brdf(kPlastic)->eval(angles)[0]));
  }
}

TEST_CASE("a scratch doubles the roughness along a line parallel to x") {
  const PartSurface scratched = with_defect(DefectKind::scratch, 12, 0.5);
  const double rough = changed(make_brdf(kPlastic), {.roughness = 2})->eval(kAtPeak)[0];
  const double plain = make_brdf(kPlastic)->eval(kAtPeak)[0];
  CHECK(red(scratched, mm(10, -5), kAtPeak) == Approx(rough));
  CHECK(red(scratched, mm(15.5, -5), kAtPeak) == Approx(rough));
  CHECK(red(scratched, mm(4.5, -5), kAtPeak) == Approx(rough));
  CHECK(red(scratched, mm(16.5, -5), kAtPeak) == Approx(plain));
  CHECK(red(scratched, mm(10, -4.6), kAtPeak) == Approx(plain));
  // Half-way at half of 0.3 mm.
  CHECK(red(scratched, mm(10, -4.85), kAtPeak) == Approx((rough + plain) / 2));
}

TEST_CASE("dust is a grey Lambertian speck") {
  const PartSurface dusty = with_defect(DefectKind::dust, 1, 0.5);
  CHECK(dusty.f(mm(10, -5), kAtPeak).isApprox(Rgb::Constant(0.3 / pi)));
  CHECK(red(dusty, mm(11, -5)) == Approx(make_brdf(kPlastic)->eval(kOnFlank)[0]));
}

TEST_CASE("stain and dust show in the ambient light, a dull spot does not") {
  Scene scene = part_of({lambert_material("body", 0.6)});
  scene.defects = {{.kind = DefectKind::stain, .at_mm = {-10, 0}, .size_mm = 4, .strength = 0.5},
                   {.kind = DefectKind::dust, .at_mm = {0, 0}, .size_mm = 4, .strength = 0.5},
                   {.kind = DefectKind::dull, .at_mm = {10, 0}, .size_mm = 4, .strength = 0.5}};
  PartSurface surface(scene, {});
  surface.prepare_ambient(0.9);
  CHECK(surface.ambient_reflectance(mm(-10, 0))[0] == Approx(0.3).epsilon(0.003));
  CHECK(surface.ambient_reflectance(mm(0, 0))[0] == Approx(0.3).epsilon(0.003));
  CHECK(surface.ambient_reflectance(mm(10, 0))[0] == Approx(0.6).epsilon(0.003));
}

TEST_CASE("the back is one Lambertian without regions or defects") {
  Scene scene = plastic_part();
  scene.face_front = false;
  scene.back_albedo = {0.1, 0.2, 0.3};
  scene.regions = cv::Mat(4, 4, CV_8UC1, cv::Scalar(0));
  scene.defects = {{.kind = DefectKind::dust, .at_mm = {0, 0}, .size_mm = 5}};
  const PartSurface surface(scene, {});
  CHECK(surface.f(mm(0, 0), kAtPeak).isApprox(Rgb(0.1, 0.2, 0.3) / pi));
}

TEST_CASE("a part ends at its edges, a target does not") {
  Scene scene = plastic_part();
  scene.part_size_mm = {80, 40};
  const PartSurface part(scene, {});
  CHECK(part.covers(mm(39.9, 19.9)));
  CHECK_FALSE(part.covers(mm(40.1, 0)));
  CHECK_FALSE(part.covers(mm(0, -20.1)));
  CHECK(PartSurface(scene_of(SceneTarget::white), {}).covers(mm(500, 500)));
  scene.present = false;
  CHECK_FALSE(PartSurface(scene, {}).covers(mm(0, 0)));
}

TEST_CASE("an unusable scene is refused by the name of what is wrong") {
  Scene scene = plastic_part();
  CHECK(refusal(scene) == "(no error)");
  SECTION("change of an unknown material") {
    scene.changes = {{"bdy", {.albedo = 0.9}}};
    CHECK(contains(refusal(scene), "scene.change[0].material"));
    CHECK(contains(refusal(scene), "'bdy'"));
  }
  SECTION("unphysical change") {
    scene.changes = {{"body", {.roughness = 0}}};
    CHECK(contains(refusal(scene), "scene.change[0]"));
  }
  SECTION("no materials") {
    scene.materials.clear();
    CHECK(contains(refusal(scene), "scene.materials"));
  }
  SECTION("mask beyond the materials") {
    scene.regions = cv::Mat(2, 2, CV_8UC1, cv::Scalar(1));
    CHECK(contains(refusal(scene), "scene.regions: holds index 1"));
  }
  SECTION("mask of another type") {
    scene.regions = cv::Mat(2, 2, CV_16UC1, cv::Scalar(0));
    CHECK(contains(refusal(scene), "scene.regions"));
  }
  SECTION("part without a size") {
    scene.part_size_mm = {80, 0};
    CHECK(contains(refusal(scene), "scene.part.size_mm"));
  }
  SECTION("defect without a size") {
    scene.defects = {{.kind = DefectKind::stain, .at_mm = {0, 0}, .size_mm = 0}};
    CHECK(contains(refusal(scene), "scene.defects[0].size_mm"));
  }
  SECTION("defect of a foreign strength") {
    scene.defects = {{.kind = DefectKind::stain, .at_mm = {0, 0}, .size_mm = 1, .strength = 1.5}};
    CHECK(contains(refusal(scene), "scene.defects[0].strength"));
  }
}
