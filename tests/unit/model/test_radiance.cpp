#include <cmath>
#include <random>

#include "catch.hpp"
#include "model/radiance.hpp"
#include "support/input_error.hpp"
#include "support/merge_oracle.hpp"
#include "support/photons.hpp"

using namespace brdfgate;
using test::BenchSensor;

namespace {

const std::vector<double> kBracket{0.03e-3, 0.4e-3, 5e-3, 60e-3};

BenchSensor mono_sensor(int width, int height) {
  BenchSensor bench;
  bench.sensor.width = width;
  bench.sensor.height = height;
  bench.sensor.mosaic = Mosaic::mono;
  return bench;
}

cv::Mat flat(const SensorFormat& sensor, double radiance) {
  return cv::Mat(sensor.height, sensor.width, CV_32FC1, cv::Scalar(radiance));
}

RawFrame constant_frame(const SensorFormat& sensor, int count, double exposure_s,
                        LightIndex light = kNoLight) {
  RawFrame frame;
  frame.counts = cv::Mat(sensor.height, sensor.width, CV_16UC1, cv::Scalar(count));
  frame.exposure_s = exposure_s;
  frame.light = light;
  return frame;
}

/// Counts of every level with no regard to physics: saturated here and not there.
RawFrame random_frame(const SensorFormat& sensor, double exposure_s, double gain, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> counts(0, 1023);
  RawFrame frame = constant_frame(sensor, 0, exposure_s);
  frame.gain = gain;
  for (auto it = frame.counts.begin<std::uint16_t>(); it != frame.counts.end<std::uint16_t>(); ++it)
    *it = static_cast<std::uint16_t>(counts(random));
  return frame;
}

struct Statistics {
  double mean = 0, variance = 0, mean_stated_variance = 0;
};

Statistics statistics(const Radiance& r) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(r.value, mean, deviation);
  return {mean[0], deviation[0] * deviation[0], cv::mean(r.variance)[0]};
}

}  // namespace

TEST_CASE("the merge equals its definition, pixel by pixel") {
  struct Case {
    Mosaic mosaic;
    const char* pattern;
    int width, height;
  };
  const auto c = GENERATE(Case{Mosaic::mono, "m", 130, 9}, Case{Mosaic::mono, "m", 3, 3},
                          Case{Mosaic::rggb, "rggb", 128, 18}, Case{Mosaic::bggr, "bggr", 70, 20},
                          Case{Mosaic::grbg, "grbg", 66, 4}, Case{Mosaic::gbrg, "gbrg", 2, 2});
  const std::size_t exposures = GENERATE(1, 2, 5);
  BenchSensor bench;
  bench.sensor.width = c.width;
  bench.sensor.height = c.height;
  bench.sensor.mosaic = c.mosaic;
  std::vector<RawFrame> frames;
  for (std::size_t j = 0; j < exposures; ++j)
    frames.push_back(random_frame(bench.sensor, 1e-3 * std::pow(3.0, j), j == 1 ? 2.0 : 1.0,
                                  static_cast<unsigned>(j + 1)));
  const Radiance merged = merge_bracket(bench.sensor, bench.noise, frames);
  REQUIRE(merged.value.size() == bench.sensor.cells());
  const int channels = bench.sensor.channels();
  double worst_value = 0, worst_variance = 0;
  int wrong_masks = 0;
  for (int v = 0; v < merged.value.rows; ++v) {
    for (int u = 0; u < merged.value.cols; ++u) {
      const auto want = test::merge_cell_oracle(bench.sensor, bench.noise, frames, c.pattern, u, v);
      bool clipped = false, dark = false;
      for (int ch = 0; ch < channels; ++ch) {
        const auto& w = want[static_cast<std::size_t>(ch)];
        const double x = merged.value.ptr<float>(v)[u * channels + ch];
        const double s = merged.variance.ptr<float>(v)[u * channels + ch];
        worst_value = std::max(worst_value, std::abs(x - w.value) / std::sqrt(w.variance));
        worst_variance = std::max(worst_variance, std::abs(s / w.variance - 1));
        clipped |= w.clipped;
        dark |= w.value < std::sqrt(w.variance);
      }
      const int mask = (clipped ? kClipped : 0) | (dark ? kNoiseFloor : 0);
      wrong_masks += merged.mask.at<unsigned char>(v, u) != mask ? 1 : 0;
    }
  }
  CHECK(worst_value < 1e-4);  // in standard deviations
  CHECK(worst_variance < 1e-4);
  CHECK(wrong_masks == 0);
}

