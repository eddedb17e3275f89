#include <array>
#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "hal/sim/optics.hpp"
#include "support/sim_rig.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using Eigen::Vector2d;
using Eigen::Vector3d;
using std::numbers::pi;

namespace {

constexpr double kHalfWell = 5000;  // electrons
constexpr double kQuantum = 0.11;   // electrons: half a DN and the arithmetic of floats

/// Lambertian closed form in electrons, written from the camera's axes down: the plane through q
/// with normal n, seen through a pixel, relative to the origin of the untilted plane.
double lambert_electrons(const SimBenchSettings& s, const Vector2d& pixel, std::size_t light,
                         const Vector3d& n = Vector3d::UnitZ(), const Vector3d& q = {0, 0, 0}) {
  const double a = 55 * pi / 180;
  const Vector3d eye = 0.18 * Vector3d(std::sin(a), 0, std::cos(a));
  const Vector3d forward = -eye.normalized();
  const Vector3d right(0, 1, 0);
  const Vector2d offset = (pixel - s.geometry.camera.centre_px) / s.geometry.camera.focal_px;
  const Vector3d ray = forward + offset.x() * right + offset.y() * forward.cross(right);
  const Vector3d p = eye + ray * ((q - eye).dot(n) / ray.dot(n));
  const Vector3d l = s.geometry.lights_W[light];
  const Vector3d to = l - p;
  const double cos_i = to.normalized().dot(n);
  const double cos_e = to.normalized().dot(l.normalized());
  const double here = cos_i * cos_e / to.squaredNorm();
  const double centre = l.normalized().z() / l.squaredNorm();
  return kHalfWell * here / centre;
}

/// Normal of a part tilted about x, then y: R = Ry Rx applied to e_z, written out.
Vector3d tilted_normal(double x_deg, double y_deg) {
  const double a = x_deg * pi / 180;
  const double b = y_deg * pi / 180;
  return {std::cos(a) * std::sin(b), -std::sin(a), std::cos(a) * std::cos(b)};
}

/// Centre of mass of what is over half of the peak, as x, y in pixels.
Vector2d highlight(const RawFrame& frame) {
  double peak = 0;
  cv::minMaxLoc(frame.counts, nullptr, &peak);
  Vector2d sum = Vector2d::Zero();
  double mass = 0;
  for (int r = 0; r < frame.counts.rows; ++r) {
    for (int c = 0; c < frame.counts.cols; ++c) {
      const double z = frame.counts.at<std::uint16_t>(r, c) - kBlackDn;
      if (z < (peak - kBlackDn) / 2) continue;
      sum += z * Vector2d(c, r);
      mass += z;
    }
  }
  return sum / mass;
}

double total(const RawFrame& frame) {
  return cv::sum(frame.counts)[0] - kBlackDn * static_cast<double>(frame.counts.total());
}

}  // namespace

TEST_CASE(
    "white at the origin collects half of full well in the white exposure, under each light") {
  const SimBenchSettings s = precise_bench();
  const LightIndex light = GENERATE(1, 2);
  const RawFrame frame = take(s, scene_of(SceneTarget::white), light);
  CHECK(electrons(frame, 24, 32) == Approx(kHalfWell).margin(kQuantum));
}

TEST_CASE("a Lambertian plane follows the cosines and the inverse square at every pixel") {
  const SimBenchSettings s = precise_bench();
  const LightIndex light = GENERATE(1, 2);
  const RawFrame frame = take(s, scene_of(SceneTarget::white), light, kWhiteExposureS / 4);
  for (const auto& [x, y] : {std::array{0, 0}, {63, 0}, {5, 40}, {32, 24}, {50, 47}, {63, 47}}) {
    const double expected = lambert_electrons(s, Vector2d(x, y), light - 1) / 4;
    INFO("pixel " << x << ", " << y);
    CHECK(electrons(frame, y, x) == Approx(expected).margin(kQuantum));
  }
}

TEST_CASE("a tilted, raised plane follows the closed form with its own normal") {
  const SimBenchSettings s = precise_bench();
  Scene scene = scene_of(SceneTarget::white);
  scene.pose.tilt_deg = {4, -3};
  scene.pose.height_mm = 6;
  scene.pose.shift_mm = {3, -2};
  const RawFrame frame = take(s, scene, 2, kWhiteExposureS / 4);
  for (const auto& [x, y] : {std::array{0, 0}, {40, 10}, {10, 40}, {63, 47}}) {
    const double expected = lambert_electrons(s, Vector2d(x, y), 1, tilted_normal(4, -3),
                                              Vector3d(0.003, -0.002, 0.006)) /
                            4;
    CHECK(electrons(frame, y, x) == Approx(expected).margin(kQuantum));
  }
}

