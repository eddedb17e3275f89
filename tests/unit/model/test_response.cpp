#include <cmath>
#include <random>

#include "catch.hpp"
#include "model/response.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;

namespace {

/// An 8-bit camera with a gamma per colour and a pedestal.
struct GammaCamera {
  SensorFormat sensor{128, 96, 8, Mosaic::gbrg, 6, 250};
  std::array<double, 3> gamma{1.8, 2.2, 2.6};
  static constexpr double kNoise = 0.6;  // counts

  int channel(int row, int column) const {
    if (sensor.mosaic == Mosaic::mono) return 0;
    constexpr std::array<int, 4> kGbrg{1, 2, 0, 1};
    return kGbrg[static_cast<std::size_t>(2 * (row % 2) + column % 2)];
  }
  RawFrame shoot(const cv::Mat3f& radiance, double exposure_s, std::mt19937& random) const {
    std::normal_distribution<double> normal(0, kNoise);
    RawFrame frame;
    frame.light = 1;
    frame.exposure_s = exposure_s;
    frame.counts.create(sensor.height, sensor.width, CV_16UC1);
    const double range = sensor.full_well_dn - sensor.black_level_dn;
    const int side = sensor.mosaic == Mosaic::mono ? 1 : 2;
    for (int y = 0; y < sensor.height; ++y) {
      for (int x = 0; x < sensor.width; ++x) {
        const int c = channel(y, x);
        const double share = radiance(y / side, x / side)[c] * exposure_s / range;
        const double bent =
            range * std::pow(std::min(share, 1.0), 1 / gamma[static_cast<std::size_t>(c)]);
        frame.counts.at<std::uint16_t>(y, x) = cv::saturate_cast<std::uint16_t>(
            std::clamp(sensor.black_level_dn + bent + normal(random), 0.0, sensor.full_well_dn));
      }
    }
    return frame;
  }
  Capture shoot(const cv::Mat3f& radiance, const std::vector<double>& times, unsigned seed) const {
    std::mt19937 random(seed);
    Capture capture{sensor, {}};
    for (const double t : times)
      capture.frames.push_back(shoot(radiance, t, random));
    return capture;
  }
  /// A white that falls off to one side, of one colour cast.
  cv::Mat3f white(double level) const {
    cv::Mat3f radiance(sensor.height, sensor.width);
    for (int y = 0; y < radiance.rows; ++y) {
      for (int x = 0; x < radiance.cols; ++x) {
        const auto v = static_cast<float>(level * (1.2 - 0.4 * x / radiance.cols));
        radiance(y, x) = {v, 0.9F * v, 0.7F * v};
      }
    }
    return radiance;
  }
};

std::vector<double> sweep_times() {
  std::vector<double> times;
  for (double t = 1e-4; t < 0.3; t *= 1.6)
    times.push_back(t);
  return times;
}

const Response& response_of(const GammaCamera& camera) {
  static const Response found =
      recover_response({camera.shoot(camera.white(3000), sweep_times(), 3)});
  return found;
}

}  // namespace

TEST_CASE("a mosaic camera's three tone curves come back from a sweep of a white plate") {
  const GammaCamera camera;
  const Response& found = response_of(camera);
  REQUIRE(found.size() == 3);
  for (std::size_t c = 0; c < 3; ++c) {
    CHECK(found[c].least >= 10);
    CHECK(found[c].most <= 246);
    for (int z = 30; z <= 225; z += 15) {
      INFO("channel " << c << " count " << z);
      const double expected = camera.gamma[c] * std::log((z - 6.0) / (200 - 6.0));
      CHECK(found[c].log_x[static_cast<std::size_t>(z)] - found[c].log_x[200] ==
            Approx(expected).margin(0.05));
    }
  }
}

TEST_CASE("two radiances' ratio comes out of a toned bracket whatever the counts") {
  const GammaCamera camera;
  const Response& response = response_of(camera);
  const std::vector<double> times{0.002, 0.02, 0.2};
  const double factor = GENERATE(0.004, 0.05, 0.3, 2.5);
  const Radiance a =
      merge_bracket(camera.sensor, response, camera.shoot(camera.white(8000), times, 4).frames);
  const Radiance b = merge_bracket(camera.sensor, response,
                                   camera.shoot(camera.white(8000 * factor), times, 5).frames);
  REQUIRE(a.value.type() == CV_32FC3);
  REQUIRE(a.value.size() == camera.sensor.cells());
  for (int c = 0; c < 3; ++c) {
    double sum = 0;
    int n = 0;
    for (int y = 0; y < a.value.rows; ++y) {
      for (int x = 0; x < a.value.cols; ++x) {
        if ((a.mask.at<std::uint8_t>(y, x) | b.mask.at<std::uint8_t>(y, x)) != 0) continue;
        sum += b.value.at<cv::Vec3f>(y, x)[c] / a.value.at<cv::Vec3f>(y, x)[c];
        ++n;
      }
    }
    INFO("channel " << c << " of " << n << " cells");
    REQUIRE(n > 2000);
    // The curve's errors add up over the decades between the two.
    CHECK(sum / n == Approx(factor).epsilon(factor < 0.01 ? 0.06 : 0.04));
  }
}

TEST_CASE("a toned cell is masked by its worst channel and never NaN") {
  const GammaCamera camera;
  Capture bracket = camera.shoot(camera.white(8000), {0.002, 0.02}, 6);
  for (RawFrame& frame : bracket.frames) {
    frame.counts.at<std::uint16_t>(4, 6) = 250;  // green of cell (3, 2)
    frame.counts.at<std::uint16_t>(8, 13) = 0;   // blue of cell (6, 4)
  }
  const Radiance r = merge_bracket(camera.sensor, response_of(camera), bracket.frames);
  CHECK(r.mask.at<std::uint8_t>(2, 3) == kClipped);
  CHECK(r.mask.at<std::uint8_t>(4, 6) == kNoiseFloor);
  CHECK(cv::countNonZero(r.mask) == 2);
  CHECK(cv::checkRange(r.value));
  CHECK(cv::checkRange(r.variance));
}

TEST_CASE("a response of another sensor and a sweep that is none are refused") {
  const GammaCamera camera;
  using Catch::Contains;
  SensorFormat other = camera.sensor;
  other.bits = 10;
  const auto frames = camera.shoot(camera.white(8000), {0.01}, 7).frames;
  CHECK_THAT(test::input_error([&] { return merge_bracket(other, response_of(camera), frames); }),
             Contains("a response of another sensor"));
  CHECK_THAT(
      test::input_error([&] { return merge_bracket(camera.sensor, response_of(camera), {}); }),
      Contains("no frame"));
  CHECK_THAT(test::input_error([&] { return recover_response({}); }), Contains("0 exposures"));
  CHECK_THAT(test::input_error([&] {
               return recover_response({camera.shoot(camera.white(8000), {0.01, 0.02}, 8)});
             }),
             Contains("2 exposures under one light"));
}
