// Local defects: blobs of cells that light 2 shows off what their taught material shows there.
// Duller and glossier spots need light 1, where a seating error of a tenth of a degree already
// moves the highlight by more than such a spot changes it: they are left to T^2 and SPE.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "model/error.hpp"
#include "model/expectation.hpp"
#include "model/log_image.hpp"
#include "model/verdict.hpp"

namespace brdfgate {
namespace {

/// Cells along the part's and the clusters' borders that are not looked at: mixed by the optics.
constexpr int kBorderCells = 3;
/// A cell's deviation must exceed this many standard deviations of its noise as well.
constexpr float kNoiseSigmas = 4.0F;

/// Each unknown blob takes the cluster that surrounds most of it, so that the part is divided among
/// clusters alone; blobs with no cluster around them stay kUnknown.
cv::Mat home_labels(const Regions& regions) {
  cv::Mat home = regions.label.clone();
  cv::Mat blobs;
  const int n = cv::connectedComponents(home == kUnknown, blobs, 8, CV_32S);
  if (n <= 1) return home;
  std::vector<std::array<int, 8>> votes(static_cast<std::size_t>(n), std::array<int, 8>{});
  cv::Mat around;  // of each cell, the highest blob number among itself and its neighbours
  cv::Mat as_float;
  blobs.convertTo(as_float, CV_32F);
  cv::dilate(as_float, around, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
  for (int v = 0; v < home.rows; ++v) {
    for (int u = 0; u < home.cols; ++u) {
      const auto blob = static_cast<std::size_t>(around.at<float>(v, u));
      const unsigned char label = home.at<unsigned char>(v, u);
      if (blob > 0 && label < 8) ++votes[blob][label];
    }
  }
  for (int v = 0; v < home.rows; ++v) {
    for (int u = 0; u < home.cols; ++u) {
      const auto blob = static_cast<std::size_t>(blobs.at<int>(v, u));
      if (blob == 0) continue;
      const auto most = std::max_element(votes[blob].begin(), votes[blob].end());
      if (*most > 0)
        home.at<unsigned char>(v, u) = static_cast<unsigned char>(most - votes[blob].begin());
    }
  }
  return home;
}

/// Cells at least kBorderCells away from any other cluster and from what is not part.
cv::Mat away_from_borders(const cv::Mat& home) {
  const int side = 2 * kBorderCells + 1;
  const cv::Mat square = cv::getStructuringElement(cv::MORPH_RECT, {side, side});
  cv::Mat least;
  cv::Mat most;
  cv::erode(home, least, square);
  cv::dilate(home, most, square);
  return (least == most) & (home != kNotPart);
}

/// Side of the square of as many cells as a bin of this light has on average.
int bin_side(const BinMap& bins, std::size_t light) {
  const auto count = std::count(bins.light.begin(), bins.light.end(), static_cast<int>(light) + 1);
  const double cells = cv::countNonZero(bins.id[light] >= 0);
  return std::max(1, static_cast<int>(std::sqrt(cells / std::max<double>(1, double(count)))));
}

/// The expectation as an image: each bin's value in its cells, blurred over about a bin so that it
/// runs on smoothly from bin to bin as the material does.
cv::Mat expected_image(const ExpectedLog& expected, const BinMap& bins, std::size_t light) {
  const int channels = static_cast<int>(expected.cols());
  const cv::Mat& id = bins.id[light];
  cv::Mat image = cv::Mat::zeros(id.size(), CV_32FC(channels));
  cv::Mat weight = cv::Mat::zeros(id.size(), CV_32FC1);
  for (int v = 0; v < id.rows; ++v) {
    const auto* bin = id.ptr<int>(v);
    auto* out = image.ptr<float>(v);
    auto* w = weight.ptr<float>(v);
    for (int u = 0; u < id.cols; ++u) {
      if (bin[u] < 0 || std::isnan(expected(bin[u], 0))) continue;
      w[u] = 1;
      for (int c = 0; c < channels; ++c)
        out[u * channels + c] = expected(bin[u], c);
    }
  }
  const int side = bin_side(bins, light);
  cv::boxFilter(image, image, CV_32F, {side, side}, {-1, -1}, false, cv::BORDER_CONSTANT);
  cv::boxFilter(weight, weight, CV_32F, {side, side}, {-1, -1}, false, cv::BORDER_CONSTANT);
  if (channels > 1) cv::merge(std::vector<cv::Mat>(std::size_t(channels), weight), weight);
  cv::divide(image, weight, image);
  return image;
}

/// Subtracts each channel's median over `cells`: lamp drift and a part-wide change of albedo are
/// the business of T^2.
void centre(cv::Mat& d, const cv::Mat& cells) {
  std::vector<float> values;
  for (int c = 0; c < d.channels(); ++c) {
    values.clear();
    for (int v = 0; v < d.rows; ++v) {
      const auto* in = cells.ptr<unsigned char>(v);
      const auto* x = d.ptr<float>(v);
      for (int u = 0; u < d.cols; ++u) {
        const int i = u * d.channels() + c;
        if (in[u] && std::isfinite(x[i])) values.push_back(x[i]);
      }
    }
    if (values.empty()) continue;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    for (int v = 0; v < d.rows; ++v) {
      const auto* in = cells.ptr<unsigned char>(v);
      auto* x = d.ptr<float>(v);
      for (int u = 0; u < d.cols; ++u) {
        const int i = u * d.channels() + c;
        if (in[u]) x[i] -= *middle;
      }
    }
  }
}

/// ln(f / expected) of every cell under its cluster, 0 where there is no expectation.
cv::Mat deviation_image(const LogImage& log, const cv::Mat& home, const BinMap& bins,
                        std::size_t light, const std::vector<TaughtAppearance>& taught) {
  cv::Mat d = cv::Mat::zeros(log.value.size(), log.value.type());
  for (std::size_t k = 0; k < taught.size(); ++k) {
    const cv::Mat cells = home == static_cast<int>(k);
    if (cv::countNonZero(cells) == 0) continue;
    const ExpectedLog expected =
        expected_log(taught[k], bins, static_cast<int>(light) + 1, log.value.channels());
    cv::Mat own = log.value - expected_image(expected, bins, light);
    centre(own, cells);
    own.copyTo(d, cells);
  }
  cv::patchNaNs(d, 0);
  return d;
}

/// Cells off by more than the threshold and the noise in their strongest channel.
cv::Mat deviating_cells(const cv::Mat& d, const cv::Mat& variance, double threshold) {
  cv::Mat out = cv::Mat::zeros(d.size(), CV_8UC1);
  const int channels = d.channels();
  for (int v = 0; v < d.rows; ++v) {
    const auto* x = d.ptr<float>(v);
    const auto* var = variance.ptr<float>(v);
    auto* o = out.ptr<unsigned char>(v);
    for (int i = 0; i < d.cols * channels; ++i) {
      const float limit = std::max(static_cast<float>(threshold), kNoiseSigmas * std::sqrt(var[i]));
      if (std::abs(x[i]) > limit) o[i / channels] = 255;
    }
  }
  return out;
}

/// Area of the plane that one cell sees, m^2.
double cell_area(const cv::Mat& position, int v, int u) {
  const auto step = [&position](int v0, int u0, int v1, int u1) -> cv::Vec2d {
    return cv::Vec2d(position.at<cv::Vec2f>(v1, u1)) - cv::Vec2d(position.at<cv::Vec2f>(v0, u0));
  };
  const int u0 = std::max(u - 1, 0);
  const int u1 = std::min(u + 1, position.cols - 1);
  const int v0 = std::max(v - 1, 0);
  const int v1 = std::min(v + 1, position.rows - 1);
  const cv::Vec2d a = step(v, u0, v, u1) / std::max(1, u1 - u0);
  const cv::Vec2d b = step(v0, u, v1, u) / std::max(1, v1 - v0);
  return std::abs(a[0] * b[1] - a[1] * b[0]);
}

struct Blob {
  int cells = 0;
  double area = 0;           ///< m^2
  cv::Vec2d position{0, 0};  ///< sum of area x metres
  cv::Vec3d d{0, 0, 0};      ///< sum per channel
  double strongest = 0;      ///< sum of the strongest channel's |d|
};

Blob measure(const cv::Mat& d, const cv::Mat& position, const cv::Mat& blobs, int label,
             const cv::Rect& box) {
  Blob b;
  for (int v = box.y; v < box.y + box.height; ++v) {
    for (int u = box.x; u < box.x + box.width; ++u) {
      if (blobs.at<int>(v, u) != label) continue;
      const double area = cell_area(position, v, u);
      ++b.cells;
      b.area += area;
      b.position += area * cv::Vec2d(position.at<cv::Vec2f>(v, u));
      double strongest = 0;
      for (int c = 0; c < d.channels(); ++c) {
        const double x = d.ptr<float>(v)[u * d.channels() + c];
        b.d[c] += x;
        strongest = std::max(strongest, std::abs(x));
      }
      b.strongest += strongest;
    }
  }
  return b;
}

/// Channels that disagree in sign, or spread by more than half of the strongest, are a colour.
std::string kind_of(const Blob& b, int channels) {
  double low = b.d[0];
  double high = b.d[0];
  for (int c = 1; c < channels; ++c) {
    low = std::min(low, b.d[c]);
    high = std::max(high, b.d[c]);
  }
  if (high - low > 0.5 * std::max(std::abs(low), std::abs(high))) return "colour";
  return low + high < 0 ? "darker" : "lighter";
}

Defect to_defect(const Blob& b, int channels, double threshold) {
  Defect defect;
  defect.kind = kind_of(b, channels);
  defect.at_mm = {b.position[0] / b.area * 1e3, b.position[1] / b.area * 1e3};
  defect.size_mm = 2 * std::sqrt(b.area / std::numbers::pi) * 1e3;
  defect.score = b.strongest / b.cells / threshold;
  return defect;
}

}  // namespace

std::vector<Defect> find_defects(const std::vector<Reflectance>& r, const StationMap& map,
                                 const Regions& regions,
                                 const std::vector<TaughtAppearance>& taught,
                                 const JudgeSettings& settings) {
  const Reflectance& seen = diffuse_light(r);
  const std::size_t light = r.size() > 1 ? 1 : 0;
  if (map.bins.id.size() <= light || map.bins.id[light].size() != seen.value.size() ||
      regions.label.size() != seen.value.size()) {
    throw InputError("defects", "labels, bins and reflectance of different sizes", "one size");
  }
  const cv::Mat home = home_labels(regions);
  const LogImage log = smoothed_log(seen, home != kNotPart);
  const cv::Mat d = deviation_image(log, home, map.bins, light, taught);
  cv::Mat off = deviating_cells(d, log.variance, settings.defect_log_threshold);
  off |= regions.label == kUnknown;
  off &= away_from_borders(home);
  cv::morphologyEx(off, off, cv::MORPH_CLOSE, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));

  cv::Mat blobs;
  cv::Mat stats;
  cv::Mat centroids;
  const int n = cv::connectedComponentsWithStats(off, blobs, stats, centroids, 8, CV_32S);
  std::vector<Defect> defects;
  for (int label = 1; label < n; ++label) {
    const cv::Rect box(
        stats.at<int>(label, cv::CC_STAT_LEFT), stats.at<int>(label, cv::CC_STAT_TOP),
        stats.at<int>(label, cv::CC_STAT_WIDTH), stats.at<int>(label, cv::CC_STAT_HEIGHT));
    const Blob b = measure(d, map.cells.position_m, blobs, label, box);
    if (b.area * 1e6 < settings.defect_min_mm2) continue;
    defects.push_back(to_defect(b, d.channels(), settings.defect_log_threshold));
  }
  std::sort(defects.begin(), defects.end(), [](const Defect& a, const Defect& b) {
    return a.score * a.size_mm > b.score * b.size_mm;
  });
  return defects;
}

}  // namespace brdfgate
