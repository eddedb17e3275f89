#include "model/label_cleaning.hpp"

#include <array>
#include <opencv2/imgproc.hpp>

#include "model/regions.hpp"

namespace brdfgate {
namespace {

/// Cells whose neighbourhood mixes part and fixture: optics blur over about this many.
constexpr int kRimCells = 3;

/// Most frequent label among the settled neighbours of a cell; its own where none is settled.
unsigned char settled_neighbour(const cv::Mat& label, const cv::Mat& settled, int v, int u) {
  std::array<int, 256> votes{};
  unsigned char best = label.at<unsigned char>(v, u);
  int most = 0;
  for (int y = std::max(v - 1, 0); y <= std::min(v + 1, label.rows - 1); ++y) {
    for (int x = std::max(u - 1, 0); x <= std::min(u + 1, label.cols - 1); ++x) {
      if (!settled.at<unsigned char>(y, x)) continue;
      const unsigned char other = label.at<unsigned char>(y, x);
      if (++votes[other] <= most) continue;
      most = votes[other];
      best = other;
    }
  }
  return best;
}

}  // namespace

cv::Mat majority(const cv::Mat& label, int clusters) {
  if (clusters < 2) return label.clone();
  cv::Mat winner = label.clone();
  cv::Mat most = cv::Mat::zeros(label.size(), CV_8UC1);
  cv::Mat count;
  for (int k = 0; k < clusters; ++k) {
    const cv::Mat own = label == k;
    cv::boxFilter(own & cv::Scalar(1), count, CV_8U, {kMajorityWindow, kMajorityWindow}, {-1, -1},
                  false, cv::BORDER_CONSTANT);
    winner.setTo(k, count > most);
    cv::max(most, count, most);
  }
  winner.setTo(kNotPart, label == kNotPart);
  return winner;
}

void relabel_rim(cv::Mat& label, int rim) {
  const cv::Mat part = label != kNotPart;
  std::vector<cv::Mat> inside{part};  // shrunk by 0, 1, ... cells
  for (int i = 0; i < rim; ++i) {
    inside.emplace_back();
    cv::erode(inside[static_cast<std::size_t>(i)], inside.back(), cv::Mat());
  }
  for (int i = rim; i > 0; --i) {
    cv::Mat settled = inside[static_cast<std::size_t>(i)].clone();
    cv::Mat ring = inside[static_cast<std::size_t>(i) - 1] & ~settled;
    // Corners touch no settled cell at first: they follow once their neighbours are settled.
    for (int round = 0; round < 3; ++round) {
      cv::Mat reached;
      cv::dilate(settled, reached, cv::Mat());
      reached &= ring;
      std::vector<cv::Point> cells;
      cv::findNonZero(reached, cells);
      for (const cv::Point& c : cells)
        label.at<unsigned char>(c) = settled_neighbour(label, settled, c.y, c.x);
      settled |= reached;
      ring &= ~reached;
    }
  }
}

cv::Mat clean_labels(const cv::Mat& nearest, const cv::Mat& far, int clusters) {
  cv::Mat label = majority(nearest, clusters);
  relabel_rim(label, kRimCells);
  cv::Mat unknown;
  const cv::Mat square = cv::getStructuringElement(cv::MORPH_RECT, {kUnknownSide, kUnknownSide});
  cv::morphologyEx(far & (nearest != kNotPart), unknown, cv::MORPH_OPEN, square);
  label.setTo(kUnknown, unknown);
  return label;
}

}  // namespace brdfgate
