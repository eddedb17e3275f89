// Cells of one material averaged into the station's bins, in linear reflectance.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>

#include "model/error.hpp"
#include "model/log_image.hpp"
#include "model/posed_view.hpp"
#include "model/regions.hpp"

namespace brdfgate {
namespace {

struct BinSum {
  int pixels = 0;
  bool clipped = false;
  Eigen::Array3d f = Eigen::Array3d::Zero();
  Eigen::Array3d variance = Eigen::Array3d::Zero();
  double theta_h = 0;
  double theta_d = 0;
  double phi_d = 0;  ///< from the bin's mean angle, so that 0 and pi are the same
};

/// Index of the cluster that each cell is averaged into, kNotPart for none: labels without the
/// margin along every other label.
cv::Mat inner_labels(const cv::Mat& label, int margin) {
  if (margin <= 0) return label;
  const int side = 2 * margin + 1;
  const cv::Mat square = cv::getStructuringElement(cv::MORPH_RECT, {side, side});
  cv::Mat least;
  cv::Mat most;
  cv::erode(label, least, square);
  cv::dilate(label, most, square);
  cv::Mat out(label.size(), CV_8UC1, cv::Scalar(kNotPart));
  label.copyTo(out, least == most);
  return out;
}

/// phi - reference in [-pi/2, pi/2), by reciprocity.
double phi_from(double phi, double reference) {
  const double d = phi - reference;
  if (d >= std::numbers::pi / 2) return d - std::numbers::pi;
  return d < -std::numbers::pi / 2 ? d + std::numbers::pi : d;
}

/// What one cell contributes to which bin.
struct SeenCell {
  int bin = -1;    ///< none
  float gain = 1;  ///< multiplies its reflectance
  cv::Vec3f angles;
};

/// Cells of one light as taught: bins and angles are in the map.
class TaughtCells {
 public:
  TaughtCells(const StationMap& map, std::size_t light)
      : id_(map.bins.id[light]), angles_(map.cells.angles[light]) {}
  SeenCell operator()(int v, int u) const {
    return {id_.ptr<int>(v)[u], 1.0F, angles_.ptr<cv::Vec3f>(v)[u]};
  }

 private:
  const cv::Mat& id_;
  const cv::Mat& angles_;
};

/// Cells of one light on a part in another pose.
class PosedCells {
 public:
  PosedCells(const StationMap& map, std::size_t light, const PosedPart& part)
      : map_(map), light_(light), view_(part.taught, light, part.pose) {}
  SeenCell operator()(int v, int u) const {
    if (map_.bins.id[light_].ptr<int>(v)[u] < 0) return {};
    const PosedView::Seen seen = view_.see(map_.cells.position_m.ptr<cv::Vec2f>(v)[u]);
    if (!seen.above) return {};
    return {map_.bins.find(light_, seen.angles), seen.gain, seen.angles};
  }

 private:
  const StationMap& map_;
  std::size_t light_;
  PosedView view_;
};

void add_cell(BinSum& s, const SeenCell& cell, double reference_phi, const float* f,
              const float* variance, int channels) {
  ++s.pixels;
  for (int c = 0; c < channels; ++c) {
    s.f[c] += cell.gain * f[c];
    s.variance[c] += cell.gain * cell.gain * variance[c];
  }
  s.theta_h += cell.angles[0];
  s.theta_d += cell.angles[1];
  s.phi_d += phi_from(cell.angles[2], reference_phi);
}

using BinSums = std::vector<BinSum>;  ///< clusters x bins, cluster after cluster

/// What is the same for all cells of one light.
struct LightInput {
  const Reflectance& r;
  const BinMap& bins;
  const cv::Mat& label;
  int clusters;
};

template <class Cells>
void sum_rows(const LightInput& in, const Cells& cells, const cv::Range& rows, BinSums& sums) {
  const auto bins = static_cast<std::size_t>(in.bins.bins());
  const int channels = in.r.value.channels();
  for (int v = rows.start; v < rows.end; ++v) {
    const auto* cluster = in.label.ptr<unsigned char>(v);
    const auto* mask = in.r.mask.ptr<unsigned char>(v);
    const auto* f = in.r.value.ptr<float>(v);
    const auto* variance = in.r.variance.ptr<float>(v);
    for (int u = 0; u < in.label.cols; ++u) {
      if (cluster[u] >= in.clusters || (mask[u] & kInvalid)) continue;
      const SeenCell cell = cells(v, u);
      if (cell.bin < 0) continue;
      const auto bin = static_cast<std::size_t>(cell.bin);
      BinSum& s = sums[cluster[u] * bins + bin];
      s.clipped = s.clipped || (mask[u] & kClipped);
      const int first = u * channels;
      add_cell(s, cell, in.bins.mean_angles[bin].phi_d, f + first, variance + first, channels);
    }
  }
}

void add_sum(const BinSum& part, BinSum& s) {
  s.pixels += part.pixels;
  s.clipped = s.clipped || part.clipped;
  s.f += part.f;
  s.variance += part.variance;
  s.theta_h += part.theta_h;
  s.theta_d += part.theta_d;
  s.phi_d += part.phi_d;
}

/// Stripes of the image are summed at once and added up in one order, so that the result does not
/// depend on how many processors there are.
constexpr int kStripes = 8;

template <class Cells>
BinSums sum_light(const LightInput& in, const Cells& cells) {
  const auto size =
      static_cast<std::size_t>(in.clusters) * static_cast<std::size_t>(in.bins.bins());
  std::vector<BinSums> stripes(kStripes, BinSums(size));
  cv::parallel_for_(cv::Range(0, kStripes), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) {
      const cv::Range rows(in.label.rows * i / kStripes, in.label.rows * (i + 1) / kStripes);
      sum_rows(in, cells, rows, stripes[static_cast<std::size_t>(i)]);
    }
  });
  for (int i = 1; i < kStripes; ++i) {
    for (std::size_t j = 0; j < size; ++j)
      add_sum(stripes[static_cast<std::size_t>(i)][j], stripes[0][j]);
  }
  return std::move(stripes[0]);
}

