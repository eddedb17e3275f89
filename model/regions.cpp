#include "model/regions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <string>

#include "model/error.hpp"
#include "model/expectation.hpp"
#include "model/label_cleaning.hpp"
#include "model/log_image.hpp"

namespace brdfgate {
namespace {

/// Pixel noise is allowed for at this many standard deviations: on 400,000 cells a handful pass.
constexpr float kNoiseSigmas = 4.0F;

/// Cells of one light within tolerance of the fixture in every channel.
cv::Mat near_fixture(const Reflectance& r, const FixtureAppearance& fixture) {
  cv::Mat out = cv::Mat::zeros(r.value.size(), CV_8UC1);
  const int channels = r.value.channels();
  for (int v = 0; v < out.rows; ++v) {
    const auto* f = r.value.ptr<float>(v);
    const auto* variance = r.variance.ptr<float>(v);
    const auto* mask = r.mask.ptr<unsigned char>(v);
    auto* near = out.ptr<unsigned char>(v);
    for (int u = 0; u < out.cols; ++u) {
      bool all = !(mask[u] & kClipped);
      for (int c = 0; c < channels && all; ++c) {
        const auto expected = static_cast<float>(fixture.reflectance[c] / std::numbers::pi);
        const float off = std::abs(f[u * channels + c] - expected);
        const float sigma = std::sqrt(variance[u * channels + c]);
        all = off <= static_cast<float>(fixture.tolerance) * expected + kNoiseSigmas * sigma;
      }
      near[u] = all ? 255 : 0;
    }
  }
  return out;
}

/// Nearest taught cluster of every part cell, and where even that one is too far.
struct Assignment {
  cv::Mat nearest;
  cv::Mat far;
};

/// Squared distance of one cell from one expectation: mean over channels of the squared difference.
float squared_distance(const float* cell, const float* expected, int channels) {
  float sum = 0;
  for (int c = 0; c < channels; ++c) {
    const float d = cell[c] - expected[c];
    sum += d * d;
  }
  return sum / static_cast<float>(channels);
}

/// A squared distance with the bonus of the taught place.
float nearer(float squared) {
  const float d = std::max(0.0F, std::sqrt(squared) - static_cast<float>(kPriorBonus));
  return d * d;
}

/// A cluster and its squared distance.
struct Nearest {
  std::size_t cluster = 0;
  float squared = std::numeric_limits<float>::infinity();
};

/// @param taught  the cluster of this place in the recipe; one that there is not: no bonus
Nearest nearest_of(const std::vector<ExpectedLog>& expected, const float* cell, int row,
                   int channels, std::size_t taught) {
  Nearest out;
  for (std::size_t k = 0; k < expected.size(); ++k) {
    float d = squared_distance(cell, expected[k].data() + row, channels);
    if (taught == k) d = nearer(d);
    if (d < out.squared) out = {k, d};  // not where nothing is expected: NaN
  }
  return out;
}

Assignment assign_cells(const LogImage& image, const cv::Mat& bin,
                        const std::vector<ExpectedLog>& expected, const cv::Mat& part,
                        double tolerance, const cv::Mat& prior) {
  Assignment out{cv::Mat(part.size(), CV_8UC1, cv::Scalar(kNotPart)),
                 cv::Mat::zeros(part.size(), CV_8UC1)};
  const int channels = image.value.channels();
  for (int v = 0; v < part.rows; ++v) {
    const auto* inside = part.ptr<unsigned char>(v);
    const auto* id = bin.ptr<int>(v);
    const auto* value = image.value.ptr<float>(v);
    const auto* variance = image.variance.ptr<float>(v);
    auto* nearest = out.nearest.ptr<unsigned char>(v);
    auto* far = out.far.ptr<unsigned char>(v);
    const auto* taught = prior.empty() ? nullptr : prior.ptr<unsigned char>(v);
    for (int u = 0; u < part.cols; ++u) {
      if (!inside[u]) continue;
      const Nearest found =
          nearest_of(expected, value + std::ptrdiff_t{u} * channels, id[u] * channels, channels,
                     taught == nullptr ? expected.size() : taught[u]);
      nearest[u] = static_cast<unsigned char>(found.cluster);
      float noise = 0;
      for (int c = 0; c < channels; ++c)
        noise += variance[u * channels + c] / static_cast<float>(channels);
      const float limit = static_cast<float>(tolerance) + kNoiseSigmas * std::sqrt(noise);
      far[u] = found.squared > limit * limit ? 255 : 0;
    }
  }
  return out;
}

void check_sizes(const Reflectance& light, const cv::Mat& other, const char* name) {
  if (other.size() == light.value.size()) return;
  throw InputError(name, std::to_string(other.cols) + " x " + std::to_string(other.rows) + " cells",
                   "the reflectance's " + std::to_string(light.value.cols) + " x " +
                       std::to_string(light.value.rows));
}

}  // namespace

cv::Mat fixture_cells(const std::vector<Reflectance>& r, const FixtureAppearance& fixture) {
  diffuse_light(r);  // checks the images
  cv::Mat fixture_like = near_fixture(r.front(), fixture);
  cv::Mat invalid = (r.front().mask & cv::Scalar(kInvalid)) != 0;
  for (std::size_t light = 1; light < r.size(); ++light) {
    check_sizes(r.front(), r[light].value, "reflectance");
    fixture_like &= near_fixture(r[light], fixture);
    invalid |= (r[light].mask & cv::Scalar(kInvalid)) != 0;
  }
  const cv::Mat square = cv::getStructuringElement(cv::MORPH_RECT, {3, 3});
  cv::morphologyEx(fixture_like, fixture_like, cv::MORPH_CLOSE, square);
  cv::morphologyEx(fixture_like, fixture_like, cv::MORPH_OPEN, square);
  return fixture_like | invalid;
}

Regions assign_regions(const std::vector<Reflectance>& r, const BinMap& bins,
                       const cv::Mat& not_part, const std::vector<TaughtAppearance>& taught,
                       double tolerance, const cv::Mat& prior) {
  const Reflectance& light = diffuse_light(r);
  if (taught.empty() || taught.size() > 8) {
    throw InputError("taught clusters", std::to_string(taught.size()), "1 to 8");
  }
  if (bins.id.size() < r.size()) {
    throw InputError("bin map", std::to_string(bins.id.size()) + " lights", "one per light seen");
  }
  const cv::Mat& bin = bins.id[r.size() > 1 ? 1 : 0];
  check_sizes(light, bin, "bin map");
  check_sizes(light, not_part, "part mask");
  if (!prior.empty()) check_sizes(light, prior, "taught labels");
  std::vector<ExpectedLog> expected;
  expected.reserve(taught.size());
  for (const TaughtAppearance& t : taught)
    expected.push_back(expected_log(t, bins, r.size() > 1 ? 2 : 1, light.value.channels()));

  const cv::Mat inspected = bin >= 0;
  const cv::Mat part = inspected & (not_part == 0) & ((light.mask & cv::Scalar(kInvalid)) == 0);
  const Assignment a =
      assign_cells(smoothed_log(light, part), bin, expected, part, tolerance, prior);
  Regions regions;
  regions.clusters = static_cast<int>(taught.size());
  regions.label = clean_labels(a.nearest, a.far, regions.clusters);
  regions.coverage =
      static_cast<double>(cv::countNonZero(part)) / std::max(1, cv::countNonZero(inspected));
  return regions;
}

}  // namespace brdfgate
