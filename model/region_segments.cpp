#include "model/region_segments.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "model/region_mixture.hpp"

namespace brdfgate {
namespace {

constexpr int kReach = 3;  ///< cells; a step is looked for between means this far to either side
constexpr double kLeastStep = kTrendDistance / 2;
constexpr double kNoiseSigmas = 5.0;
constexpr std::size_t kMostSegments = 60;

/// Sum over channels.
cv::Mat channel_sum(const cv::Mat& image) {
  if (image.channels() == 1) return image;
  cv::Mat sum;
  cv::transform(image, sum, cv::Mat::ones(1, image.channels(), CV_32F));
  return sum;
}

/// Squared step across each cell along one direction, mean over channels.
cv::Mat squared_step(const cv::Mat& smooth, bool along_x) {
  cv::Mat kernel = cv::Mat::zeros(1, 2 * kReach + 1, CV_32F);
  kernel.at<float>(0) = -1;
  kernel.at<float>(2 * kReach) = 1;
  if (!along_x) kernel = kernel.t();
  cv::Mat step;
  cv::filter2D(smooth, step, CV_32F, kernel, {-1, -1}, 0, cv::BORDER_REPLICATE);
  return channel_sum(step.mul(step)) / smooth.channels();
}

}  // namespace

cv::Mat smooth_segments(const LogImage& image, const cv::Mat& core, int least_cells) {
  cv::Mat smooth;
  cv::blur(image.value, smooth, {3, 3});
  const cv::Mat step = cv::max(squared_step(smooth, true), squared_step(smooth, false));
  // A blurred mean of 3 x 3 means holds about a third of one's variance; a step has two ends.
  const cv::Mat noise = channel_sum(image.variance) * (2.0 / 3.0 / image.value.channels());
  const cv::Mat limit = cv::max(noise * (kNoiseSigmas * kNoiseSigmas), kLeastStep * kLeastStep);

  cv::Mat found;
  cv::Mat stats;
  cv::Mat centroids;
  const int n =
      cv::connectedComponentsWithStats(core & (step <= limit), found, stats, centroids, 4, CV_32S);
  std::vector<std::pair<int, int>> by_area;
  for (int i = 1; i < n; ++i)
    by_area.emplace_back(-stats.at<int>(i, cv::CC_STAT_AREA), i);
  std::sort(by_area.begin(), by_area.end());
  std::vector<int> rank(static_cast<std::size_t>(n), 0);
  for (std::size_t i = 0; i < std::min(by_area.size(), kMostSegments); ++i) {
    if (-by_area[i].first < least_cells) break;
    rank[static_cast<std::size_t>(by_area[i].second)] = static_cast<int>(i) + 1;
  }
  for (int v = 0; v < found.rows; ++v)
    for (int u = 0; u < found.cols; ++u)
      found.at<int>(v, u) = rank[static_cast<std::size_t>(found.at<int>(v, u))];
  return found;
}

}  // namespace brdfgate