Bin to_bin(const BinSum& s, int id, const BinMap& map) {
  const double n = s.pixels;
  Bin bin;
  bin.id = id;
  bin.light = map.light[static_cast<std::size_t>(id)];
  bin.pixels = s.pixels;
  bin.f = (s.f / n).max(0.0);
  bin.variance = s.variance / (n * n);
  bin.angles.theta_h = s.theta_h / n;
  bin.angles.theta_d = s.theta_d / n;
  double phi = map.mean_angles[static_cast<std::size_t>(id)].phi_d + s.phi_d / n;
  if (phi < 0) phi += std::numbers::pi;
  if (phi >= std::numbers::pi) phi -= std::numbers::pi;
  bin.angles.phi_d = phi;
  return bin;
}

void check(const std::vector<Reflectance>& r, const StationMap& map, const Regions& regions) {
  diffuse_light(r);  // checks the images
  if (map.bins.id.size() < r.size() || map.cells.angles.size() < r.size()) {
    throw InputError("bins", std::to_string(map.bins.id.size()) + " lights in the station's map",
                     "the reflectance's " + std::to_string(r.size()));
  }
  for (std::size_t light = 0; light < r.size(); ++light) {
    const cv::Size size = r[light].value.size();
    if (regions.label.size() != size || map.bins.id[light].size() != size) {
      throw InputError("bins", "labels, bins and reflectance of different sizes", "one size");
    }
  }
}

/// @param cells_of  the light's cells, by its index
template <class CellsOf>
std::vector<BinnedSamples> bin_labels(const std::vector<Reflectance>& r, const BinMap& map,
                                      const Regions& labels, int min_pixels,
                                      const CellsOf& cells_of) {
  std::vector<BinnedSamples> out(static_cast<std::size_t>(labels.clusters));
  for (BinnedSamples& samples : out)
    samples.channels = r.front().value.channels();
  const int bins = map.bins();
  for (std::size_t light = 0; light < r.size(); ++light) {
    const BinSums sums = sum_light({r[light], map, labels.label, labels.clusters}, cells_of(light));
    for (std::size_t i = 0; i < sums.size(); ++i) {
      if (sums[i].clipped || sums[i].pixels < std::max(1, min_pixels)) continue;
      const auto cluster = i / static_cast<std::size_t>(bins);
      const auto id = static_cast<int>(i % static_cast<std::size_t>(bins));
      out[cluster].bins.push_back(to_bin(sums[i], id, map));
    }
  }
  return out;
}

/// The clusters' labels without the margin along every other label.
Regions inner_regions(const Regions& regions, const BinningOptions& options) {
  return {inner_labels(regions.label, options.margin_cells), regions.clusters, regions.coverage};
}

}  // namespace

std::vector<BinnedSamples> bin_all(const std::vector<Reflectance>& r, const StationMap& map,
                                   const Regions& regions, const BinningOptions& options) {
  check(r, map, regions);
  return bin_labels(r, map.bins, inner_regions(regions, options), options.min_pixels,
                    [&](std::size_t light) { return TaughtCells(map, light); });
}

std::vector<BinnedSamples> bin_all(const std::vector<Reflectance>& r, const StationMap& map,
                                   const Regions& regions, const PosedPart& part,
                                   const BinningOptions& options) {
  check(r, map, regions);
  if (map.bins.trees.size() < r.size() || part.taught.lights_W.size() < r.size()) {
    throw InputError("bins", std::to_string(map.bins.trees.size()) + " lights' trees",
                     "one for each of the " + std::to_string(r.size()) + " lights");
  }
  return bin_labels(r, map.bins, inner_regions(regions, options), options.min_pixels,
                    [&](std::size_t light) { return PosedCells(map, light, part); });
}

BinnedSamples bin_samples(const std::vector<Reflectance>& r, const StationMap& map,
                          const Regions& regions, int cluster, const BinningOptions& options) {
  check(r, map, regions);
  if (cluster < 0 || cluster >= regions.clusters) {
    throw InputError("cluster", std::to_string(cluster),
                     "0 to " + std::to_string(regions.clusters - 1));
  }
  // Cells whose whole neighbourhood is the cluster's, by definition rather than by bin_all's route.
  cv::Mat inner = regions.label == cluster;
  const int side = 2 * std::max(0, options.margin_cells) + 1;
  cv::erode(inner, inner, cv::getStructuringElement(cv::MORPH_RECT, {side, side}));
  cv::Mat label(inner.size(), CV_8UC1, cv::Scalar(kNotPart));
  label.setTo(0, inner);
  return bin_labels(r, map.bins, {label, 1, regions.coverage}, options.min_pixels,
                    [&](std::size_t light) { return TaughtCells(map, light); })
      .front();
}

}  // namespace brdfgate
