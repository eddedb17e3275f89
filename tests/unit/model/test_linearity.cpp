#include <cmath>

#include "catch.hpp"
#include "model/linearity.hpp"
#include "support/input_error.hpp"
#include "support/photons.hpp"

using namespace brdfgate;
using test::BenchSensor;

namespace {

BenchSensor small_bench() {
  BenchSensor bench;
  bench.sensor.width = 640;
  bench.sensor.height = 480;
  bench.noise.read_noise_dn = 1.2;
  return bench;
}

/// Two recordings of a sweep in which white reaches full well at 16 ms.
std::vector<Capture> sweep(const BenchSensor& bench, const std::vector<double>& ms) {
  const cv::Mat radiance(bench.sensor.height, bench.sensor.width, CV_32FC1, cv::Scalar(60e3));
  std::vector<double> seconds;
  for (const double t : ms)
    seconds.push_back(t * 1e-3);
  return {{bench.sensor, test::expose(bench, radiance, seconds, 31, 1)},
          {bench.sensor, test::expose(bench, radiance, seconds, 32, 1)}};
}

const std::vector<double> kSweepMs{0.2, 0.5, 1, 2, 4, 6, 8, 10, 12, 14, 15, 20};

std::string refusal(const std::vector<Capture>& sweep_captures) {
  return test::input_error([&] { return photon_transfer(sweep_captures, 60); });
}

}  // namespace

TEST_CASE("a photon-transfer sweep gives gain, read noise, full well and linearity") {
  const BenchSensor bench = small_bench();
  const PhotonTransfer found = photon_transfer(sweep(bench, kSweepMs), bench.sensor.black_level_dn);
  CHECK(found.gain_dn_per_e == Approx(bench.noise.gain_dn_per_e).epsilon(0.02));
  CHECK(found.read_noise_dn == Approx(bench.noise.read_noise_dn).epsilon(0.1));
  CHECK(found.full_well_dn == Approx(bench.sensor.full_well_dn).margin(1));
  CHECK(found.linear());
  CHECK(found.linearity_percent < 0.3);
}

TEST_CASE("a full well under the datasheet's is found where pixels stop") {
  const BenchSensor bench = small_bench();
  std::vector<Capture> low = sweep(bench, kSweepMs);
  for (Capture& capture : low) {
    for (RawFrame& frame : capture.frames)
      cv::min(frame.counts, 860, frame.counts);
  }
  CHECK(photon_transfer(low, 60).full_well_dn == Approx(860).margin(1));
}

TEST_CASE("without saturated frames the greatest variance tells the full well") {
  const BenchSensor bench = small_bench();
  const PhotonTransfer found = photon_transfer(sweep(bench, {1, 2, 4, 6, 8, 10, 12}), 60);
  CHECK(found.full_well_dn == Approx(60 + 60e3 * 12e-3).epsilon(0.01));
}

TEST_CASE("a mosaic's sweep is told by its greens") {
  BenchSensor bench = small_bench();
  bench.sensor.mosaic = Mosaic::grbg;
  std::vector<Capture> coloured = sweep(bench, kSweepMs);
  for (Capture& capture : coloured) {
    for (RawFrame& frame : capture.frames) {
      for (int y = 0; y < frame.counts.rows; ++y) {
        for (int x = 0; x < frame.counts.cols; ++x)  // what is no green is garbage
          if ((x + y) % 2 == 1) frame.counts.at<std::uint16_t>(y, x) = 500;
      }
    }
  }
  const PhotonTransfer found = photon_transfer(coloured, 60);
  CHECK(found.gain_dn_per_e == Approx(bench.noise.gain_dn_per_e).epsilon(0.03));
  CHECK(found.full_well_dn == Approx(1023).margin(1));
}

TEST_CASE("a camera with a tone curve is found not to be linear") {
  const BenchSensor bench = small_bench();
  std::vector<Capture> toned = sweep(bench, kSweepMs);
  for (Capture& capture : toned) {
    for (RawFrame& frame : capture.frames) {
      frame.counts.forEach<std::uint16_t>([](std::uint16_t& z, const int*) {
        const double share = std::max(0.0, z - 60.0) / 963;
        z = static_cast<std::uint16_t>(60 + 963 * std::pow(share, 0.8));
      });
    }
  }
  CHECK_FALSE(photon_transfer(toned, 60).linear());
}

TEST_CASE("exposures that were swapped break the sweep by name") {
  std::vector<Capture> swapped = sweep(small_bench(), kSweepMs);
  for (Capture& capture : swapped)
    std::swap(capture.frames[2].exposure_s, capture.frames[6].exposure_s);
  CHECK_THAT(refusal(swapped), Catch::Contains("the signal falls"));
}

TEST_CASE("a sweep too short or too dark is refused") {
  CHECK_THAT(refusal({}), Catch::Contains("0 exposures with two equal frames"));
  CHECK_THAT(refusal(sweep(small_bench(), {1, 2, 4})), Catch::Contains("3 exposures"));
  CHECK_THAT(refusal(sweep(small_bench(), {0.1, 0.2, 0.4, 0.8, 1.6})),
             Catch::Contains("% of full well"));
}