TEST_CASE("the merged radiance has no bias and the variance it states") {
  // From signal-to-noise ratio 6 in the longest exposure to 0.9 of full well in the shortest, dense
  // where the 60 ms exposure saturates (838 to 934 DN, 13970 to 15570 DN/s).
  const double x = GENERATE(80., 120., 400., 2000., 8000., 13900., 14500., 15000., 15567., 15800.,
                            16300., 100e3, 175e3, 186.8e3, 194e3, 1e6, 2.3e6, 8e6, 28.9e6);
  const BenchSensor bench = mono_sensor(512, 256);
  const auto frames = test::expose(bench, flat(bench.sensor, x), kBracket, 7);
  const Statistics s = statistics(merge_bracket(bench.sensor, bench.noise, frames));
  INFO("radiance " << x << " DN/s, signal-to-noise " << s.mean / std::sqrt(s.variance));
  CHECK(std::abs(s.mean / x - 1) < 0.002);
  CHECK(s.variance / s.mean_stated_variance == Approx(1).margin(0.05));
}

TEST_CASE("the faintest light has no bias where read noise dithers the converter") {
  // 0.3 DN of read noise does not: 0.3 DN of signal in 5 ms rounds toward black, and the merge is
  // 0.2 % low at signal-to-noise ratio 5. With 0.6 DN there is nothing left of that.
  const double x = GENERATE(60., 70., 80.);
  BenchSensor bench = mono_sensor(1024, 256);
  bench.noise.read_noise_dn = 0.6;
  const auto frames = test::expose(bench, flat(bench.sensor, x), kBracket, 7);
  const Statistics s = statistics(merge_bracket(bench.sensor, bench.noise, frames));
  INFO("radiance " << x << " DN/s, signal-to-noise " << s.mean / std::sqrt(s.variance));
  CHECK(std::abs(s.mean / x - 1) < 0.002);
  CHECK(s.variance / s.mean_stated_variance == Approx(1).margin(0.05));
}

TEST_CASE("quantisation alone costs less than 0.3 % at signal-to-noise ratio 5") {
  const BenchSensor bench = mono_sensor(1024, 256);
  const auto frames = test::expose(bench, flat(bench.sensor, 60), kBracket, 7);
  const Statistics s = statistics(merge_bracket(bench.sensor, bench.noise, frames));
  CHECK(std::abs(s.mean / 60 - 1) < 0.003);
}

TEST_CASE("a bracket tells more than its best exposure") {
  const BenchSensor bench = mono_sensor(256, 64);
  const auto frames = test::expose(bench, flat(bench.sensor, 40e3), {5e-3, 5e-3, 5e-3, 5e-3}, 3);
  const Statistics four = statistics(merge_bracket(bench.sensor, bench.noise, frames));
  const Statistics one = statistics(merge_bracket(bench.sensor, bench.noise, {frames[0]}));
  CHECK(one.variance / four.variance == Approx(4).epsilon(0.06));
  CHECK(one.mean_stated_variance / four.mean_stated_variance == Approx(4).epsilon(0.01));
}

TEST_CASE("the same scene has the same radiance at any known exposure and gain") {
  const BenchSensor bench = mono_sensor(256, 128);
  const double x = 50e3;
  std::mt19937 random(11);
  for (const double exposure : {2e-3, 4e-3, 8e-3}) {
    for (const double gain : {1.0, 2.0}) {
      const auto frame = test::expose_once(bench, flat(bench.sensor, x), exposure, random, gain);
      const Statistics s = statistics(merge_bracket(bench.sensor, bench.noise, {frame}));
      INFO(exposure << " s at gain " << gain);
      CHECK(s.mean == Approx(x).epsilon(0.002));
      CHECK(s.variance / s.mean_stated_variance == Approx(1).margin(0.05));
    }
  }
}

