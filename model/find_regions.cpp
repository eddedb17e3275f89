// The materials of an unknown part: samples, mixture, labels, and which clusters are worth keeping.
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <random>
#include <string>

#include "model/error.hpp"
#include "model/label_cleaning.hpp"
#include "model/log_image.hpp"
#include "model/region_mixture.hpp"
#include "model/region_segments.hpp"
#include "model/regions.hpp"

namespace brdfgate {
namespace {

constexpr std::size_t kSamples = 4000;  ///< cells that the mixture is fitted to
constexpr std::size_t kLeastSamples = 30;
constexpr int kSampleMargin = 3;              ///< cells from the part's border: no mixed cells
constexpr double kLeastClusterShare = 0.003;  ///< of the part
/// Of a cluster's cells, those in squares of 5 x 5. A cluster under this is a border of mixed cells
/// or too thin to be measured beside its margins.
constexpr double kLeastSolidShare = 0.3;
constexpr double kFarSigmas = 8.0;  ///< from every trend, RMS over channels: unknown

constexpr int kNearCells = 9;  ///< edges keep segments a few cells from where materials meet
/// Added to the negative log-density (times two) of a trend that no segment nearby follows: a
/// surface is not to be trusted far from its cells.
constexpr double kDistantCost = 25.0;

/// Image coordinates in [-1, 1] over the part's bounding box.
struct Frame {
  cv::Rect box;
  double u(int x) const { return (2.0 * (x - box.x) + 1) / box.width - 1; }
  double v(int y) const { return (2.0 * (y - box.y) + 1) / box.height - 1; }
};

/// The part without its rim of mixed cells; all of it where little else is left.
cv::Mat core_of(const cv::Mat& part) {
  constexpr int kSide = 2 * kSampleMargin + 1;
  cv::Mat core;
  cv::erode(part, core, cv::getStructuringElement(cv::MORPH_RECT, {kSide, kSide}));
  return static_cast<std::size_t>(cv::countNonZero(core)) < kSamples / 4 ? part : core;
}

/// Cells to fit to, in a random order that is always the same.
std::vector<cv::Point> sample_cells(const cv::Mat& core) {
  std::vector<cv::Point> cells;
  cv::findNonZero(core, cells);
  std::mt19937 random(1);
  const std::size_t n = std::min(cells.size(), kSamples);
  for (std::size_t i = 0; i < n; ++i)
    std::swap(cells[i], cells[i + random() % (cells.size() - i)]);
  cells.resize(n);
  return cells;
}

TrendSamples make_samples(const LogImage& image, const cv::Mat& core, const cv::Mat& segments,
                          const Frame& frame) {
  const std::vector<cv::Point> cells = sample_cells(core);
  const int channels = image.value.channels();
  const auto n = static_cast<Eigen::Index>(cells.size());
  TrendSamples s{
      Eigen::MatrixXd(n, kTrendTerms), Eigen::MatrixXd(n, channels), Eigen::VectorXd::Zero(n), {}};
  for (Eigen::Index i = 0; i < n; ++i) {
    const cv::Point& at = cells[static_cast<std::size_t>(i)];
    s.segment.push_back(segments.at<int>(at));
    s.terms.row(i) = trend_terms(frame.u(at.x), frame.v(at.y)).matrix().transpose();
    const int first = at.x * channels;
    const auto* value = image.value.ptr<float>(at.y) + first;
    const auto* variance = image.variance.ptr<float>(at.y) + first;
    for (int c = 0; c < channels; ++c) {
      s.y(i, c) = value[c];
      s.noise[i] += variance[c] / channels;
    }
  }
  return s;
}

/// Where segments say which trend a cell follows, and around these where it probably does.
struct SegmentLabels {
  cv::Mat label;              ///< CV_8UC1, cluster or kNotPart where segments say nothing
  std::vector<cv::Mat> near;  ///< per cluster CV_8UC1, within kNearCells of its segments
};

SegmentLabels segment_labels(const cv::Mat& segments, const TrendFit& fit) {
  SegmentLabels out;
  out.label = cv::Mat(segments.size(), CV_8UC1, cv::Scalar(kNotPart));
  if (fit.of_segment.empty()) return out;
  for (int v = 0; v < segments.rows; ++v) {
    for (int u = 0; u < segments.cols; ++u) {
      const int segment = segments.at<int>(v, u);
      const int cluster = segment > 0 ? fit.of_segment[static_cast<std::size_t>(segment) - 1] : -1;
      if (cluster >= 0) out.label.at<unsigned char>(v, u) = static_cast<unsigned char>(cluster);
    }
  }
  constexpr int kSide = 2 * kNearCells + 1;
  const cv::Mat square = cv::getStructuringElement(cv::MORPH_RECT, {kSide, kSide});
  for (std::size_t k = 0; k < fit.trends.size(); ++k) {
    cv::Mat near;
    cv::dilate(out.label == static_cast<int>(k), near, square);
    out.near.push_back(near);
  }
  return out;
}

/// One cell against one trend: mean squared residual over its variance, and the negative
/// log-density that cells are assigned by.
struct Fit {
  double z2 = 0;
  double cost = 0;
};

Fit fit_cell(const float* value, const float* variance, const TrendTerms& terms, const Trend& t) {
  const auto channels = static_cast<int>(t.coefficients.cols());
  double sum = 0;
  double squares = 0;
  double noise = 0;
  for (int c = 0; c < channels; ++c) {
    const double d = value[c] - t.coefficients.col(c).dot(terms.matrix());
    sum += d;
    squares += d * d;
    noise += static_cast<double>(variance[c]) / channels;
  }
  const Residual r = split_residual(sum, squares, channels);
  const double level = t.level_variance + noise;
  const double hue = t.hue_variance + noise;
  const double z2 = r.level2 / level + r.hue2 / hue;
  return {z2 / channels,
          z2 + std::log(level) + (channels - 1) * std::log(hue) - 2 * std::log(t.share)};
}

/// Labels before cleaning.
struct RawLabels {
  cv::Mat nearest;  ///< CV_8UC1, cluster or kNotPart
  cv::Mat far;      ///< CV_8UC1, 255 where no trend is near
};

/// Nearest trend of every part cell that no segment decides, kept to the trends of segments nearby
/// unless another fits far better; and where no trend is near.
void label_rest(const LogImage& image, const cv::Mat& part, const Frame& frame,
                const std::vector<Trend>& trends, const SegmentLabels& segments, RawLabels& out) {
  const int channels = image.value.channels();
  for (int y = 0; y < part.rows; ++y) {
    const auto* value = image.value.ptr<float>(y);
    const auto* variance = image.variance.ptr<float>(y);
    for (int x = 0; x < part.cols; ++x) {
      auto& nearest = out.nearest.at<unsigned char>(y, x);
      if (!part.at<unsigned char>(y, x) || nearest != kNotPart) continue;
      const int first = x * channels;
      const TrendTerms terms = trend_terms(frame.u(x), frame.v(y));
      double least_cost = std::numeric_limits<double>::infinity();
      double least_z2 = least_cost;
      for (std::size_t k = 0; k < trends.size(); ++k) {
        Fit fit = fit_cell(value + first, variance + first, terms, trends[k]);
        least_z2 = std::min(least_z2, fit.z2);
        if (!segments.near.empty() && !segments.near[k].at<unsigned char>(y, x))
          fit.cost += kDistantCost;
        if (fit.cost >= least_cost) continue;
        least_cost = fit.cost;
        nearest = static_cast<unsigned char>(k);
      }
      out.far.at<unsigned char>(y, x) = least_z2 > kFarSigmas * kFarSigmas ? 255 : 0;
    }
  }
}

cv::Mat label_cells(const LogImage& image, const cv::Mat& part, const Frame& frame,
                    const cv::Mat& segments, const TrendFit& fit) {
  const SegmentLabels decided = segment_labels(segments, fit);
  RawLabels raw{decided.label.clone(), cv::Mat::zeros(part.size(), CV_8UC1)};
  label_rest(image, part, frame, fit.trends, decided, raw);
  return clean_labels(raw.nearest, raw.far, static_cast<int>(fit.trends.size()));
}

void remove_trend(TrendFit& fit, int gone) {
  fit.trends.erase(fit.trends.begin() + gone);
  for (int& cluster : fit.of_segment) {
    if (cluster == gone) {
      cluster = -1;
    } else if (cluster > gone) {
      --cluster;
    }
  }
}

/// The cluster least worth keeping: too small or too thin; -1 when all are sound.
int unsound_cluster(const cv::Mat& label, int clusters, int part_cells) {
  const cv::Mat square = cv::getStructuringElement(cv::MORPH_RECT, {5, 5});
  int worst = -1;
  int least = std::numeric_limits<int>::max();
  for (int k = 0; k < clusters; ++k) {
    const cv::Mat own = label == k;
    cv::Mat solid;
    cv::morphologyEx(own, solid, cv::MORPH_OPEN, square);
    const int area = cv::countNonZero(own);
    const bool small = area < kLeastClusterShare * part_cells;
    const bool thin = cv::countNonZero(solid) < kLeastSolidShare * area;
    if (!(small || thin) || area >= least) continue;
    least = area;
    worst = k;
  }
  return worst;
}

/// Renumbers clusters by falling area.
void order_by_area(cv::Mat& label, int clusters) {
  std::vector<std::pair<int, int>> areas;
  areas.reserve(static_cast<std::size_t>(clusters));
  for (int k = 0; k < clusters; ++k)
    areas.emplace_back(-cv::countNonZero(label == k), k);
  std::sort(areas.begin(), areas.end());
  cv::Mat table(1, 256, CV_8UC1);
  for (int i = 0; i < 256; ++i)
    table.at<unsigned char>(i) = static_cast<unsigned char>(i);
  for (int rank = 0; rank < clusters; ++rank)
    table.at<unsigned char>(areas[static_cast<std::size_t>(rank)].second) =
        static_cast<unsigned char>(rank);
  cv::LUT(label, table, label);
}

void check(const Reflectance& light, const CellGeometry& cells, const cv::Mat& not_part,
           int max_clusters) {
  if (max_clusters < 1 || max_clusters > 8) {
    throw InputError("max_clusters", std::to_string(max_clusters), "1 to 8");
  }
  if (cells.inside.size() != light.value.size() || not_part.size() != light.value.size()) {
    throw InputError("regions", "geometry, part mask and reflectance of different sizes",
                     "one size");
  }
}

}  // namespace

Regions find_regions(const std::vector<Reflectance>& r, const CellGeometry& cells,
                     const cv::Mat& not_part, int max_clusters) {
  const Reflectance& light = diffuse_light(r);
  check(light, cells, not_part, max_clusters);
  const cv::Mat part = cells.inside & (not_part == 0) & ((light.mask & cv::Scalar(kInvalid)) == 0);
  const int area = cv::countNonZero(part);
  Regions regions;
  regions.coverage = static_cast<double>(area) / std::max(1, cv::countNonZero(cells.inside));
  regions.clusters = area > 0 ? 1 : 0;
  regions.label = cv::Mat(part.size(), CV_8UC1, cv::Scalar(kNotPart));
  regions.label.setTo(0, part);
  if (static_cast<std::size_t>(area) < kLeastSamples) return regions;

  const LogImage image = smoothed_log(light, part);
  const Frame frame{cv::boundingRect(part)};
  const cv::Mat core = core_of(part);
  const cv::Mat segments =
      smooth_segments(image, core, static_cast<int>(kLeastClusterShare * cv::countNonZero(core)));
  TrendFit fit = fit_trends(make_samples(image, core, segments, frame), max_clusters);
  for (;;) {
    regions.clusters = static_cast<int>(fit.trends.size());
    regions.label = label_cells(image, part, frame, segments, fit);
    const int unsound = unsound_cluster(regions.label, regions.clusters, area);
    if (unsound < 0 || regions.clusters == 1) break;
    remove_trend(fit, unsound);
  }
  order_by_area(regions.label, regions.clusters);
  return regions;
}

}  // namespace brdfgate
