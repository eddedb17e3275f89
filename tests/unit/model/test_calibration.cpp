#include <cmath>

#include "catch.hpp"
#include "model/calibration.hpp"
#include "model/noise_measurement.hpp"
#include "support/input_error.hpp"
#include "support/photons.hpp"

using namespace brdfgate;
using test::BenchSensor;

namespace {

const std::vector<double> kExposures{0.4e-3, 5e-3, 40e-3};
constexpr double kWhite = 60e3;  // DN/s: half of full well in 8 ms

BenchSensor small_bench(double read_noise_dn = 0.8) {
  BenchSensor bench;
  bench.sensor.width = 256;
  bench.sensor.height = 64;
  bench.noise.read_noise_dn = read_noise_dn;
  return bench;
}

/// White that falls off to one side, as lights do.
cv::Mat shaded(const SensorFormat& sensor, double level) {
  cv::Mat radiance(sensor.height, sensor.width, CV_32FC1);
  for (int x = 0; x < sensor.width; ++x)
    radiance.col(x).setTo(level * (1.2 - 0.4 * x / sensor.width));
  return radiance;
}

void append(Capture& capture, std::vector<RawFrame> frames) {
  for (RawFrame& frame : frames)
    capture.frames.push_back(std::move(frame));
}

Capture dark_capture(const BenchSensor& bench, unsigned seed) {
  Capture dark{bench.sensor, {}};
  append(dark, test::expose(bench, shaded(bench.sensor, 0), kExposures, seed));
  return dark;
}

Capture white_capture(const BenchSensor& bench, unsigned seed, double drift = 1) {
  Capture white{bench.sensor, {}};
  append(white, test::expose(bench, shaded(bench.sensor, 0), {40e-3}, seed));
  append(white, test::expose(bench, shaded(bench.sensor, kWhite), kExposures, seed + 1, 1));
  append(white, test::expose(bench, shaded(bench.sensor, drift * kWhite), kExposures, seed + 2, 2));
  return white;
}

/// Two darks and two whites of a sensor whose datasheet is wrong.
CalibrationInput good_input(const BenchSensor& bench) {
  CalibrationInput input;
  input.darks = {dark_capture(bench, 100), dark_capture(bench, 200)};
  input.whites = {white_capture(bench, 300), white_capture(bench, 400)};
  NominalRig rig;
  rig.lights = {{55, 180, 0.3}, {20, 0, 0.3}};
  input.geometry = make_geometry(rig, bench.sensor);
  input.nominal = {bench.noise.gain_dn_per_e * 1.3, bench.noise.read_noise_dn * 1.5};
  return input;
}

/// The black level is 1.4 DN off the datasheet's.
void shift_black(CalibrationInput& input, double by) {
  for (auto* captures : {&input.darks, &input.whites}) {
    for (Capture& capture : *captures)
      capture.sensor.black_level_dn += by;
  }
}

std::string refusal(const CalibrationInput& input) {
  return test::input_error([&] { return calibrate(input); });
}

}  // namespace

TEST_CASE("calibration finds black level, read noise and gain") {
  const BenchSensor bench = small_bench();
  CalibrationInput input = good_input(bench);
  shift_black(input, 1.4);
  const Calibration c = calibrate(input);
  CHECK(c.sensor.black_level_dn == Approx(60).margin(0.02));
  CHECK(c.noise.read_noise_dn == Approx(0.8).epsilon(0.03));
  CHECK(c.noise.gain_dn_per_e == Approx(0.0963).epsilon(0.02));
}

TEST_CASE("the light's drift between two whites does not pass for noise") {
  const BenchSensor bench = small_bench();
  CalibrationInput input = good_input(bench);
  input.whites[1] = white_capture(bench, 400, 1.04);
  CHECK(calibrate(input).noise.gain_dn_per_e == Approx(0.0963).epsilon(0.02));
}

TEST_CASE("hot pixels do not move the read noise") {
  const BenchSensor bench = small_bench();
  CalibrationInput input = good_input(bench);
  for (Capture& dark : input.darks) {
    for (RawFrame& frame : dark.frames) {
      for (int i = 0; i < 20; ++i)
        frame.counts.at<std::uint16_t>(3 * i % 64, 11 * i) = static_cast<std::uint16_t>(80 + 7 * i);
    }
  }
  input.darks[0].frames[1].counts.at<std::uint16_t>(40, 40) = 900;
  CHECK(calibrate(input).noise.read_noise_dn == Approx(0.8).epsilon(0.03));
}

TEST_CASE("one dark recording tells the read noise from its pixels") {
  const BenchSensor bench = small_bench();
  CHECK(measure_read_noise({dark_capture(bench, 1)}, {0.1, 9}) == Approx(0.8).epsilon(0.03));
}

TEST_CASE("read noise that quantisation hides stays the datasheet's") {
  const BenchSensor bench = small_bench(0.3);
  CHECK(measure_read_noise({dark_capture(bench, 1), dark_capture(bench, 2)}, {0.1, 0.31}) == 0.31);
}