TEST_CASE("the order of the frames does not matter") {
  const BenchSensor bench = mono_sensor(100, 10);
  auto frames = test::expose(bench, flat(bench.sensor, 14e3), kBracket, 5);
  const Radiance a = merge_bracket(bench.sensor, bench.noise, frames);
  std::swap(frames[0], frames[3]);
  std::swap(frames[1], frames[2]);
  const Radiance b = merge_bracket(bench.sensor, bench.noise, frames);
  CHECK(cv::norm(a.value, b.value, cv::NORM_INF) == 0);
  CHECK(cv::norm(a.variance, b.variance, cv::NORM_INF) == 0);
}

TEST_CASE("threads do not change the result") {
  const BenchSensor bench = mono_sensor(200, 60);
  const auto frames = test::expose(bench, flat(bench.sensor, 14e3), kBracket, 5);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const Radiance a = merge_bracket(bench.sensor, bench.noise, frames);
  cv::setNumThreads(4);
  const Radiance b = merge_bracket(bench.sensor, bench.noise, frames);
  cv::setNumThreads(threads);
  CHECK(cv::norm(a.value, b.value, cv::NORM_INF) == 0);
}

TEST_CASE("a cell saturated in the shortest exposure is clipped and keeps the lower bound") {
  const BenchSensor bench = mono_sensor(64, 4);
  const Radiance r = merge_bracket(
      bench.sensor, bench.noise,
      {constant_frame(bench.sensor, 1023, 1e-3), constant_frame(bench.sensor, 1023, 0.1e-3)});
  CHECK(cv::countNonZero(r.mask == kClipped) == 64 * 4);
  CHECK(r.value.at<float>(0, 0) == Approx(963 / 0.1e-3));
  CHECK(r.variance.at<float>(0, 0) > 0);
}

TEST_CASE("one clipped channel clips its cell") {
  BenchSensor bench;
  bench.sensor.width = 8;
  bench.sensor.height = 8;
  const auto [x, y] = GENERATE(table<int, int>({{0, 0}, {1, 0}, {0, 1}, {1, 1}}));
  RawFrame frame = constant_frame(bench.sensor, 500, 1e-3);
  frame.counts.at<std::uint16_t>(2 + y, 4 + x) = 1023;
  const Radiance r = merge_bracket(bench.sensor, bench.noise, {frame});
  CHECK(r.mask.at<unsigned char>(1, 2) == kClipped);
  CHECK(cv::countNonZero(r.mask) == 1);
}

TEST_CASE("one dark channel puts its cell under the noise floor") {
  BenchSensor bench;
  bench.sensor.width = 8;
  bench.sensor.height = 8;
  const auto [x, y] = GENERATE(table<int, int>({{0, 0}, {1, 1}}));  // the greens are averaged
  RawFrame frame = constant_frame(bench.sensor, 500, 1e-3);
  frame.counts.at<std::uint16_t>(2 + y, 4 + x) = 60;
  const Radiance r = merge_bracket(bench.sensor, bench.noise, {frame});
  CHECK(r.mask.at<unsigned char>(1, 2) == kNoiseFloor);
  CHECK(cv::countNonZero(r.mask) == 1);
}

TEST_CASE("darkness is under the noise floor, the darkest ordinary material is not") {
  const BenchSensor bench = mono_sensor(256, 64);
  const auto share_masked = [&](double radiance) {
    const auto frames = test::expose(bench, flat(bench.sensor, radiance), kBracket, 21);
    const Radiance r = merge_bracket(bench.sensor, bench.noise, frames);
    return cv::countNonZero(r.mask) / static_cast<double>(r.mask.total());
  };
  // The default station: white (0.99) reaches half of 10,000 electrons in 8 ms.
  const double white = 5000 * bench.noise.gain_dn_per_e / 8e-3;
  CHECK(share_masked(0) > 0.8);
  CHECK(share_masked(white * 0.003 / 0.99) == 0);
  CHECK(share_masked(white * 0.003 / 0.99 / 2) == 0);  // where lights and lens fall off
}

TEST_CASE("no input of counts makes a merge that is not finite") {
  const BenchSensor bench = mono_sensor(64, 2);
  for (const int count : {0, 59, 60, 61, 1023, 65535}) {
    const Radiance r = merge_bracket(
        bench.sensor, bench.noise,
        {constant_frame(bench.sensor, count, 1e-3), constant_frame(bench.sensor, count, 1e-2)});
    CHECK(cv::checkRange(r.value));
    CHECK(cv::checkRange(r.variance, true, nullptr, 0, HUGE_VAL));
  }
}

