#include "catch.hpp"
#include "model/bracket_check.hpp"

using namespace brdfgate;

namespace {

constexpr double kBlack = 60;
constexpr double kTop = 1023;

SensorFormat sensor() {
  return {.width = 96, .height = 64, .bits = 10, .black_level_dn = kBlack, .full_well_dn = kTop};
}

/// A scene that runs from dark to bright across the image, with noise; `power` below 1 is a tone
/// curve.
struct Camera {
  double brightest_dn_s = 2e5;
  double offset_dn = 0;  ///< of the true black level from the datasheet's
  double power = 1;
  double noise_dn = 2;
  cv::RNG random{7};

  RawFrame take(double exposure_s, double gain = 1) {
    const SensorFormat s = sensor();
    RawFrame frame;
    frame.exposure_s = exposure_s;
    frame.gain = gain;
    frame.counts.create(s.height, s.width, CV_16UC1);
    for (int y = 0; y < s.height; ++y) {
      for (int x = 0; x < s.width; ++x) {
        const double share = (x + 0.5) / s.width;
        const double signal =
            std::min(brightest_dn_s * share * share * exposure_s * gain / (kTop - kBlack), 1.0);
        frame.counts.at<std::uint16_t>(y, x) = cv::saturate_cast<std::uint16_t>(
            std::min(kBlack + offset_dn + (kTop - kBlack) * std::pow(signal, power) +
                         random.gaussian(noise_dn),
                     kTop));
      }
    }
    return frame;
  }
};

std::string verdict(const std::vector<RawFrame>& frames, bool linear = true) {
  return bracket_contradiction(frames, sensor(), linear).value_or("");
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace

TEST_CASE("A sound bracket contradicts nothing") {
  Camera camera;
  SECTION("of a bright scene") {}
  SECTION("of a very bright scene") {
    camera.brightest_dn_s = 5e6;
  }
  SECTION("of a dark scene") {
    camera.brightest_dn_s = 2e3;
  }
  SECTION("of nothing at all") {
    camera.brightest_dn_s = 0;
  }
  SECTION("with a black level that is off by a hundredth of the range") {
    camera.offset_dn = 10;
  }
  CHECK(verdict({camera.take(3e-5), camera.take(4e-4), camera.take(5e-3), camera.take(6e-2)}) ==
        "");
  CHECK(verdict({camera.take(5e-3), camera.take(5e-3), camera.take(6e-2)}) == "");
  CHECK(verdict({camera.take(5e-3, 4), camera.take(6e-3), camera.take(1e-3, 8)}) == "");
}

TEST_CASE("A tone curve contradicts nothing where it is known of") {
  Camera camera;
  camera.power = 1 / 2.2;
  const std::vector<RawFrame> frames{camera.take(3e-5), camera.take(4e-4), camera.take(5e-3)};
  CHECK(verdict(frames, false) == "");
  CHECK(verdict(frames, true) != "");
}

TEST_CASE("A frame with another exposure than it reports is found") {
  // The last frame of {0.5, 2, 8} ms, exposed as the one before, as the first, or half.
  const auto exposed = GENERATE(2e-3, 5e-4, 4e-3, 0.0);
  CAPTURE(exposed);
  Camera camera;
  std::vector<RawFrame> frames{camera.take(5e-4), camera.take(2e-3), camera.take(exposed)};
  frames.back().exposure_s = 8e-3;
  CHECK(contains(verdict(frames), "8 ms at gain 1 do not show the same scene"));
}

TEST_CASE("A short exposure that is a long one is found") {
  Camera camera;
  std::vector<RawFrame> frames{camera.take(8e-3), camera.take(2e-3)};
  frames.front().exposure_s = 1e-4;
  CHECK(verdict(frames) != "");
}

TEST_CASE("A black frame in the middle of a bracket is found, with and without a tone curve") {
  Camera camera;
  std::vector<RawFrame> frames{camera.take(5e-4), camera.take(2e-3), camera.take(8e-3)};
  frames[1].counts = static_cast<std::uint16_t>(kBlack);
  CHECK(verdict(frames, true) != "");
  CHECK(verdict(frames, false) != "");
}

TEST_CASE("A frozen picture is found") {
  Camera camera;
  SECTION("under light") {}
  SECTION("in the dark, by its noise") {
    camera.brightest_dn_s = 0;
  }
  std::vector<RawFrame> frames{camera.take(2e-3), camera.take(2.1e-3)};
  frames[1].counts = frames[0].counts.clone();
  CHECK(contains(verdict(frames), "frozen"));
}

TEST_CASE("Equal pictures that any camera may give are not frozen") {
  SensorFormat s = sensor();
  RawFrame a;
  a.exposure_s = 0.001;
  a.counts = cv::Mat(s.height, s.width, CV_16UC1, cv::Scalar(kBlack));
  RawFrame b = a;
  b.exposure_s = 0.01;
  SECTION("a dark that clips at black") {}
  SECTION("black and clipped areas alone") {
    a.counts.colRange(0, 40) = kTop;
  }
  b.counts = a.counts.clone();
  CHECK(verdict({a, b}) == "");
}

TEST_CASE("A scene without noise contradicts nothing") {
  Camera camera;
  camera.noise_dn = 0;
  CHECK(verdict({camera.take(3e-5), camera.take(4e-4), camera.take(5e-3), camera.take(6e-2)}) ==
        "");
}
