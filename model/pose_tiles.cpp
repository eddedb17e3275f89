// Image tiles of a cluster: what a part's pose is estimated from.
#include <opencv2/imgproc.hpp>

#include "model/pose_estimate.hpp"

namespace brdfgate {
namespace {

/// As many tiles side by side cover the image's width under the light of the mirror direction, and
/// under any other light: at 25 degrees of view half a degree and two of the surface's normal.
constexpr int kTilesAcross[] = {44, 11};

struct Tiling {
  cv::Size size;
  cv::Mat share;  ///< CV_32F, share of good cells
};

/// Mean over a tile's good cells: the mean of the masked image over that of the mask.
cv::Mat tile_means(const cv::Mat& image, const cv::Mat& good, const Tiling& tiling) {
  cv::Mat masked = cv::Mat::zeros(image.size(), image.type());
  image.copyTo(masked, good);
  cv::Mat small;
  cv::resize(masked, small, tiling.size, 0, 0, cv::INTER_AREA);
  return small;
}

Tiling tile(const cv::Mat& good, int across) {
  Tiling tiling;
  const int side = std::max(1, good.cols / across);
  tiling.size = {std::max(1, good.cols / side), std::max(1, good.rows / side)};
  cv::Mat ones;
  good.convertTo(ones, CV_32F, 1.0 / 255);
  cv::resize(ones, tiling.share, tiling.size, 0, 0, cv::INTER_AREA);
  return tiling;
}

struct Tiles {
  std::vector<Eigen::Vector2d> position;
  std::vector<Eigen::Array3d> f;
};

Tiles tiles_of(const Reflectance& r, const CellGeometry& cells, const cv::Mat& in_cluster,
               int across) {
  const cv::Mat good = in_cluster & ((r.mask & kInvalid) == 0);
  const Tiling tiling = tile(good, across);
  const cv::Mat value = tile_means(r.value, good, tiling);
  const cv::Mat position = tile_means(cells.position_m, good, tiling);
  Tiles out;
  const int channels = value.channels();
  for (int v = 0; v < tiling.size.height; ++v) {
    for (int u = 0; u < tiling.size.width; ++u) {
      const float share = tiling.share.at<float>(v, u);
      if (share < 0.5F) continue;
      const auto& p = position.at<cv::Vec2f>(v, u);
      out.position.emplace_back(p[0] / share, p[1] / share);
      Eigen::Array3d f = Eigen::Array3d::Zero();
      for (int c = 0; c < channels; ++c)
        f[c] = std::max(0.0F, value.ptr<float>(v)[u * channels + c] / share);
      out.f.push_back(f);
    }
  }
  return out;
}

}  // namespace

PoseSamples pose_samples(const std::vector<Reflectance>& r, const StationGeometry& geometry,
                         const CellGeometry& cells, const cv::Mat& in_cluster) {
  PoseSamples samples;
  std::vector<Eigen::Array3d> values;
  for (std::size_t light = 0; light < r.size(); ++light) {
    const Tiles tiles = tiles_of(r[light], cells, in_cluster, kTilesAcross[light == 0 ? 0 : 1]);
    Eigen::Vector4d light_W;
    light_W << geometry.lights_W[light], 1;
    for (const Eigen::Vector2d& p : tiles.position)
      samples.lines.push_back({geometry.camera.position(), {p.x(), p.y(), 0}, light_W});
    values.insert(values.end(), tiles.f.begin(), tiles.f.end());
  }
  const int channels = r.empty() ? 0 : r.front().value.channels();
  samples.f.resize(static_cast<Eigen::Index>(values.size()), channels);
  for (std::size_t j = 0; j < values.size(); ++j)
    samples.f.row(static_cast<Eigen::Index>(j)) = values[j].head(channels).matrix().transpose();
  return samples;
}

}  // namespace brdfgate
