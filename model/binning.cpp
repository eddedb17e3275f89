// Cells of one material averaged into the station's bins, in linear reflectance.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <string>

#include "model/error.hpp"
#include "model/log_image.hpp"
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

void add_cell(BinSum& s, const cv::Vec3f& angles, double reference_phi, const float* f,
              const float* variance, int channels) {
  ++s.pixels;
  for (int c = 0; c < channels; ++c) {
    s.f[c] += f[c];
    s.variance[c] += variance[c];
  }
  s.theta_h += angles[0];
  s.theta_d += angles[1];
  s.phi_d += phi_from(angles[2], reference_phi);
}

/// Sums of one light: clusters x bins, cluster after cluster.
std::vector<BinSum> sum_light(const Reflectance& r, const StationMap& map, std::size_t light,
                              const cv::Mat& label, int clusters) {
  const int bins = map.bins.bins();
  const int channels = r.value.channels();
  std::vector<BinSum> sums(static_cast<std::size_t>(clusters) * static_cast<std::size_t>(bins));
  for (int v = 0; v < label.rows; ++v) {
    const auto* cluster = label.ptr<unsigned char>(v);
    const auto* id = map.bins.id[light].ptr<int>(v);
    const auto* mask = r.mask.ptr<unsigned char>(v);
    const auto* f = r.value.ptr<float>(v);
    const auto* variance = r.variance.ptr<float>(v);
    const auto* angles = map.cells.angles[light].ptr<cv::Vec3f>(v);
    for (int u = 0; u < label.cols; ++u) {
      if (cluster[u] >= clusters || id[u] < 0 || (mask[u] & kInvalid)) continue;
      const auto bin = static_cast<std::size_t>(id[u]);
      BinSum& s = sums[static_cast<std::size_t>(cluster[u]) * static_cast<std::size_t>(bins) + bin];
      s.clipped = s.clipped || (mask[u] & kClipped);
      const int first = u * channels;
      add_cell(s, angles[u], map.bins.mean_angles[bin].phi_d, f + first, variance + first,
               channels);
    }
  }
  return sums;
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

std::vector<BinnedSamples> bin_labels(const std::vector<Reflectance>& r, const StationMap& map,
                                      const cv::Mat& label, int clusters, int min_pixels) {
  std::vector<BinnedSamples> out(static_cast<std::size_t>(clusters));
  for (BinnedSamples& samples : out)
    samples.channels = r.front().value.channels();
  const int bins = map.bins.bins();
  for (std::size_t light = 0; light < r.size(); ++light) {
    const std::vector<BinSum> sums = sum_light(r[light], map, light, label, clusters);
    for (std::size_t i = 0; i < sums.size(); ++i) {
      if (sums[i].clipped || sums[i].pixels < std::max(1, min_pixels)) continue;
      const auto cluster = i / static_cast<std::size_t>(bins);
      const auto id = static_cast<int>(i % static_cast<std::size_t>(bins));
      out[cluster].bins.push_back(to_bin(sums[i], id, map.bins));
    }
  }
  return out;
}

}  // namespace

std::vector<BinnedSamples> bin_all(const std::vector<Reflectance>& r, const StationMap& map,
                                   const Regions& regions, const BinningOptions& options) {
  check(r, map, regions);
  return bin_labels(r, map, inner_labels(regions.label, options.margin_cells), regions.clusters,
                    options.min_pixels);
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
  return bin_labels(r, map, label, 1, options.min_pixels).front();
}

}  // namespace brdfgate
