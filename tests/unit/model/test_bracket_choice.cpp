#include <cmath>

#include "catch.hpp"
#include "model/bracket_choice.hpp"
#include "support/input_error.hpp"
#include "support/photons.hpp"

using namespace brdfgate;
using test::BenchSensor;

namespace {

const std::vector<double> kLadder = exposure_ladder(30e-6, 0.2, 3);  // 9 candidates

/// Cells from `least` to `most` DN/s, evenly in the logarithm, grey.
Radiance ramp(double least, double most, int channels = 3) {
  Radiance r;
  r.value.create(20, 100, CV_32FC(channels));
  r.mask = cv::Mat::zeros(r.value.size(), CV_8UC1);
  for (int v = 0; v < 20; ++v) {
    for (int u = 0; u < 100; ++u) {
      const auto x = static_cast<float>(least * std::pow(most / least, (20 * u + v) / 1999.0));
      for (int c = 0; c < channels; ++c)
        r.value.ptr<float>(v)[u * channels + c] = x;
    }
  }
  return r;
}

BracketChoice choose(const Radiance& r, const BracketLimits& limits = {}) {
  const BenchSensor bench;
  return choose_bracket(bench.sensor, bench.noise, {{&r, nullptr}}, kLadder, limits);
}

/// Share of cells that the product's own merge masks, photons drawn.
double merged_masked(const Radiance& r, const std::vector<double>& exposures) {
  BenchSensor bench;
  bench.sensor.width = 2 * r.value.cols;
  bench.sensor.height = 2 * r.value.rows;
  cv::Mat mosaic(bench.sensor.height, bench.sensor.width, CV_32FC1);
  for (int y = 0; y < mosaic.rows; ++y) {
    for (int x = 0; x < mosaic.cols; ++x)
      mosaic.at<float>(y, x) = r.value.at<cv::Vec3f>(y / 2, x / 2)[0];
  }
  const Radiance merged =
      merge_bracket(bench.sensor, bench.noise, test::expose(bench, mosaic, exposures, 21));
  return cv::countNonZero(merged.mask) / static_cast<double>(merged.mask.total());
}

}  // namespace

TEST_CASE("a plain matt material needs one exposure") {
  const BracketChoice choice = choose(ramp(20e3, 60e3));
  CHECK(choice.exposures_s.size() == 1);
  CHECK(choice.masked < 0.001);
}

TEST_CASE("what is chosen leaves as little masked in the product's own merge") {
  struct Case {
    double least, most;
  };
  const auto c = GENERATE(Case{2e3, 60e3}, Case{300, 3e6}, Case{20, 2e7});
  BracketLimits limits;
  limits.least_snr = 5;
  const Radiance r = ramp(c.least, c.most);
  const BracketChoice choice = choose(r, limits);
  INFO(choice.exposures_s.size() << " exposures");
  CHECK(choice.masked < 0.001);
  CHECK(merged_masked(r, choice.exposures_s) < 0.002);
  // No exposure is idle: without any one of them more is masked than allowed, or it was not chosen.
  for (std::size_t leave = 0; leave < choice.exposures_s.size(); ++leave) {
    std::vector<double> fewer = choice.exposures_s;
    fewer.erase(fewer.begin() + static_cast<std::ptrdiff_t>(leave));
    if (fewer.empty()) continue;
    const BenchSensor bench;
    CHECK_THROWS_AS(choose_bracket(bench.sensor, bench.noise, {{&r, nullptr}}, fewer, limits),
                    InputError);
  }
}

TEST_CASE("more range takes more exposures, never fewer") {
  std::size_t before = 0;
  BracketLimits limits;
  limits.least_snr = 10;
  for (const double most : {3e4, 3e5, 3e6, 2e7}) {
    const std::size_t now = choose(ramp(1000, most), limits).exposures_s.size();
    CHECK(now >= before);
    before = now;
  }
  CHECK(before >= 2);
}

TEST_CASE("the budget is kept, and where it cannot be, the refusal says what it would take") {
  const Radiance r = ramp(300, 3e6);
  BracketLimits limits;
  limits.least_snr = 5;
  const BracketChoice free = choose(r, limits);
  limits.budget_s = free.time_s;
  limits.readout_s = 0;
  CHECK(choose(r, limits).time_s <= limits.budget_s);
  limits.budget_s = free.time_s / 20;
  const std::string said = test::input_error([&] { return choose(r, limits); });
  CHECK_THAT(said, Catch::Contains("no bracket leaves under 0.1 % masked"));
  CHECK_THAT(said, Catch::Contains("a budget of"));
}

TEST_CASE("the weakest and the brightest channel decide a cell") {
  Radiance r = ramp(20e3, 60e3);
  for (int v = 0; v < r.value.rows; ++v) {
    for (int u = 0; u < r.value.cols; ++u)
      r.value.at<cv::Vec3f>(v, u)[2] = 3e6F;  // blue glares
  }
  const BracketChoice choice = choose(r);
  CHECK(choice.exposures_s.front() * 3e6 < 963);
}

TEST_CASE("cells outside the mask do not count") {
  Radiance r = ramp(20e3, 60e3);
  r.value.rowRange(0, 10).setTo(cv::Scalar::all(1e12));
  cv::Mat cells = cv::Mat::zeros(r.value.size(), CV_8UC1);
  cells.rowRange(10, 20).setTo(255);
  const BenchSensor bench;
  const BracketChoice choice =
      choose_bracket(bench.sensor, bench.noise, {{&r, &cells}}, kLadder, {});
  CHECK(choice.exposures_s.size() == 1);
}

TEST_CASE("candidates and cells that are none are refused") {
  const Radiance r = ramp(1, 2);
  const BenchSensor bench;
  const auto refusal = [&](const std::vector<double>& candidates) {
    return test::input_error(
        [&] { return choose_bracket(bench.sensor, bench.noise, {{&r, nullptr}}, candidates, {}); });
  };
  CHECK_THAT(refusal({}), Catch::Contains("0 candidate"));
  CHECK_THAT(refusal({0.01, -1}), Catch::Contains("over 0"));
  CHECK_THAT(refusal(std::vector<double>(17, 0.01)), Catch::Contains("17 candidate"));
  CHECK_THROWS_AS(choose_bracket(bench.sensor, bench.noise, {}, kLadder, {}), InputError);
  CHECK_THROWS_AS(exposure_ladder(0, 1, 2), InputError);
  CHECK_THROWS_AS(exposure_ladder(0.1, 1, 1), InputError);
}
