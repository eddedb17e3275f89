#include "model/defect_scores.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "model/error.hpp"

namespace brdfgate {
namespace {

/// Share of a window that must be inside the cluster.
constexpr float kLeastShare = 0.5F;

/// A taught image on tiles, run on smoothly over the blocks.
cv::Mat over_blocks(const cv::Mat& tiles, const cv::Size& size) {
  cv::Mat out(size, tiles.type());
  constexpr int kTile = DefectReference::kTileBlocks;
  cv::Mat large;
  cv::resize(tiles, large, {tiles.cols * kTile, tiles.rows * kTile}, 0, 0, cv::INTER_LINEAR);
  large(cv::Rect({0, 0}, size)).copyTo(out);
  return out;
}

/// Of all channels, by magnitude.
void keep_larger(const cv::Mat& z, cv::Mat1f& largest) {
  const int channels = z.channels();
  for (int v = 0; v < z.rows; ++v) {
    const auto* row = z.ptr<float>(v);
    for (int i = 0; i < z.cols * channels; ++i) {
      float& kept = largest(v, i / channels);
      if (std::abs(row[i]) > std::abs(kept)) kept = row[i];
    }
  }
}

}  // namespace

DefectWindows windows_of(const DefectEvidence::Light& light, const cv::Size& span) {
  DefectWindows w;
  const auto mean = [&span](const cv::Mat& image) {
    cv::Mat out;
    cv::boxFilter(image, out, CV_32F, span, {-1, -1}, true, cv::BORDER_CONSTANT);
    return out;
  };
  w.use = mean(light.use);
  w.mean = mean(light.residual);
  w.variance = mean(light.variance);
  const int channels = w.mean.channels();
  const auto blocks = static_cast<float>(span.area());
  for (int v = 0; v < w.use.rows; ++v) {
    const auto* share = w.use.ptr<float>(v);
    const auto* here = light.use.ptr<float>(v);
    const auto* floor = light.floor.ptr<float>(v);
    auto* m = w.mean.ptr<float>(v);
    auto* var = w.variance.ptr<float>(v);
    for (int i = 0; i < w.use.cols * channels; ++i) {
      const int u = i / channels;
      if (share[u] < kLeastShare || here[u] <= 0) {
        m[i] = 0;
        var[i] = -1;  // not looked at
        continue;
      }
      m[i] /= share[u];
      var[i] = var[i] / (share[u] * share[u] * blocks) + floor[u];
    }
  }
  return w;
}

cv::Size defect_tiles(const cv::Size& blocks) {
  constexpr int kTile = DefectReference::kTileBlocks;
  return {(blocks.width + kTile - 1) / kTile, (blocks.height + kTile - 1) / kTile};
}

ExpectedResidual expected_residual(const DefectReference& taught, const DefectEvidence& part,
                                   std::size_t light) {
  const cv::Mat& like = part.lights.at(light).residual;
  if (taught.parts == 0 || light >= taught.mean.size()) {
    return {cv::Mat::zeros(like.size(), like.type()),
            cv::Mat(like.size(), like.type(), cv::Scalar::all(kUntaughtDeviation))};
  }
  const cv::Mat &mean = taught.mean[light], &deviation = taught.deviation[light];
  if (mean.size() != defect_tiles(like.size()) || mean.type() != like.type() ||
      deviation.size() != mean.size() || deviation.type() != like.type()) {
    throw InputError("recipe defects", "images of another station's size", "teach again");
  }
  ExpectedResidual out{over_blocks(mean, like.size()), over_blocks(deviation, like.size())};
  if (!part.elsewhere.empty()) {
    out.mean.setTo(cv::Scalar::all(0), part.elsewhere);
    cv::Mat wide;
    cv::max(out.deviation, cv::Scalar::all(kUntaughtDeviation), wide);
    wide.copyTo(out.deviation, part.elsewhere);
  }
  return out;
}

cv::Mat defect_scores(const DefectWindows& w, const ExpectedResidual& expected) {
  cv::Mat z(w.mean.size(), w.mean.type());
  const int n = z.cols * z.channels();
  for (int v = 0; v < z.rows; ++v) {
    const auto* m = w.mean.ptr<float>(v);
    const auto* var = w.variance.ptr<float>(v);
    const auto* mean = expected.mean.ptr<float>(v);
    const auto* s = expected.deviation.ptr<float>(v);
    auto* out = z.ptr<float>(v);
    for (int i = 0; i < n; ++i)
      out[i] = var[i] < 0 ? 0.0F : (m[i] - mean[i]) / std::sqrt(s[i] * s[i] + var[i]);
  }
  return z;
}

std::vector<cv::Mat1f> largest_scores(const DefectEvidence& part, const DefectBlocks& blocks,
                                      const DefectReference& taught) {
  std::vector<cv::Mat1f> out;
  for (std::size_t light = 0; light < part.lights.size(); ++light) {
    const DefectEvidence::Light& seen = part.lights[light];
    const ExpectedResidual expected = expected_residual(taught, part, light);
    cv::Mat1f& largest = out.emplace_back(seen.residual.size(), 0.0F);
    for (const double mm : kDefectWindowsMm)
      keep_larger(defect_scores(windows_of(seen, blocks.span(mm)), expected), largest);
    largest.setTo(std::numeric_limits<float>::quiet_NaN(), seen.use == 0);
  }
  return out;
}

double independent_windows(const DefectEvidence& part, const DefectBlocks& blocks) {
  double area_mm2 = 0;
  for (int v = 0; v < part.home.rows; ++v) {
    for (int u = 0; u < part.home.cols; ++u) {
      if (part.home.at<unsigned char>(v, u) < 8) area_mm2 += 1e6 * blocks.area_m2().at<float>(v, u);
    }
  }
  double windows = 0;
  for (const double mm : kDefectWindowsMm)
    windows += area_mm2 / (mm * mm);
  const double images = part.lights.empty()
                            ? 1
                            : double(part.lights.size()) * part.lights.front().residual.channels();
  return std::max(1.0, windows * images);
}

}  // namespace brdfgate
