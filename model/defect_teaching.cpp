// What good parts show over the blocks of a part, and the limit that their extremes give.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <random>

#include "model/defect_scores.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

/// The window whose part-to-part deviation is taught.
constexpr std::size_t kTaughtWindow = 0;
/// ln units: no deviation is taken for smaller (the calibration's own structure).
constexpr float kLeastDeviation = 0.004F;
constexpr int kFewParts = 3;
/// Gaussian limit's factor where too few maxima tell of the tail.
constexpr double kFewMargin = 1.5;

double normal_quantile_above(double tail) {
  double low = 0, high = 40;
  for (int i = 0; i < 80; ++i) {
    const double x = (low + high) / 2;
    (0.5 * std::erfc(x / std::numbers::sqrt2) > tail ? low : high) = x;
  }
  return low;
}

struct Gumbel {
  double location = 0, scale = 0;
};
/// By moments.
Gumbel fit_gumbel(const std::vector<double>& x) {
  const auto n = static_cast<double>(x.size());
  const double mean = std::accumulate(x.begin(), x.end(), 0.0) / n;
  double squares = 0;
  for (const double v : x)
    squares += (v - mean) * (v - mean);
  const double scale = std::sqrt(squares / (n - 1) * 6) / std::numbers::pi;
  return {mean - std::numbers::egamma * scale, scale};
}

/// How many fitted scales above its fitted location the (1 - rate) quantile of a fresh maximum
/// lies, N maxima having made the fit: the fit is equivariant, so the standard Gumbel law tells it.
double predictive_reach(std::size_t n, double rate) {
  constexpr int kFits = 2000;
  std::mt19937 random(20190408);
  std::uniform_real_distribution<double> uniform(1e-12, 1.0);
  std::vector<Gumbel> fits;
  std::vector<double> drawn(n);
  for (int i = 0; i < kFits; ++i) {
    for (double& x : drawn)
      x = -std::log(-std::log(uniform(random)));
    fits.push_back(fit_gumbel(drawn));
  }
  double low = 0, high = 1000;
  for (int step = 0; step < 60; ++step) {
    const double reach = (low + high) / 2;
    double beyond = 0;
    for (const Gumbel& g : fits)
      beyond += -std::expm1(-std::exp(-(g.location + reach * g.scale)));
    (beyond / kFits > rate ? low : high) = reach;
  }
  return high;
}

/// Sums of one part's tiles, per light: of blocks, residuals and their squares.
struct TileSums {
  cv::Mat blocks, sum, squares;  ///< CV_64FC(channels), all of them
};

TileSums tile_sums(const DefectEvidence::Light& light, const cv::Size& window) {
  const DefectWindows w = windows_of(light, window);
  const cv::Size size = defect_tiles(w.mean.size());
  const int channels = w.mean.channels();
  TileSums out{cv::Mat::zeros(size, CV_64FC(channels)), cv::Mat::zeros(size, CV_64FC(channels)),
               cv::Mat::zeros(size, CV_64FC(channels))};
  for (int v = 0; v < w.mean.rows; ++v) {
    const int row = v / DefectReference::kTileBlocks;
    for (int i = 0; i < w.mean.cols * channels; ++i) {
      if (w.variance.ptr<float>(v)[i] < 0) continue;
      const double x = w.mean.ptr<float>(v)[i];
      const int at = i / channels / DefectReference::kTileBlocks * channels + i % channels;
      out.blocks.ptr<double>(row)[at] += 1;
      out.sum.ptr<double>(row)[at] += x;
      out.squares.ptr<double>(row)[at] += x * x;
    }
  }
  return out;
}

void add(TileSums& to, const TileSums& part, double sign) {
  if (to.blocks.empty()) {
    to = {part.blocks.clone(), part.sum.clone(), part.squares.clone()};
    return;
  }
  cv::scaleAdd(part.blocks, sign, to.blocks, to.blocks);
  cv::scaleAdd(part.sum, sign, to.sum, to.sum);
  cv::scaleAdd(part.squares, sign, to.squares, to.squares);
}

