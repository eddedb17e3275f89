#include "model/linearity.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>

#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr std::size_t kLeastPoints = 5;
constexpr double kQuantisation = 1.0 / 12;
constexpr double kSlopeUpTo = 0.7;  // of saturation (EMVA 1288, 6.6)
constexpr double kLinearFrom = 0.05, kLinearTo = 0.95;

using Key = std::pair<LightIndex, double>;

/// Column of the first row's green.
int green_column(Mosaic mosaic) {
  return mosaic == Mosaic::rggb || mosaic == Mosaic::bggr ? 1 : 0;
}

cv::Mat middle(const RawFrame& frame, Mosaic mosaic) {
  const cv::Mat& m = frame.counts;
  // Small: the light falls off over the plate. Even offsets: a mosaic's colours stay where they
  // are.
  const cv::Rect part(m.cols * 3 / 16 * 2, m.rows * 3 / 16 * 2, std::max(2, m.cols / 4),
                      std::max(2, m.rows / 4));
  const cv::Mat seen = m(part & cv::Rect({}, m.size()));
  cv::Mat out;
  if (mosaic == Mosaic::mono) {
    seen.convertTo(out, CV_32F);
    return out;
  }
  out.create(seen.rows / 2, seen.cols / 2, CV_32FC1);
  for (int y = 0; y < out.rows; ++y) {
    const auto* in = seen.ptr<std::uint16_t>(2 * y) + green_column(mosaic);
    for (int x = 0; x < out.cols; ++x)
      out.at<float>(y, x) = in[std::ptrdiff_t{2} * x];
  }
  return out;
}

/// One exposure's figures with its pixels' spread, which tells whether they are clipped.
struct Point : SweepPoint {
  double spread_dn = 0;
};

/// Temporal variance from the frames' differences in pairs, so that no pattern of the scene counts;
/// a drift of the light between the two shifts the difference's mean, not its variance.
Point point_of(double exposure_s, const std::vector<const RawFrame*>& frames, Mosaic mosaic,
               double black) {
  Point point;
  point.exposure_s = exposure_s;
  double pairs = 0;
  for (std::size_t i = 0; i + 1 < frames.size(); i += 2) {
    const cv::Mat a = middle(*frames[i], mosaic);
    const cv::Mat b = middle(*frames[i + 1], mosaic);
    cv::Scalar mean, deviation;
    cv::meanStdDev(a - b, mean, deviation);
    point.mean_dn += (cv::mean(a)[0] + cv::mean(b)[0]) / 2 - black;
    point.variance_dn2 += deviation[0] * deviation[0] / 2;
    cv::meanStdDev(a, mean, deviation);
    point.spread_dn = std::max(point.spread_dn, deviation[0]);
    pairs += 1;
  }
  point.mean_dn /= pairs;
  point.variance_dn2 /= pairs;
  return point;
}

/// The light with the most exposures, its points by exposure.
std::vector<Point> points_of(const std::vector<Capture>& sweep, double black) {
  std::map<Key, std::vector<const RawFrame*>> by_setting;
  for (const Capture& capture : sweep) {
    for (const RawFrame& frame : capture.frames) {
      if (frame.light != kNoLight)
        by_setting[{frame.light, frame.exposure_s * frame.gain}].push_back(&frame);
    }
  }
  const Mosaic mosaic = sweep.empty() ? Mosaic::mono : sweep.front().sensor.mosaic;
  std::map<LightIndex, std::vector<Point>> by_light;
  for (const auto& [key, frames] : by_setting) {
    if (frames.size() >= 2) {
      by_light[key.first].push_back(point_of(key.second, frames, mosaic, black));
    }
  }
  std::vector<Point> best;
  for (auto& [light, points] : by_light) {
    if (points.size() > best.size()) best = std::move(points);
  }
  return best;
}

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

