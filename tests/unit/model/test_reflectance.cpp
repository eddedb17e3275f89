#include <cmath>
#include <numbers>
#include <random>

#include "catch.hpp"
#include "model/reflectance.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;

namespace {

constexpr double kPi = std::numbers::pi;

SensorFormat small_sensor(Mosaic mosaic) {
  return {48, 36, 10, mosaic, 60, 1023};
}

/// What a Lambertian plane at z = height sends into every cell, light by light: rho / pi E with
/// E = I cos / d^2 from each point's own geometry, colour c weighed by 1 + c.
std::vector<Radiance> lambertian(const StationGeometry& geometry, const SensorFormat& sensor,
                                 double albedo, double height_m) {
  std::vector<Radiance> out;
  const cv::Size size = sensor.cells();
  const int channels = sensor.channels();
  const double centre = sensor.mosaic == Mosaic::mono ? 0 : 0.5;
  const int side = sensor.mosaic == Mosaic::mono ? 1 : 2;
  for (const Eigen::Vector3d& light : geometry.lights_W) {
    Radiance r;
    r.value.create(size, CV_32FC(channels));
    r.variance = cv::Mat(size, CV_32FC(channels), cv::Scalar::all(1));
    r.mask = cv::Mat::zeros(size, CV_8UC1);
    for (int v = 0; v < size.height; ++v) {
      for (int u = 0; u < size.width; ++u) {
        const Eigen::Vector3d ray = geometry.camera.ray_W({side * u + centre, side * v + centre});
        const Eigen::Vector3d eye = geometry.camera.position();
        const Eigen::Vector3d p = eye + (height_m - eye.z()) / ray.z() * ray;
        const Eigen::Vector3d d = light - p;
        const double cos_i = d.normalized().z();
        for (int c = 0; c < channels; ++c) {
          r.value.ptr<float>(v)[u * channels + c] =
              static_cast<float>(1000 * (1 + c) * albedo / kPi * cos_i / d.squaredNorm());
        }
      }
    }
    out.push_back(r);
  }
  return out;
}

struct Bench {
  Calibration calibration;
  RadianceSet part;
};

Bench bench_of(Mosaic mosaic, double albedo, double height_m) {
  NominalRig rig;
  rig.lights = {{55, 180, 0.3}, {20, 0, 0.3}};
  Bench b;
  b.calibration.sensor = small_sensor(mosaic);
  b.calibration.geometry = make_geometry(rig, b.calibration.sensor);
  b.calibration.white_reflectance = {0.99, 0.98, 0.97};
  // Reference: each channel's own certified reflectance.
  b.calibration.white = lambertian(b.calibration.geometry, b.calibration.sensor, 1, 0);
  const cv::Scalar rho(0.99, 0.98, 0.97);
  for (Radiance& w : b.calibration.white)
    cv::multiply(w.value, rho, w.value);
  b.part.lights = lambertian(b.calibration.geometry, b.calibration.sensor, albedo, height_m);
  return b;
}

/// Largest relative error of every value against albedo / pi.
double worst_error(const std::vector<Reflectance>& f, double albedo) {
  double worst = 0;
  for (const Reflectance& r : f) {
    for (int v = 0; v < r.value.rows; ++v) {
      for (int i = 0; i < r.value.cols * r.value.channels(); ++i)
        worst = std::max(worst, std::abs(r.value.ptr<float>(v)[i] / (albedo / kPi) - 1));
    }
  }
  return worst;
}

}  // namespace

TEST_CASE("a Lambertian part returns its albedo over pi, whatever its height") {
  const auto mosaic = GENERATE(Mosaic::mono, Mosaic::rggb);
  const double height = GENERATE(0.0, 0.002, -0.002, 0.01);
  const double albedo = GENERATE(0.003, 0.5);
  const Bench b = bench_of(mosaic, albedo, height);
  const auto f = to_reflectance(b.part, b.calibration, height);
  REQUIRE(f.size() == 2);
  REQUIRE(f[0].value.channels() == b.calibration.sensor.channels());
  CHECK(worst_error(f, albedo) < 2e-6);
  CHECK(cv::countNonZero(f[0].mask) == 0);
}

TEST_CASE("two millimetres of height not told cost a percent and more") {
  const Bench b = bench_of(Mosaic::mono, 0.5, 0.002);
  CHECK(worst_error(to_reflectance(b.part, b.calibration), 0.5) > 0.01);
}

TEST_CASE("the white reference measures itself") {
  const Bench b = bench_of(Mosaic::rggb, 0.5, 0);
  RadianceSet white;
  white.lights = b.calibration.white;
  const auto f = to_reflectance(white, b.calibration);
  const auto x = f[1].value.at<cv::Vec3f>(3, 7);
  CHECK(x[0] == Approx(0.99 / kPi));
  CHECK(x[1] == Approx(0.98 / kPi));
  CHECK(x[2] == Approx(0.97 / kPi));
}

