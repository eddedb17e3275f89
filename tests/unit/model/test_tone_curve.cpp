#include <cmath>
#include <random>

#include "catch.hpp"
#include "model/tone_curve.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;

namespace {

/// Count of a camera with a gamma curve and a shoulder, no noise: X 1 is near full scale.
double gamma_count(double x) {
  return 255 * std::pow(std::min(x, 1.0), 1 / 2.2);
}
/// A straight line up to a soft shoulder.
double shoulder_count(double x) {
  return 255 * (1 - std::exp(-1.6 * x)) / (1 - std::exp(-1.6));
}
using Curve = double (*)(double);

const std::vector<double> kTimes{1.0 / 64, 1.0 / 32, 1.0 / 16, 1.0 / 8, 1.0 / 4, 1.0 / 2, 1};

/// A scene of many levels, three decades, in blocks of four pixels.
cv::Mat scene() {
  cv::Mat radiance(64, 256, CV_32FC1);
  for (int y = 0; y < radiance.rows; ++y) {
    for (int x = 0; x < radiance.cols; ++x) {
      const int step = x / 4 + 64 * (y / 4 % 4);
      radiance.at<float>(y, x) = static_cast<float>(0.03 * std::pow(1000.0, step / 255.0));
    }
  }
  return radiance;
}

std::vector<cv::Mat> shoot(const cv::Mat& radiance, Curve curve, const std::vector<double>& times,
                           double noise_dn, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, noise_dn);
  std::vector<cv::Mat> images;
  for (const double t : times) {
    cv::Mat image(radiance.size(), CV_8UC1);
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        const double z = curve(radiance.at<float>(y, x) * t) + normal(random);
        image.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(std::clamp(z, 0.0, 255.0));
      }
    }
    images.push_back(image);
  }
  return images;
}

/// Spread of ln(merged / true) over the unmasked pixels: 95th percentile about its median.
double spread(const Radiance& merged, const cv::Mat& truth) {
  std::vector<double> off;
  for (int y = 0; y < truth.rows; ++y) {
    for (int x = 0; x < truth.cols; ++x) {
      if (merged.mask.at<std::uint8_t>(y, x) != 0) continue;
      off.push_back(std::log(merged.value.at<float>(y, x) / truth.at<float>(y, x)));
    }
  }
  REQUIRE(off.size() > truth.total() * 9 / 10);
  std::sort(off.begin(), off.end());
  const double middle = off[off.size() / 2];
  for (double& o : off)
    o = std::abs(o - middle);
  std::sort(off.begin(), off.end());
  return off[off.size() * 95 / 100];
}

std::string refusal(std::vector<cv::Mat> images, std::vector<double> times) {
  return test::input_error([&] { return recover_tone_curve(images, times); });
}

}  // namespace

TEST_CASE("a known response comes back from a noisy bracket") {
  const auto curve = GENERATE(Curve(gamma_count), Curve(shoulder_count));
  const std::vector<cv::Mat> images = shoot(scene(), curve, kTimes, 1.0, 7);
  const ToneCurve found = recover_tone_curve(images, kTimes);
  REQUIRE(found.levels() == 256);
  CHECK(std::is_sorted(found.log_x.begin(), found.log_x.end()));
  // ln X of counts by the curve's inverse, on a fine grid.
  const auto inverse = [&](double z) {
    double low = 0, high = 1;
    for (int i = 0; i < 50; ++i) {
      const double middle = (low + high) / 2;
      (curve(middle) < z ? low : high) = middle;
    }
    return std::log(low);
  };
  for (int z = 20; z <= 235; z += 5) {
    INFO("count " << z);
    CHECK(found.log_x[static_cast<std::size_t>(z)] - found.log_x[128] ==
          Approx(inverse(z) - inverse(128)).margin(0.03));
  }
}

TEST_CASE("a bracket merged with its recovered response is proportional to radiance") {
  const std::vector<cv::Mat> images = shoot(scene(), gamma_count, kTimes, 1.0, 8);
  const Radiance merged = merge_toned(images, kTimes, recover_tone_curve(images, kTimes));
  CHECK(spread(merged, scene()) < 0.04);
}

TEST_CASE("what a toned merge claims as its variance is what repetition scatters") {
  const ToneCurve curve = recover_tone_curve(shoot(scene(), gamma_count, kTimes, 1.0, 9), kTimes);
  double chi2 = 0;
  int n = 0;
  const Radiance a = merge_toned(shoot(scene(), gamma_count, kTimes, 1.0, 10), kTimes, curve);
  const Radiance b = merge_toned(shoot(scene(), gamma_count, kTimes, 1.0, 11), kTimes, curve);
  for (int i = 0; i < static_cast<int>(a.value.total()); ++i) {
    if (a.mask.data[i] != 0 || b.mask.data[i] != 0) continue;
    const double d = a.value.ptr<float>()[i] - b.value.ptr<float>()[i];
    chi2 += d * d / (a.variance.ptr<float>()[i] + b.variance.ptr<float>()[i]);
    ++n;
  }
  CHECK(chi2 / n == Approx(1).margin(0.3));
}

TEST_CASE("pixels that no exposure shows are masked by why, and never NaN") {
  cv::Mat radiance(64, 256, CV_32FC1, cv::Scalar(0.5));
  scene().copyTo(radiance);
  radiance.at<float>(0, 0) = 1e6F;
  radiance.at<float>(0, 1) = 0;
  const std::vector<cv::Mat> images = shoot(radiance, gamma_count, kTimes, 0.5, 12);
  const Radiance merged = merge_toned(images, kTimes, recover_tone_curve(images, kTimes));
  CHECK(merged.mask.at<std::uint8_t>(0, 0) == kClipped);
  CHECK(merged.mask.at<std::uint8_t>(0, 1) == kNoiseFloor);
  CHECK(cv::checkRange(merged.value));
  CHECK(cv::checkRange(merged.variance));
}

TEST_CASE("a bracket that cannot show a response is refused by what it lacks") {
  const std::vector<cv::Mat> good = shoot(scene(), gamma_count, kTimes, 1.0, 13);
  using Catch::Contains;
  CHECK_THAT(refusal({good[0]}, {1}), Contains("1 images with 1 exposure times"));
  CHECK_THAT(refusal({good[0], good[1]}, {1}), Contains("2 images with 1"));
  CHECK_THAT(refusal({good[0], good[1]}, {1, 1}), Contains("same time"));
  CHECK_THAT(refusal({good[0], good[1]}, {1, -2}), Contains("bracket[1]"));
  CHECK_THAT(refusal({good[0], good[1].rowRange(0, 9)}, {1, 2}), Contains("differs in size"));
  const cv::Mat flat(64, 256, CV_8UC1, cv::Scalar(255));
  CHECK_THAT(refusal({flat, flat}, {1, 2}), Contains("well exposed twice"));
  cv::Mat deep;
  good[0].convertTo(deep, CV_16U, 256);
  CHECK_THAT(refusal({deep, deep}, {1, 2}), Contains("holds count"));
}