TEST_CASE("one white recording leaves the datasheet's gain in force") {
  CalibrationInput input = good_input(small_bench());
  input.whites.pop_back();
  CHECK(calibrate(input).noise.gain_dn_per_e == input.nominal.gain_dn_per_e);
}

TEST_CASE("whites are averaged and their variance with them") {
  const BenchSensor bench = small_bench();
  CalibrationInput input = good_input(bench);
  input.nominal = bench.noise;
  const Calibration two = calibrate(input);
  input.whites.pop_back();
  const Calibration one = calibrate(input);
  REQUIRE(two.white.size() == 2);
  const cv::Size cells = bench.sensor.cells();
  REQUIRE(two.white[1].value.size() == cells);
  CHECK(cv::mean(one.white[0].variance)[0] / cv::mean(two.white[0].variance)[0] ==
        Approx(2).epsilon(0.05));
  double chi2 = 0;
  for (int v = 0; v < cells.height; ++v) {
    for (int u = 0; u < cells.width; ++u) {
      const double truth = kWhite * (1.2 - 0.4 * (2 * u + 0.5) / bench.sensor.width);
      const double d = two.white[1].value.at<cv::Vec3f>(v, u)[1] - truth;
      chi2 += d * d / two.white[1].variance.at<cv::Vec3f>(v, u)[1];
    }
  }
  CHECK(chi2 / cells.area() == Approx(1).epsilon(0.08));
  CHECK(cv::countNonZero(two.white[0].mask) == 0);
}

TEST_CASE("recordings that cannot calibrate are refused by name") {
  const BenchSensor bench = small_bench();
  CalibrationInput input = good_input(bench);
  SECTION("no darks") {
    input.darks.clear();
    CHECK(test::contains(refusal(input), "darks: no dark recording"));
  }
  SECTION("no whites") {
    input.whites.clear();
    CHECK(test::contains(refusal(input), "whites: no white recording"));
  }
  SECTION("no lights") {
    input.geometry.lights_W.clear();
    CHECK(test::contains(refusal(input), "geometry: no light"));
  }
  SECTION("another sensor format") {
    input.whites[1].sensor.bits = 12;
    CHECK(test::contains(refusal(input), "whites[1]: another sensor format"));
  }
  SECTION("a recording without frames") {
    input.darks[1].frames.clear();
    CHECK(test::contains(refusal(input), "darks[1]: no frame"));
  }
  SECTION("a frame of another size") {
    input.darks[1].frames[2].counts = cv::Mat::zeros(3, 3, CV_16UC1);
    CHECK(test::contains(refusal(input), "darks[1]: frame 2: 3 x 3 pixels"));
  }
  SECTION("a dark under light") {
    input.darks[1].frames[0].light = 2;
    CHECK(test::contains(refusal(input), "darks[1].frames[0]: taken under light 2"));
  }
  SECTION("a dark that is not dark") {
    input.darks[0].frames[2].counts += 40;
    CHECK(test::contains(refusal(input), "darks[0].frames[2]: a dark with a mean of 100 DN"));
  }
  SECTION("a dark into which light leaks") {
    input.darks[1].frames[2].counts += 6;
    CHECK(test::contains(refusal(input), "darks[1].frames[2]: a dark that rises by 6"));
  }
  SECTION("a white that is dark under one light") {
    for (RawFrame& frame : input.whites[1].frames) {
      if (frame.light == 2) frame.counts = input.darks[0].frames[0].counts;
    }
    CHECK(test::contains(refusal(input), "whites[1]: white is dark under light 2"));
  }
  SECTION("a white without one light") {
    std::erase_if(input.whites[0].frames, [](const RawFrame& f) { return f.light == 1; });
    CHECK(test::contains(refusal(input), "whites[0]: capture: the bracket under light 1"));
  }
  SECTION("a white without its ambient frame") {
    std::erase_if(input.whites[0].frames, [](const RawFrame& f) { return f.light == kNoLight; });
    CHECK(test::contains(refusal(input), "whites[0]: capture: the ambient frame is missing"));
  }
  SECTION("a white that is clipped throughout") {
    for (RawFrame& frame : input.whites[0].frames) {
      if (frame.light == 1) frame.counts.setTo(1023);
    }
    CHECK(test::contains(refusal(input), "whites[0]: white is clipped under light 1"));
  }
  SECTION("exposures mixed up") {
    std::swap(input.whites[0].frames[1].exposure_s, input.whites[0].frames[3].exposure_s);
    CHECK(test::contains(refusal(input), "whites[0]: under light 1 the mean falls"));
  }
  SECTION("whites without a common exposure") {
    for (RawFrame& frame : input.whites[1].frames)
      frame.exposure_s *= 1.001;
    CHECK(test::contains(refusal(input), "the gain cannot be measured"));
  }
}