void check(const std::vector<SweepPoint>& points, double range) {
  if (points.size() < kLeastPoints) {
    throw InputError("photon-transfer sweep",
                     std::to_string(points.size()) + " exposures with two equal frames",
                     "at least " + std::to_string(kLeastPoints) + " under one light");
  }
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (points[i].mean_dn < points[i - 1].mean_dn - 0.02 * range) {
      throw InputError("photon-transfer sweep",
                       "the signal falls from " + number(points[i - 1].mean_dn) + " to " +
                           number(points[i].mean_dn) + " DN as the exposure rises to " +
                           number(1e3 * points[i].exposure_s) + " ms",
                       "a steady light, and exposures as they are written down");
    }
  }
  if (points.back().mean_dn < 0.5 * range) {
    throw InputError("photon-transfer sweep",
                     "the brightest frames reach " + number(100 * points.back().mean_dn / range) +
                         " % of full well",
                     "exposures up to saturation");
  }
}

/// Slope and intercept of the variance over the mean; each variance is known to the same share.
Eigen::Vector2d variance_line(const std::vector<SweepPoint>& points, double saturation) {
  Eigen::Matrix2d A = Eigen::Matrix2d::Zero();
  Eigen::Vector2d b = Eigen::Vector2d::Zero();
  for (const SweepPoint& p : points) {
    if (p.mean_dn > kSlopeUpTo * saturation || !(p.variance_dn2 > 0)) continue;
    const Eigen::Vector2d row = Eigen::Vector2d(p.mean_dn, 1) / p.variance_dn2;
    A += row * row.transpose();
    b += row;
  }
  return A.ldlt().solve(b);
}

/// mean = s t with the relative residuals least, then the worst of them.
double linearity_percent(const std::vector<SweepPoint>& points, double saturation) {
  double sum = 0, squares = 0;
  std::vector<double> ratio;
  for (const SweepPoint& p : points) {
    if (p.mean_dn < kLinearFrom * saturation || p.mean_dn > kLinearTo * saturation) continue;
    ratio.push_back(p.mean_dn / p.exposure_s);
    sum += 1 / ratio.back();
    squares += 1 / (ratio.back() * ratio.back());
  }
  if (ratio.size() < 2) return 0;
  const double s = sum / squares;
  double worst = 0;
  for (const double r : ratio)
    worst = std::max(worst, std::abs(s / r - 1));
  return 100 * worst;
}

/// Full well from the brightest frames, where their variance says that they are clipped: it is far
/// under what shot noise would make. Nothing else.
std::optional<double> plateau(const std::vector<Point>& points, const Eigen::Vector2d& line) {
  const Point& last = points.back();
  constexpr double kCollapsed = 0.25;
  if (last.variance_dn2 > kCollapsed * (line[0] * last.mean_dn + line[1])) return std::nullopt;
  return last.mean_dn - 3 * last.spread_dn;
}

}  // namespace

PhotonTransfer photon_transfer(const std::vector<Capture>& sweep, double black_level_dn) {
  PhotonTransfer out;
  const std::vector<Point> points = points_of(sweep, black_level_dn);
  out.points.assign(points.begin(), points.end());
  const double range =
      sweep.empty() ? 1 : sweep.front().sensor.full_well_dn - sweep.front().sensor.black_level_dn;
  check(out.points, range);
  // The variance collapses where pixels clip: its greatest value marks saturation.
  const auto top = std::max_element(
      out.points.begin(), out.points.end(),
      [](const SweepPoint& a, const SweepPoint& b) { return a.variance_dn2 < b.variance_dn2; });
  const Eigen::Vector2d line = variance_line(out.points, top->mean_dn);
  out.gain_dn_per_e = line[0];
  out.read_noise_dn = std::sqrt(std::max(0.0, line[1] - kQuantisation));
  const double saturation = plateau(points, line).value_or(top->mean_dn);
  out.full_well_dn = saturation + black_level_dn;
  out.saturation_e = saturation / out.gain_dn_per_e;
  out.linearity_percent = linearity_percent(out.points, top->mean_dn);
  if (!(out.gain_dn_per_e > 0)) {
    throw InputError("photon-transfer sweep", "its noise does not grow with the signal",
                     "raw counts, not processed pictures");
  }
  return out;
}

}  // namespace brdfgate