TEST_CASE("ambient light is subtracted and its noise added") {
  const BenchSensor bench = mono_sensor(256, 128);
  const double lit = 30e3, ambient = 2e3;
  const auto a = merge_bracket(bench.sensor, bench.noise,
                               test::expose(bench, flat(bench.sensor, ambient), {5e-3, 60e-3}, 1));
  const auto b = merge_bracket(bench.sensor, bench.noise,
                               test::expose(bench, flat(bench.sensor, lit + ambient), kBracket, 2));
  const Statistics s = statistics(subtract_ambient(b, a));
  CHECK(s.mean == Approx(lit).epsilon(0.001));
  CHECK(s.variance / s.mean_stated_variance == Approx(1).margin(0.05));
}

TEST_CASE("a dark ambient frame masks nothing, a clipped one does") {
  const BenchSensor bench = mono_sensor(4, 1);
  const auto merge = [&](int count) {
    return merge_bracket(bench.sensor, bench.noise, {constant_frame(bench.sensor, count, 1e-2)});
  };
  CHECK(merge(60).mask.at<unsigned char>(0) == kNoiseFloor);
  CHECK(subtract_ambient(merge(500), merge(60)).mask.at<unsigned char>(0) == 0);
  CHECK(subtract_ambient(merge(60), merge(60)).mask.at<unsigned char>(0) == kNoiseFloor);
  CHECK(subtract_ambient(merge(500), merge(1023)).mask.at<unsigned char>(0) == kClipped);
}

TEST_CASE("a capture is split by light and the ambient taken off") {
  const BenchSensor bench = mono_sensor(8, 2);
  Capture capture{
      bench.sensor,
      {constant_frame(bench.sensor, 460, 1e-2, 2), constant_frame(bench.sensor, 80, 1e-2),
       constant_frame(bench.sensor, 260, 1e-2, 1)}};
  const RadianceSet set = to_radiance(capture, bench.noise, 2);
  REQUIRE(set.lights.size() == 2);
  CHECK(set.ambient.value.at<float>(0) == Approx(2000));
  CHECK(set.lights[0].value.at<float>(0) == Approx(18000));
  CHECK(set.lights[1].value.at<float>(0) == Approx(38000));

  SECTION("a missing light is named") {
    CHECK(test::contains(test::input_error([&] { return to_radiance(capture, bench.noise, 3); }),
                         "the bracket under light 3 is missing"));
  }
  SECTION("a light too many is named") {
    CHECK(test::contains(test::input_error([&] { return to_radiance(capture, bench.noise, 1); }),
                         "frame 0: light 2; expected none or 1 to 1"));
  }
  SECTION("a missing ambient frame is named") {
    capture.frames.erase(capture.frames.begin() + 1);
    CHECK(test::contains(test::input_error([&] { return to_radiance(capture, bench.noise, 2); }),
                         "the ambient frame is missing"));
  }
}

TEST_CASE("frames that are no bracket are refused") {
  const BenchSensor bench = mono_sensor(16, 4);
  std::vector<RawFrame> frames{constant_frame(bench.sensor, 100, 1e-3),
                               constant_frame(bench.sensor, 100, 1e-2)};
  const auto message = [&] {
    return test::input_error([&] { return merge_bracket(bench.sensor, bench.noise, frames); });
  };
  SECTION("none") {
    frames.clear();
    CHECK(test::contains(message(), "no frame"));
  }
  SECTION("another size") {
    frames[1].counts = cv::Mat(4, 15, CV_16UC1, cv::Scalar(0));
    CHECK(message() == "frame 1: 15 x 4 pixels; expected 16 x 4");
  }
  SECTION("another type") {
    frames[0].counts.convertTo(frames[0].counts, CV_8U);
    CHECK(test::contains(message(), "frame 0: counts of type CV_8UC1"));
  }
  SECTION("no exposure time") {
    frames[1].exposure_s = 0;
    CHECK(test::contains(message(), "frame 1: exposure"));
  }
  SECTION("no gain") {
    frames[1].gain = NAN;
    CHECK(test::contains(message(), "frame 1: analogue gain"));
  }
}