TEST_CASE("the variance of f is that of repeated measurements") {
  Bench b = bench_of(Mosaic::mono, 0.5, 0);
  std::mt19937 random(3);
  std::normal_distribution<float> normal;
  const auto part = b.part;
  const auto white = b.calibration.white;
  const float part_sigma = 80, white_sigma = 130;
  double sum = 0;
  constexpr int kRepeats = 40;
  for (int i = 0; i < kRepeats; ++i) {
    for (std::size_t l = 0; l < 2; ++l) {
      const auto disturb = [&](const Radiance& from, float sigma) {
        Radiance r{from.value.clone(), from.variance.clone(), from.mask};
        for (auto it = r.value.begin<float>(); it != r.value.end<float>(); ++it)
          *it += sigma * normal(random);
        r.variance.setTo(sigma * sigma);
        return r;
      };
      b.part.lights[l] = disturb(part.lights[l], part_sigma);
      b.calibration.white[l] = disturb(white[l], white_sigma);
    }
    const auto f = to_reflectance(b.part, b.calibration);
    cv::Mat squares = f[0].value - 0.5 / kPi;
    cv::multiply(squares, squares, squares);
    cv::divide(squares, f[0].variance, squares);
    sum += cv::mean(squares)[0];
  }
  CHECK(sum / kRepeats == Approx(1).epsilon(0.03));
}

TEST_CASE("a cell without a white reference is invalid, a masked part keeps its bits") {
  Bench b = bench_of(Mosaic::rggb, 0.5, 0);
  b.calibration.white[0].mask.at<unsigned char>(2, 3) = kNoiseFloor;
  b.calibration.white[0].value.at<cv::Vec3f>(4, 5)[1] = 0;
  b.part.lights[0].mask.at<unsigned char>(2, 3) = kClipped;
  b.part.lights[0].mask.at<unsigned char>(6, 7) = kClipped;
  const auto f = to_reflectance(b.part, b.calibration);
  CHECK(f[0].mask.at<unsigned char>(2, 3) == (kClipped | kInvalid));
  CHECK(f[0].mask.at<unsigned char>(4, 5) == kInvalid);
  CHECK(f[0].value.at<cv::Vec3f>(4, 5) == cv::Vec3f(0, 0, 0));
  CHECK(f[0].mask.at<unsigned char>(6, 7) == kClipped);
  CHECK(f[0].value.at<cv::Vec3f>(6, 7)[0] > 0);
  CHECK(cv::countNonZero(f[0].mask) == 3);
  CHECK(cv::countNonZero(f[1].mask) == 0);
}

TEST_CASE("a part above the lights is invalid, not infinite") {
  const Bench b = bench_of(Mosaic::mono, 0.5, 0);
  const auto f = to_reflectance(b.part, b.calibration, 0.5);
  CHECK(cv::countNonZero(f[0].mask == kInvalid) == 48 * 36);
  CHECK(cv::checkRange(f[0].value));
}

TEST_CASE("a capture that does not fit the calibration is refused") {
  Bench b = bench_of(Mosaic::mono, 0.5, 0);
  SECTION("lights") {
    b.part.lights.pop_back();
    CHECK(test::contains(test::input_error([&] { return to_reflectance(b.part, b.calibration); }),
                         "1 lights; expected 2"));
  }
  SECTION("channels") {
    b.part = bench_of(Mosaic::rggb, 0.5, 0).part;
    CHECK(test::contains(test::input_error([&] { return to_reflectance(b.part, b.calibration); }),
                         "light 1: 24 x 18 cells of 3 channels; expected 48 x 36 cells of 1"));
  }
}

TEST_CASE("ambient light is a share of the white reference under light 2") {
  const auto mosaic = GENERATE(Mosaic::mono, Mosaic::rggb);
  Bench b = bench_of(mosaic, 0.5, 0);
  const cv::Size size = b.calibration.sensor.cells();
  Radiance ambient = b.calibration.white[1];
  ambient.value = ambient.value.clone();  // not the reference's own pixels
  ambient.value *= 0.03;
  cv::Mat inside(size, CV_8UC1, cv::Scalar(255));
  const Eigen::Array3d white =
      Eigen::Map<const Eigen::Array3d>(b.calibration.white_reflectance.data());
  CHECK(ambient_share(ambient, b.calibration, inside, white) == Approx(0.03));

  SECTION("a darker surface under the same light shows the same share") {
    ambient.value *= 0.25;
    CHECK(ambient_share(ambient, b.calibration, inside, 0.25 * white) == Approx(0.03));
  }
  SECTION("a reflectance of nothing is an error") {
    CHECK(test::contains(test::input_error([&] {
                           return ambient_share(ambient, b.calibration, inside,
                                                Eigen::Array3d::Zero());
                         }),
                         "not positive"));
  }
  SECTION("a bright spot does not move the median") {
    ambient.value(cv::Rect(0, 0, 5, 5)).setTo(cv::Scalar::all(1e9));
    CHECK(ambient_share(ambient, b.calibration, inside, white) == Approx(0.03));
  }
  SECTION("what lies outside does not count") {
    inside.colRange(0, size.width - 4).setTo(0);
    ambient.value.colRange(0, size.width - 4).setTo(cv::Scalar::all(1e9));
    CHECK(ambient_share(ambient, b.calibration, inside, white) == Approx(0.03));
  }
  SECTION("nothing inside is an error") {
    inside.setTo(0);
    CHECK(test::contains(
        test::input_error([&] { return ambient_share(ambient, b.calibration, inside, white); }),
        "no cell with a white reference"));
  }
}