TEST_CASE("vignetting takes its share at the corner and a quarter of it half-way") {
  SimBenchSettings s = precise_bench();
  const RawFrame plain = take(s, scene_of(SceneTarget::white), 2, kWhiteExposureS / 4);
  s.vignetting = 0.2;
  const RawFrame frame = take(s, scene_of(SceneTarget::white), 2, kWhiteExposureS / 4);
  // The principal point (32, 24) is farthest from pixel (0, 0); (16, 12) is half-way.
  const auto ratio = [&](int row, int col) {
    return electrons(frame, row, col) / electrons(plain, row, col);
  };
  CHECK(ratio(24, 32) == Approx(1).margin(2e-4));
  CHECK(ratio(0, 0) == Approx(0.8).margin(4e-4));
  CHECK(ratio(12, 16) == Approx(0.95).margin(4e-4));
}

TEST_CASE("each mosaic shows its colour at its place in the cell") {
  struct Case {
    Mosaic mosaic;
    std::array<double, 4> albedo;  // row by row
  };
  const double r = 0.2;
  const double g = 0.5;
  const double b = 0.8;
  const auto [mosaic, albedo] =
      GENERATE_COPY(Case{Mosaic::rggb, {r, g, g, b}}, Case{Mosaic::bggr, {b, g, g, r}},
                    Case{Mosaic::grbg, {g, r, b, g}}, Case{Mosaic::gbrg, {g, b, r, g}},
                    Case{Mosaic::mono, {0.5, 0.5, 0.5, 0.5}});
  const SimBenchSettings s = precise_bench(64, 48, mosaic);
  const RawFrame frame = take(s, part_of({lambert_material("body", Rgb(r, g, b))}), 2);
  for (int row = 24; row < 26; ++row) {
    for (int col = 32; col < 34; ++col) {
      const double expected = lambert_electrons(s, Vector2d(col, row), 1) / 0.99 *
                              albedo[static_cast<std::size_t>(2 * (row % 2) + col % 2)];
      CHECK(electrons(frame, row, col) == Approx(expected).margin(kQuantum));
    }
  }
}

TEST_CASE("the highlight lies where the law of reflection puts it, also on a tilted part") {
  const SimBenchSettings s = precise_bench(256, 192);
  struct Case {
    std::array<double, 2> tilt_deg;
    double height_mm;
  };
  const auto [tilt_deg, height_mm] =
      GENERATE(Case{{0, 0}, 0}, Case{{1.5, 0}, 0}, Case{{-1.5, 0}, 0}, Case{{0, 1.5}, 0},
               Case{{0, -1.5}, 0}, Case{{1, -0.7}, 0}, Case{{0, 0}, 4});
  Scene scene = scene_of(SceneTarget::mirror);
  scene.pose.tilt_deg = tilt_deg;
  scene.pose.height_mm = height_mm;
  // The emitter's mirror image, seen through the plane.
  const Vector3d n = tilted_normal(tilt_deg[0], tilt_deg[1]);
  const Vector3d q(0, 0, height_mm * 1e-3);
  const Vector3d l = s.geometry.lights_W[0];
  const Vector3d image = l - 2 * n.dot(l - q) * n;
  const Vector2d expected = s.geometry.camera.project(image);

  const Vector2d seen = highlight(take(s, scene, 1, kWhiteExposureS / 400));
  INFO("tilt " << tilt_deg[0] << ", " << tilt_deg[1] << ", height " << height_mm);
  CHECK((seen - expected).norm() < 1.0);
}

TEST_CASE("a larger emitter lowers the highlight's peak and keeps its light") {
  SimBenchSettings s = precise_bench(128, 96);
  const RawFrame point = take(s, scene_of(SceneTarget::mirror), 1, kWhiteExposureS / 400);
  s.led_radius_m = 0.002;
  const RawFrame disc = take(s, scene_of(SceneTarget::mirror), 1, kWhiteExposureS / 400);
  double peak_point = 0;
  double peak_disc = 0;
  cv::minMaxLoc(point.counts, nullptr, &peak_point);
  cv::minMaxLoc(disc.counts, nullptr, &peak_disc);
  CHECK(peak_disc < 0.97 * peak_point);
  CHECK(total(disc) == Approx(total(point)).epsilon(0.005));

  SECTION("and does nothing to a Lambertian") {
    const Scene white = scene_of(SceneTarget::white);
    CHECK(total(take(s, white, 2)) ==
          Approx(total(take(precise_bench(128, 96), white, 2))).epsilon(1e-4));
  }
}

