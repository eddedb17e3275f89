#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "hal/sim/sensor.hpp"
#include "support/sim_rig.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

cv::Mat uniform_rate(double electrons_per_s, int side = 256) {
  return {side, side, CV_32FC1, cv::Scalar(electrons_per_s)};
}

struct Moments {
  double mean, variance;
};
Moments moments(const cv::Mat& counts) {
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(counts, mean, deviation);
  return {mean[0], deviation[0] * deviation[0]};
}

}  // namespace

TEST_CASE("an exposure is a whole number of lines, at least one") {
  SimBenchSettings s = precise_bench();
  s.line_time_s = 14.8e-6;
  const SimSensor sensor(s);
  struct Case {
    double asked_us, lines;
  };
  for (const Case& c :
       {Case{1, 1}, {14.8, 1}, {22, 1}, {23, 2}, {30, 2}, {400, 27}, {60000, 4054}}) {
    CHECK(sensor.applied_exposure_s(c.asked_us * 1e-6) == Approx(c.lines * 14.8e-6).epsilon(1e-12));
  }
}

TEST_CASE("a noiseless count is black level plus gain times electrons, rounded") {
  SimBenchSettings s = precise_bench();
  s.dark_current_e_s = 100;
  const SimSensor sensor(s);
  for (const double gain : {1.0, 2.5}) {
    for (const double exposure : {0.001, 0.01, 0.1}) {
      for (const double rate : {0.0, 500.0, 12345.0}) {
        const cv::Mat counts = sensor.expose(
            uniform_rate(rate, 2), {.exposure_s = exposure, .gain = gain, .noise = false});
        const double expected =
            kBlackDn + gain * kDnPerElectron * (rate * exposure + 100 * exposure);
        CHECK(counts.at<std::uint16_t>(1, 1) == Approx(expected).margin(0.501));
      }
    }
  }
}

TEST_CASE("counts end at full well, or at the converter's last code") {
  SimBenchSettings s = precise_bench();
  const cv::Mat rate = uniform_rate(1e9, 4);
  for (const bool noise : {false, true}) {
    const SimSensor sensor(s);
    const cv::Mat counts = sensor.expose(rate, {.exposure_s = 1, .gain = 1, .noise = noise});
    CHECK(cv::countNonZero(counts != 60000) == 0);
  }
  s.sensor.full_well_dn = 100000;
  CHECK(SimSensor(s).expose(rate, {.exposure_s = 1}).at<std::uint16_t>(0, 0) == 65535);
  s.sensor.bits = 10;
  CHECK(SimSensor(s).expose(rate, {.exposure_s = 1}).at<std::uint16_t>(0, 0) == 1023);
}

TEST_CASE("photon transfer: variance over mean is the gain, from fractions of an electron up") {
  SimBenchSettings s = precise_bench();
  s.noise = {.gain_dn_per_e = 1.7, .read_noise_dn = 2};
  const SimSensor sensor(s);
  const double mean_e = GENERATE(0.3, 5.0, 49.0, 51.0, 500.0, 5000.0);
  const double gain = GENERATE(1.0, 2.0);
  const cv::Mat counts = sensor.expose(
      uniform_rate(mean_e), {.exposure_s = 1, .gain = gain, .noise = true, .noise_seed = 77});
  const double dn_per_e = 1.7 * gain;
  const double signal = dn_per_e * mean_e;
  const double variance = dn_per_e * signal + 4 * gain * gain + 1.0 / 12;
  const double n = 256.0 * 256.0;
  const Moments seen = moments(counts);
  INFO(mean_e << " electrons at gain " << gain);
  CHECK(seen.mean == Approx(kBlackDn + signal).margin(4.5 * std::sqrt(variance / n)));
  // Relative deviation of a sample variance sqrt((kurtosis - 1) / n), a Poisson's excess is 1 /
  // mean.
  CHECK(seen.variance == Approx(variance).epsilon(4.5 * std::sqrt((2 + 1 / mean_e) / n)));
}

TEST_CASE("few electrons follow Poisson's law") {
  SimBenchSettings s = precise_bench();
  s.noise.read_noise_dn = 0;
  const double mean_e = GENERATE(0.05, 1.0, 8.0);
  const cv::Mat counts = SimSensor(s).expose(
      uniform_rate(mean_e), {.exposure_s = 1, .gain = 1, .noise = true, .noise_seed = 5});
  const double n = 256.0 * 256.0;
  double p = std::exp(-mean_e);
  for (int k = 0; k < 12; ++k) {
    const double share = cv::countNonZero(counts == kBlackDn + kDnPerElectron * k) / n;
    CHECK(share == Approx(p).margin(4.5 * std::sqrt(p * (1 - p) / n) + 1e-5));
    p *= mean_e / (k + 1);
  }
}

TEST_CASE("a dark frame shows the black level with the read noise") {
  const SimBenchSettings s = precise_bench();
  const Moments seen = moments(SimSensor(s).expose(
      uniform_rate(0), {.exposure_s = 1e-6, .gain = 1, .noise = true, .noise_seed = 9}));
  CHECK(seen.mean == Approx(kBlackDn).margin(0.04));
  CHECK(std::sqrt(seen.variance) == Approx(std::sqrt(4 + 1.0 / 12)).epsilon(0.02));
}

TEST_CASE("noise depends on its seed alone and is independent between pixels and frames") {
  const SimBenchSettings s = precise_bench();
  const SimSensor sensor(s);
  const auto shoot = [&](std::uint64_t seed) {
    return sensor.expose(uniform_rate(400),
                         {.exposure_s = 1, .gain = 1, .noise = true, .noise_seed = seed});
  };
  const cv::Mat first = shoot(1);
  const auto correlation = [](const cv::Mat& a, const cv::Mat& b) {
    cv::Mat x;
    cv::Mat y;
    a.convertTo(x, CV_64F);
    b.convertTo(y, CV_64F);
    x -= cv::mean(x);
    y -= cv::mean(y);
    return x.dot(y) / std::sqrt(x.dot(x) * y.dot(y));
  };
  const double limit = 4.5 / 256;
  CHECK(cv::norm(first, shoot(1), cv::NORM_INF) == 0);
  CHECK(std::abs(correlation(first, shoot(2))) < limit);
  CHECK(std::abs(correlation(first.rowRange(0, 255), first.rowRange(1, 256))) < limit);
  CHECK(std::abs(correlation(first.colRange(0, 255), first.colRange(1, 256))) < limit);

  SECTION("and not on the number of threads") {
    const int threads = cv::getNumThreads();
    cv::setNumThreads(1);
    const cv::Mat alone = shoot(1);
    cv::setNumThreads(threads);
    CHECK(cv::norm(first, alone, cv::NORM_INF) == 0);
  }
}