/// Mean and deviation per tile; the deviation pooled with the neighbours' and floored.
void reference_of(const TileSums& total, int parts, cv::Mat& mean, cv::Mat& deviation) {
  const int channels = total.sum.channels();
  mean = cv::Mat::zeros(total.sum.size(), CV_32FC(channels));
  cv::Mat variance = cv::Mat::zeros(total.sum.size(), CV_32FC(channels));
  cv::Mat weight = variance.clone();
  for (int v = 0; v < mean.rows; ++v) {
    for (int i = 0; i < mean.cols * channels; ++i) {
      const double n = total.blocks.ptr<double>(v)[i];
      if (n < 0.5) continue;
      const double m = total.sum.ptr<double>(v)[i] / n;
      const double spread = std::max(0.0, total.squares.ptr<double>(v)[i] / n - m * m);
      mean.ptr<float>(v)[i] = static_cast<float>(m);
      variance.ptr<float>(v)[i] =
          static_cast<float>(spread * (parts > 1 ? parts / (parts - 1.0) : 1) * (1 + 1.0 / parts));
      weight.ptr<float>(v)[i] = 1;
    }
  }
  cv::Mat pooled, share;
  cv::boxFilter(variance, pooled, CV_32F, {3, 3}, {-1, -1}, true, cv::BORDER_CONSTANT);
  cv::boxFilter(weight, share, CV_32F, {3, 3}, {-1, -1}, true, cv::BORDER_CONSTANT);
  deviation.create(variance.size(), variance.type());
  const float least = parts < kFewParts ? kUntaughtDeviation : kLeastDeviation;
  for (int v = 0; v < mean.rows; ++v) {
    for (int i = 0; i < mean.cols * channels; ++i) {
      const float s = share.ptr<float>(v)[i], own = variance.ptr<float>(v)[i];
      const float spread = s > 1e-4F ? std::max(pooled.ptr<float>(v)[i] / s, own) : 0.0F;
      const bool seen = weight.ptr<float>(v)[i] > 0;
      deviation.ptr<float>(v)[i] = std::max(std::sqrt(spread), seen ? least : kUntaughtDeviation);
    }
  }
}

DefectReference reference_of(const std::vector<TileSums>& total, int parts) {
  DefectReference out;
  out.parts = parts;
  for (const TileSums& light : total) {
    out.mean.emplace_back();
    out.deviation.emplace_back();
    reference_of(light, parts, out.mean.back(), out.deviation.back());
  }
  return out;
}

void check_same(const std::vector<DefectEvidence>& parts) {
  if (parts.empty()) throw InputError("teaching defects", "no parts", "at least one");
  for (const DefectEvidence& part : parts) {
    bool same = part.lights.size() == parts.front().lights.size();
    for (std::size_t i = 0; same && i < part.lights.size(); ++i) {
      const cv::Mat &a = part.lights[i].residual, &b = parts.front().lights[i].residual;
      same = a.size() == b.size() && a.type() == b.type();
    }
    if (!same) throw InputError("teaching defects", "parts of different sizes", "one station's");
  }
}

}  // namespace

double defect_limit(const std::vector<double>& maxima, double windows, double rate) {
  if (!(rate > 0 && rate < 0.5)) throw InputError("defects", "false-alarm rate", "within (0, 0.5)");
  const double gaussian = normal_quantile_above(rate / (2 * std::max(1.0, windows)));
  if (maxima.size() < kFewMaxima) return kFewMargin * gaussian;
  const Gumbel fit = fit_gumbel(maxima);
  return std::max(gaussian, fit.location + predictive_reach(maxima.size(), rate) * fit.scale);
}

DefectReference teach_defects(const std::vector<DefectEvidence>& parts, const DefectBlocks& blocks,
                              double rate) {
  check_same(parts);
  const cv::Size window = blocks.span(kDefectWindowsMm[kTaughtWindow]);
  std::vector<std::vector<TileSums>> sums;  // per part, per light
  std::vector<TileSums> total(parts.front().lights.size());
  for (const DefectEvidence& part : parts) {
    sums.emplace_back();
    for (std::size_t light = 0; light < total.size(); ++light) {
      sums.back().push_back(tile_sums(part.lights[light], window));
      add(total[light], sums.back().back(), 1);
    }
  }
  const int n = static_cast<int>(parts.size());
  DefectReference out = reference_of(total, n);
  std::vector<double> maxima;
  for (std::size_t i = 0; n >= kFewMaxima && i < parts.size(); ++i) {
    for (std::size_t light = 0; light < total.size(); ++light)
      add(total[light], sums[i][light], -1);
    maxima.push_back(defect_peak(parts[i], blocks, reference_of(total, n - 1)));
    for (std::size_t light = 0; light < total.size(); ++light)
      add(total[light], sums[i][light], 1);
  }
  out.limit = defect_limit(maxima, independent_windows(parts.front(), blocks), rate);
  return out;
}

double defect_peak(const DefectEvidence& part, const DefectBlocks& blocks,
                   const DefectReference& taught) {
  double peak = 0;
  for (std::size_t light = 0; light < part.lights.size(); ++light) {
    const DefectEvidence::Light& seen = part.lights[light];
    const ExpectedResidual expected = expected_residual(taught, part, light);
    for (const double mm : kDefectWindowsMm) {
      const cv::Mat z = defect_scores(windows_of(seen, blocks.span(mm)), expected);
      peak = std::max(peak, cv::norm(z, cv::NORM_INF));
    }
  }
  return peak;
}

}  // namespace brdfgate