TEST_CASE("the fixture shows around a part, and everywhere without one") {
  SimBenchSettings s = precise_bench(64, 48, Mosaic::rggb);
  s.fixture_albedo = {0.1, 0.3, 0.6};
  Scene scene = part_of({lambert_material("body", 0.8)});
  scene.part_size_mm = {20, 30};
  const std::array<double, 3> per_unit{0.1 / 0.99, 0.3 / 0.99, 0.6 / 0.99};
  const auto fixture = [&](int row, int col) {
    const auto channel = static_cast<std::size_t>(colour_channel(Mosaic::rggb, row, col));
    return per_unit[channel] * lambert_electrons(s, Vector2d(col, row), 1);
  };
  SECTION("around") {
    const RawFrame frame = take(s, scene, 2);
    CHECK(electrons(frame, 24, 32) == Approx(kHalfWell * 0.8 / 0.99).margin(kQuantum));
    CHECK(electrons(frame, 24, 4) == Approx(fixture(24, 4)).margin(kQuantum));
    CHECK(electrons(frame, 5, 33) == Approx(fixture(5, 33)).margin(kQuantum));
  }
  SECTION("without") {
    scene.present = false;
    const RawFrame frame = take(s, scene, 2);
    for (const auto& [row, col] : {std::array{24, 32}, {24, 33}, {25, 33}}) {
      CHECK(electrons(frame, row, col) == Approx(fixture(row, col)).margin(kQuantum));
    }
  }
}

TEST_CASE("a part moves and turns as its pose says") {
  const SimBenchSettings s = precise_bench(128, 96);
  const double bright = kHalfWell * 0.4;  // the part's albedo is 0.8, the fixture's mean is 0.22
  Scene scene = part_of({lambert_material("body", 0.8)});
  const auto on_part = [&](double x_mm, double y_mm) {
    const RawFrame frame = take(s, scene, 2);
    return electrons_at(s, frame, Vector3d(x_mm, y_mm, 0) * 1e-3) > bright;
  };
  SECTION("shift along x") {
    scene.part_size_mm = {20, 20};
    scene.pose.shift_mm = {12, 0};
    CHECK(on_part(20, 0));
    CHECK_FALSE(on_part(-5, 0));
  }
  SECTION("shift along y") {
    scene.part_size_mm = {20, 20};
    scene.pose.shift_mm = {0, 12};
    CHECK(on_part(0, 20));
    CHECK_FALSE(on_part(0, -5));
  }
  SECTION("rotation is right-handed about z") {
    scene.part_size_mm = {60, 8};
    scene.pose.rotation_deg = 30;
    const double x = 22 * std::cos(pi / 6);
    const double y = 22 * std::sin(pi / 6);
    CHECK(on_part(x, y));
    CHECK(on_part(-x, -y));
    CHECK_FALSE(on_part(x, -y));
  }
}

TEST_CASE("the mask's first row lies at +y and its columns run along +x") {
  const SimBenchSettings s = precise_bench(128, 96);
  const std::array<double, 4> albedo{0.1, 0.3, 0.6, 0.9};
  Scene scene = part_of({});
  for (double a : albedo)
    scene.materials.push_back(lambert_material("m", a));
  scene.regions = (cv::Mat_<std::uint8_t>(2, 2) << 0, 1, 2, 3);
  const RawFrame frame = take(s, scene, 2, kWhiteExposureS / 2);
  struct Case {
    double x_mm, y_mm, albedo;
  };
  for (const Case& c : {Case{-15, 15, 0.1}, {15, 15, 0.3}, {-15, -15, 0.6}, {15, -15, 0.9}}) {
    const Vector3d p = Vector3d(c.x_mm, c.y_mm, 0) * 1e-3;
    const Vector2d pixel = s.geometry.camera.project(p).array().round();
    const double white = lambert_electrons(s, pixel, 1) / 2 / 0.99;
    CHECK(electrons_at(s, frame, p) == Approx(c.albedo * white).margin(kQuantum));
  }
}

TEST_CASE("the board shows its squares where it says") {
  const SimBenchSettings s = precise_bench(256, 192);
  const RawFrame frame = take(s, scene_of(SceneTarget::board), 2, kWhiteExposureS / 2);
  const auto reflectance = [&](double x_mm, double y_mm) {
    const Vector3d p = Vector3d(x_mm, y_mm, 0) * 1e-3;
    const Vector2d pixel = s.geometry.camera.project(p).array().round();
    return electrons_at(s, frame, p) / (lambert_electrons(s, pixel, 1) / 2) * 0.99;
  };
  const double square = sim_target::kBoardSquareM * 1e3;
  for (int i = 0; i < sim_target::kBoardSquaresX; ++i) {
    for (int j = 0; j < sim_target::kBoardSquaresY; ++j) {
      const double x = (i + 0.5 - sim_target::kBoardSquaresX / 2.0) * square;
      const double y = (j + 0.5 - sim_target::kBoardSquaresY / 2.0) * square;
      const bool black = (i + j) % 2 == 0;
      CHECK(reflectance(x, y) ==
            Approx(black ? sim_target::kBoardBlack : sim_target::kBoardWhite).margin(0.001));
    }
  }
  CHECK(reflectance(0, 33) == Approx(sim_target::kBoardWhite).margin(0.001));
}

