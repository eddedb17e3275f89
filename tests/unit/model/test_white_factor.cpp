#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "model/reflectance.hpp"
#include "model/white_factor.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;

namespace {

/// A plate that is brighter toward the mirror direction, and a Lambertian part.
double true_factor(std::size_t light, double theta_h) {
  return light == 0 ? 1.08 - 0.3 * theta_h : 0.99;
}

struct Bench {
  Calibration calibration;
  RadianceSet part;

  Bench() {
    NominalRig rig;
    rig.lights = {{55, 180, 0.3}, {20, 0, 0.3}};
    calibration.sensor = {48, 36, 10, Mosaic::rggb, 60, 1023};
    calibration.geometry = make_geometry(rig, calibration.sensor);
    const CellGeometry cells = cell_geometry(calibration.geometry, calibration.sensor, {1, 1});
    for (std::size_t l = 0; l < 2; ++l) {
      const cv::Size size = calibration.sensor.cells();
      Radiance white{cv::Mat(size, CV_32FC3), cv::Mat(size, CV_32FC3, cv::Scalar::all(4)),
                     cv::Mat::zeros(size, CV_8UC1)};
      Radiance seen{white.value.clone(), white.variance.clone(), white.mask.clone()};
      for (int v = 0; v < size.height; ++v) {
        for (int u = 0; u < size.width; ++u) {
          const double light = 1000.0 + u + 10 * v;
          const double theta_h = cells.angles[l].at<cv::Vec3f>(v, u)[0];
          white.value.at<cv::Vec3f>(v, u) =
              cv::Vec3f::all(static_cast<float>(0.99 * light * true_factor(l, theta_h)));
          seen.value.at<cv::Vec3f>(v, u) = cv::Vec3f::all(static_cast<float>(0.4 * light));
        }
      }
      calibration.white.push_back(white);
      part.lights.push_back(seen);
    }
  }

  double worst_error() const {
    double worst = 0;
    for (const Reflectance& f : to_reflectance(part, calibration)) {
      for (const auto& value : cv::Mat_<cv::Vec3f>(f.value))
        worst = std::max(worst, std::abs(value[1] * std::numbers::pi / 0.4 - 1));
    }
    return worst;
  }
};

WhiteFactorTable table() {
  WhiteFactorTable t{"certificate 7", {{}, {}}, 0.004};
  for (const double theta_h : {0.0, 0.1, 0.6})
    t.lights[0].emplace_back(theta_h, true_factor(0, theta_h));
  t.lights[1] = {{0.3, 0.99}};
  return t;
}

}  // namespace

TEST_CASE("a plate's radiance factor is taken out, and the allowance with it") {
  Bench b;
  CHECK(b.calibration.white_sigma == kUnknownWhiteSigma);
  CHECK(b.worst_error() > 0.02);
  const cv::Mat before = b.calibration.white[0].value.clone();
  const cv::Mat variance = b.calibration.white[0].variance.clone();
  apply_white_factor(table(), b.calibration.geometry, b.calibration);
  CHECK(b.worst_error() < 1e-5);
  CHECK(b.calibration.white_sigma == 0.004);
  CHECK(b.calibration.white_factor == "certificate 7");
  // Relative noise stays what it was.
  const cv::Mat scale = b.calibration.white[0].value / before;
  CHECK(cv::norm(b.calibration.white[0].variance, scale.mul(scale).mul(variance), cv::NORM_INF) <
        1e-4);
  apply_white_factor(table(), b.calibration.geometry, b.calibration, true);
  CHECK(cv::norm(b.calibration.white[0].value, before, cv::NORM_INF) < 1e-2);
  CHECK(b.calibration.white_factor.empty());
  CHECK(b.calibration.white_sigma == kUnknownWhiteSigma);
}

TEST_CASE("a table is linear between its figures and held beyond them") {
  WhiteFactorTable t{"t", {{{0.1, 1.0}, {0.3, 1.2}}}, 0};
  CHECK(t.factor(0, 0.0) == 1.0);
  CHECK(t.factor(0, 0.1) == 1.0);
  CHECK(t.factor(0, 0.2) == Approx(1.1));
  CHECK(t.factor(0, 0.9) == 1.2);
}

TEST_CASE("a table that cannot be is refused") {
  Bench b;
  const auto refusal = [&](WhiteFactorTable t) {
    return test::input_error([&] { apply_white_factor(t, b.calibration.geometry, b.calibration); });
  };
  WhiteFactorTable t = table();
  t.lights.pop_back();
  CHECK_THAT(refusal(t), Catch::Contains("1 lights") && Catch::Contains("2 as calibrated"));
  t = table();
  t.lights[0][1].first = 0;
  CHECK_THAT(refusal(t), Catch::Contains("light 1") && Catch::Contains("does not rise"));
  t = table();
  t.lights[1][0].second = 0;
  CHECK_THAT(refusal(t), Catch::Contains("light 2") && Catch::Contains("not over 0"));
  t.lights[1].clear();
  CHECK_THAT(refusal(t), Catch::Contains("no figure"));
}
