#include <random>

#include "catch.hpp"
#include "model/light_health.hpp"

using namespace brdfgate;

namespace {

constexpr double kBlackDn = 60;

/// Noisy frames of an even scene: `rate` in DN/s.
void expose(Capture& capture, LightIndex light, const std::vector<double>& exposures_s,
            double rate) {
  std::mt19937 random(static_cast<unsigned>(capture.frames.size()));
  for (const double t : exposures_s) {
    RawFrame frame;
    frame.counts.create(capture.sensor.height, capture.sensor.width, CV_16UC1);
    const double mean = kBlackDn + rate * t;
    std::normal_distribution<double> noise(mean, std::sqrt(0.1 * rate * t + 0.1));
    for (auto& count : cv::Mat_<std::uint16_t>(frame.counts)) {
      count = static_cast<std::uint16_t>(std::clamp(std::round(noise(random)), 0.0, 1023.0));
    }
    frame.light = light;
    frame.exposure_s = t;
    capture.frames.push_back(frame);
  }
}

/// White gives 100,000 DN/s under each light.
const std::vector<double> kWhite{1e5, 1e5};

Capture capture_of(double ambient, double light1, double light2) {
  Capture capture{
      {.width = 64, .height = 48, .bits = 10, .black_level_dn = kBlackDn, .full_well_dn = 1023},
      {}};
  expose(capture, kNoLight, {0.005, 0.06}, 1e5 * ambient);
  expose(capture, 2, {0.00003, 0.0004, 0.005, 0.06}, 1e5 * (ambient + light2));
  expose(capture, 1, {0.00003, 0.0004, 0.005, 0.06}, 1e5 * (ambient + light1));
  return capture;
}

std::string fault_of(const Capture& capture) {
  return light_fault(see_lights(capture, kBlackDn, kWhite));
}

}  // namespace

TEST_CASE("A light that makes no difference is told, and what it seems to do") {
  struct Case {
    double ambient, light1, light2;  ///< of white
    std::string says;
  };
  const auto c = GENERATE(values<Case>({
      {0, 0.25, 0.25, ""},
      {0.04, 0.25, 0.25, ""},
      {0.5, 0.25, 0.25, ""},  // a bright hall is not the lights' fault
      {0, 0.01, 0.01, ""},    // a nearly black scene
      {0, 0, 0.25, "light 1 stays dark"},
      {0, 0.25, 0, "light 2 stays dark"},
      {0.03, 0.25, 0, "light 2 stays dark"},
      {0, 0, 0, "light 1 stays dark"},
      {0.25, 0.25, 0, "light 2 stays on"},  // light 1 is seen over light 2
      {0.25, 0, 0.25, "light 1 stays on"},
      {0.6, 0, 0.25, "light 1 stays on"},  // clips the longest frames
  }));
  CAPTURE(c.ambient, c.light1, c.light2);
  const std::string fault = fault_of(capture_of(c.ambient, c.light1, c.light2));
  CHECK(fault.substr(0, c.says.size()) == c.says);
  CHECK(fault.empty() == c.says.empty());
  CHECK(fault.find("-0") == std::string::npos);
}

TEST_CASE("What the lights give is measured in shares of white") {
  const auto seen = see_lights(capture_of(0.02, 0.3, 0.1), kBlackDn, kWhite);
  REQUIRE(seen.size() == 2);
  CHECK(seen[0].gives == Approx(0.3).epsilon(0.02));
  CHECK(seen[1].gives == Approx(0.1).epsilon(0.02));
  CHECK(seen[0].without == Approx(0.02).epsilon(0.02));
}

TEST_CASE("A capture without a light's frames is not a light's fault") {
  Capture capture = capture_of(0, 0.25, 0.25);
  std::erase_if(capture.frames, [](const RawFrame& frame) { return frame.light == 1; });
  CHECK(fault_of(capture).empty());
}

TEST_CASE("The white's level is the mean of the mosaic, invalid cells left out") {
  Calibration calibration;
  Radiance white;
  white.value = cv::Mat(4, 4, CV_32FC3, cv::Scalar(1000, 2000, 3000));
  white.mask = cv::Mat::zeros(4, 4, CV_8U);
  white.value.at<cv::Vec3f>(0, 0) = {9e9F, 9e9F, 9e9F};
  white.mask.at<unsigned char>(0, 0) = kInvalid;
  calibration.white = {white};
  CHECK(white_levels(calibration) == std::vector<double>{2000});
}