TEST_CASE("the black target reflects half a percent") {
  const SimBenchSettings s = precise_bench();
  const RawFrame frame = take(s, scene_of(SceneTarget::black), 1, kWhiteExposureS);
  CHECK(electrons(frame, 24, 32) == Approx(kHalfWell * 0.005 / 0.99).margin(kQuantum));
}

TEST_CASE("ambient is a share of the white's signal, reflected by other materials as they do") {
  const SimBenchSettings s = precise_bench();
  Scene white = scene_of(SceneTarget::white);
  white.light.ambient = 0.05;
  CHECK(electrons(take(s, white, kNoLight), 24, 32) == Approx(0.05 * kHalfWell).margin(kQuantum));
  CHECK(electrons(take(s, white, kNoLight), 3, 60) == Approx(0.05 * kHalfWell).margin(kQuantum));
  CHECK(electrons(take(s, white, 2), 24, 32) == Approx(1.05 * kHalfWell).margin(kQuantum));

  Scene grey = part_of({lambert_material("body", 0.4)});
  grey.light.ambient = 0.05;
  const double expected = 0.05 * kHalfWell * 0.4 / 0.99;
  CHECK(electrons(take(s, grey, kNoLight), 24, 32) == Approx(expected).epsilon(0.003));

  SECTION("the fixture by its albedo") {
    grey.present = false;
    CHECK(electrons(take(s, grey, kNoLight), 24, 32) ==
          Approx(0.05 * kHalfWell * s.fixture_albedo.mean() / 0.99).margin(kQuantum));
  }
  SECTION("with lights off it stays") {
    white.lights_on = false;
    CHECK(electrons(take(s, white, 2), 24, 32) == Approx(0.05 * kHalfWell).margin(kQuantum));
  }
}

TEST_CASE("the hemisphere's integral returns an albedo and what a perfect conductor keeps") {
  for (const double theta_o : {0.0, 0.6, 55 * pi / 180}) {
    const auto lambert =
        hemispherical_reflectance(*make_brdf(LambertParameters{{0.2, 0.5, 0.8}}), theta_o);
    CHECK(lambert.diffuse[0] == Approx(0.2).epsilon(0.002));
    CHECK(lambert.diffuse[2] == Approx(0.8).epsilon(0.002));
    CHECK(lambert.specular.abs().maxCoeff() == 0);
    // A smooth lobe with f0 = 1 sends back everything but what masking hides.
    const auto mirror = hemispherical_reflectance(
        *make_brdf(GgxParameters{Rgb::Zero(), Rgb::Ones(), 0.05}), theta_o);
    CHECK(mirror.specular[1] == Approx(1).margin(0.01));
  }
}

TEST_CASE("defocus spreads light and neither loses nor mixes colours") {
  const Mosaic mosaic = GENERATE(Mosaic::mono, Mosaic::rggb);
  cv::Mat image = cv::Mat::zeros(48, 64, CV_32FC1);
  image.at<float>(20, 30) = 1000;  // red on rggb
  image.at<float>(0, 2) = 500;     // at the border
  defocus(image, mosaic, 1.6);
  CHECK(cv::sum(image)[0] == Approx(1500).epsilon(1e-5));
  double second = 0;
  double mass = 0;
  for (int r = 10; r < 31; ++r) {
    for (int c = 20; c < 41; ++c) {
      if (mosaic == Mosaic::rggb && (r % 2 != 0 || c % 2 != 0)) {
        CHECK(image.at<float>(r, c) == 0);
      }
      second += image.at<float>(r, c) * (c - 30) * (c - 30);
      mass += image.at<float>(r, c);
    }
  }
  CHECK(std::sqrt(second / mass) == Approx(1.6).epsilon(0.03));
}

TEST_CASE("defocus of a scene lowers the highlight and keeps its light") {
  const SimBenchSettings s = precise_bench(256, 192);
  Scene scene = scene_of(SceneTarget::mirror);
  const RawFrame sharp = take(s, scene, 1, kWhiteExposureS / 400);
  scene.sensor.defocus_px = 4;
  const RawFrame blurred = take(s, scene, 1, kWhiteExposureS / 400);
  double peak_sharp = 0;
  double peak_blurred = 0;
  cv::minMaxLoc(sharp.counts, nullptr, &peak_sharp);
  cv::minMaxLoc(blurred.counts, nullptr, &peak_blurred);
  CHECK(peak_blurred < 0.9 * peak_sharp);
  CHECK(total(blurred) == Approx(total(sharp)).epsilon(0.002));
}
