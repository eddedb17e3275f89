// Blocks of cells, and a part's residuals on them.
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "model/error.hpp"
#include "model/local_defects.hpp"
#include "model/log_image.hpp"
#include "model/parallel.hpp"

namespace brdfgate {
namespace {

/// Area of the plane that a block is to cover, m^2: a defect of 1 mm^2 is three of them.
constexpr double kBlockArea = 0.35e-6;
/// Cells along the part's border that are not looked at, and along those between clusters in which
/// a block may be a mixture: the optics mix them, and labels err.
constexpr int kBorderCells = 3;
/// Cells along a border between clusters that are not looked at: the colours of a mosaic, and of a
/// lens, look at places a fraction of a cell apart, and mix the materials in shares of their own.
constexpr int kMixedCells = 1;
/// A block near a border that has less of either material is left out too.
constexpr double kLeastShareOfOne = 0.95;
/// By how much a cell's colours may differ in that share all the same, where labels err by more: a
/// mosaic's look half a cell apart.
constexpr double kColourShareSigma = 0.3;
/// How firmly a mixture's two shares are held to a sum of 1, and, where the materials look alike,
/// to each other: against the sum of squared relative errors over the channels.
constexpr double kWholeWeight = 0.01, kAlikeWeight = 0.0025;
constexpr int kMostClusters = 8;
/// Window of the part's own slow departure: several times the largest defect window.
constexpr double kBackgroundMm = 14;
/// Residuals beyond so many robust deviations do not pull the background.
constexpr float kRobustSigmas = 3.0F;
/// What the estimate of the pose leaves open (docs/accuracy.md: 0.02 to 0.04 deg on glossy parts).
constexpr double kPoseSigma = 0.03 * EIGEN_PI / 180;

/// Area of the plane that one cell sees, m^2.
double cell_area(const cv::Mat& position, int v, int u) {
  const auto step = [&position](int v0, int u0, int v1, int u1) -> cv::Vec2d {
    return cv::Vec2d(position.at<cv::Vec2f>(v1, u1)) - cv::Vec2d(position.at<cv::Vec2f>(v0, u0));
  };
  const int u0 = std::max(u - 1, 0), u1 = std::min(u + 1, position.cols - 1);
  const int v0 = std::max(v - 1, 0), v1 = std::min(v + 1, position.rows - 1);
  const cv::Vec2d a = step(v, u0, v, u1) / std::max(1, u1 - u0);
  const cv::Vec2d b = step(v0, u, v1, u) / std::max(1, v1 - v0);
  return std::abs(a[0] * b[1] - a[1] * b[0]);
}

/// Clusters of each cell's surroundings, `reach` cells every way, as bits.
cv::Mat clusters_around(const cv::Mat& home, int reach) {
  const cv::Mat square = cv::getStructuringElement(cv::MORPH_RECT, {2 * reach + 1, 2 * reach + 1});
  cv::Mat around = cv::Mat::zeros(home.size(), CV_8UC1), near;
  for (int k = 0; k < kMostClusters; ++k) {
    const cv::Mat own = home == k;
    if (cv::countNonZero(own) == 0) continue;
    cv::dilate(own, near, square);
    around |= near & cv::Scalar(1 << k);
  }
  return around;
}

/// The same within kBorderCells; 0 where something that is in no cluster lies there, or another
/// cluster within kMixedCells.
cv::Mat clear_clusters_around(const cv::Mat& home) {
  cv::Mat around = clusters_around(home, kBorderCells);
  const cv::Mat close = clusters_around(home, kMixedCells);
  constexpr int kSide = 2 * kBorderCells + 1;
  cv::Mat off;
  cv::dilate(home >= kMostClusters, off, cv::getStructuringElement(cv::MORPH_RECT, {kSide, kSide}));
  around.setTo(0, off | ((close & (close - 1)) != 0));
  return around;
}

/// The one or two clusters that a block sees; `beside` is kNotPart where it is one, both where it
/// is none or more.
struct BlockClusters {
  cv::Mat home;    ///< CV_8UC1
  cv::Mat beside;  ///< CV_8UC1
};

BlockClusters block_clusters(const cv::Mat& home, const DefectBlocks& blocks) {
  const cv::Mat around = clear_clusters_around(home);
  const cv::Mat none(blocks.size(), CV_8UC1, cv::Scalar(kNotPart));
  BlockClusters out{none.clone(), none.clone()};
  const int n = blocks.side();
  for (int v = 0; v < none.rows; ++v) {
    for (int u = 0; u < none.cols; ++u) {
      unsigned seen = 0;
      bool whole = true;
      for (int y = v * n; y < (v + 1) * n; ++y) {
        const auto* row = around.ptr<unsigned char>(y) + std::ptrdiff_t{u} * n;
        for (int x = 0; x < n; ++x) {
          seen |= row[x];
          whole = whole && row[x] != 0;
        }
      }
      if (!whole || std::popcount(seen) > 2) continue;
      const int first = std::countr_zero(seen);
      out.home.at<unsigned char>(v, u) = static_cast<unsigned char>(first);
      if (std::popcount(seen) < 2) continue;
      out.beside.at<unsigned char>(v, u) =
          static_cast<unsigned char>(std::countr_zero(seen & (seen - 1)));
    }
  }
  return out;
}

/// Mean over a block's cells; false where one of them is masked.
template <int Channels>
bool block_mean(const Reflectance& r, const cv::Rect& cells, std::array<float, 3>& value,
                std::array<float, 3>& variance) {
  value.fill(0);
  variance.fill(0);
  for (int v = cells.y; v < cells.y + cells.height; ++v) {
    const auto* mask = r.mask.ptr<unsigned char>(v) + cells.x;
    const auto* f = r.value.ptr<float>(v) + cells.x * Channels;
    const auto* var = r.variance.ptr<float>(v) + cells.x * Channels;
    for (int u = 0; u < cells.width; ++u) {
      if ((mask[u] & kInvalid) != 0) return false;
      for (int c = 0; c < Channels; ++c) {
        value[c] += f[u * Channels + c];
        variance[c] += var[u * Channels + c];
      }
    }
  }
  const auto n = static_cast<float>(cells.area());
  for (int c = 0; c < Channels; ++c) {
    value[c] /= n;
    variance[c] /= n * n;
  }
  return true;
}

/// Blocks that show another cluster than the taught parts do.
cv::Mat taught_elsewhere(const cv::Mat& home, const BlockClusters& taught) {
  const cv::Mat same = (taught.home == home) | (taught.beside == home);
  return (home < kMostClusters) & (same == 0);
}

float floored_log(double f) {
  return static_cast<float>(std::log(std::max(f, 0.0) + kLogFloor));
}

/// A part's residuals against its materials, or, along a border, against a mixture of the two
/// materials there: of a little of the other one, which nothing else tells.
class Residuals {
 public:
  Residuals(const std::vector<Reflectance>& r, const DefectBlocks& blocks, const PartPose& pose,
            const std::vector<BrdfPtr>& materials)
      : r_(r), blocks_(blocks), pose_(pose), materials_(materials) {}

  /// Fills lights and home.
  void fill(DefectEvidence& out, const BlockClusters& clusters) const {
    const int channels = r_.front().value.channels();
    const cv::Size size = blocks_.size();
    out.home = cv::Mat(size, CV_8UC1, cv::Scalar(kNotPart));
    for (std::size_t light = 0; light < r_.size(); ++light) {
      out.lights.push_back({cv::Mat::zeros(size, CV_32FC(channels)),
                            cv::Mat::zeros(size, CV_32FC(channels)), cv::Mat::zeros(size, CV_32FC1),
                            cv::Mat::zeros(size, CV_32FC1)});
    }
    parallel_for_each(size.height, [&](int v) {
      for (int u = 0; u < size.width; ++u) {
        const int home = clusters.home.at<unsigned char>(v, u);
        const int beside = clusters.beside.at<unsigned char>(v, u);
        if (!known(home) || (beside != kNotPart && !known(beside))) continue;
        fill_block(out, {u, v}, home, beside);
      }
    });
  }

 private:
  /// A block under one light.
  struct Seen {
    bool valid = false;
    Rgb f = Rgb::Zero();         ///< as the part's pose has it
    Rgb variance = Rgb::Zero();  ///< of that
    HalfDiff angles;
  };
  /// Materials at a border; `second` only there, in the share 1 - `share`.
  struct Mixture {
    const Brdf& first;
    const Brdf* second = nullptr;
    double share = 1;

    Rgb eval(const HalfDiff& angles) const {
      const Rgb f = first.eval(angles);
      return second == nullptr ? f : Rgb(share * f + (1 - share) * second->eval(angles));
    }
    /// What an error of the share makes of that.
    Rgb open(const HalfDiff& angles, double error) const {
      if (second == nullptr) return Rgb::Zero();
      return error * (first.eval(angles) - second->eval(angles));
    }
  };

  bool known(int cluster) const {
    return cluster < std::ssize(materials_) && materials_[std::size_t(cluster)] != nullptr;
  }

  Seen see(std::size_t light, const cv::Point& at) const {
    const Reflectance& r = r_[light];
    const int n = blocks_.side();
    const cv::Rect cells(at.x * n, at.y * n, n, n);
    std::array<float, 3> f{}, variance{};
    Seen out;
    out.valid = r.value.channels() == 1 ? block_mean<1>(r, cells, f, variance)
                                        : block_mean<3>(r, cells, f, variance);
    const Sightline sight = blocks_.sightline(light, at);
    out.angles = sight.angles(pose_);
    const double gain =
        pose_.none() ? 1 : sight.irradiance(PartPose{}) / std::max(1e-12, sight.irradiance(pose_));
    out.f = gain * Rgb(f[0], f[1], f[2]);
    out.variance = gain * gain * Rgb(variance[0], variance[1], variance[2]);
    return out;
  }

  /// Share of the first of two materials in what the diffuse light shows, p a + q b by least
  /// squares of the relative error: a stain darkens both, so that p + q is held near 1 only weakly,
  /// for materials whose mixtures differ in nothing else.
  double share_of_first(const Seen& diffuse, const Brdf& first, const Brdf& second) const {
    const Rgb a = first.eval(diffuse.angles), b = second.eval(diffuse.angles);
    Eigen::Matrix2d normal = Eigen::Matrix2d::Constant(kWholeWeight);
    Eigen::Vector2d right = Eigen::Vector2d::Constant(kWholeWeight);
    for (int c = 0; c < r_.front().value.channels(); ++c) {
      const double level = (a[c] + b[c]) / 2 + kLogFloor;
      const Eigen::Vector2d row = Eigen::Vector2d(a[c], b[c]) / level;
      normal += row * row.transpose();
      right += row * diffuse.f[c] / level;
    }
    normal.diagonal().array() += kAlikeWeight;
    const Eigen::Vector2d parts = (normal.inverse() * right).cwiseMax(0);
    return parts.sum() > 0 ? parts[0] / parts.sum() : 0.5;
  }

  void fill_block(DefectEvidence& out, const cv::Point& at, int home, int beside) const {
    std::vector<Seen> seen;
    for (std::size_t light = 0; light < r_.size(); ++light)
      seen.push_back(see(light, at));
    Mixture mixture{*materials_[std::size_t(home)]};
    if (beside != kNotPart) {
      mixture.second = materials_[std::size_t(beside)].get();
      mixture.share = share_of_first(seen[std::min<std::size_t>(1, seen.size() - 1)], mixture.first,
                                     *mixture.second);
      if (std::max(mixture.share, 1 - mixture.share) < kLeastShareOfOne) return;
    }
    out.home.at<unsigned char>(at) =
        static_cast<unsigned char>(mixture.share < 0.5 ? beside : home);
    for (std::size_t light = 0; light < r_.size(); ++light)
      if (seen[light].valid) fill_light(out.lights[light], at, seen[light], mixture);
  }

  void fill_light(DefectEvidence::Light& out, const cv::Point& at, const Seen& seen,
                  const Mixture& mixture) const {
    const int channels = out.residual.channels();
    const Rgb expected = mixture.eval(seen.angles);
    const Rgb open = mixture.open(seen.angles, kColourShareSigma / blocks_.side());
    auto* d = out.residual.ptr<float>(at.y) + std::ptrdiff_t{at.x} * channels;
    auto* var = out.variance.ptr<float>(at.y) + std::ptrdiff_t{at.x} * channels;
    for (int c = 0; c < channels; ++c) {
      const double level = std::max(seen.f[c], 0.0) + kLogFloor;
      const double share = open[c] / (expected[c] + kLogFloor);
      d[c] = floored_log(seen.f[c]) - floored_log(expected[c]);
      var[c] = static_cast<float>(seen.variance[c] / (level * level) + share * share);
    }
    out.use.at<float>(at) = 1;
    HalfDiff beside = seen.angles;
    beside.theta_h += kPoseSigma;
    const float slope = floored_log(mixture.eval(beside).mean()) - floored_log(expected.mean());
    out.floor.at<float>(at) = slope * slope;
  }

  const std::vector<Reflectance>& r_;
  const DefectBlocks& blocks_;
  const PartPose& pose_;
  const std::vector<BrdfPtr>& materials_;
};

/// Window means over the blocks that count; 0 where none does.
cv::Mat masked_mean(const cv::Mat& image, const cv::Mat& use, const cv::Size& window) {
  cv::Mat weight, mean;
  cv::boxFilter(use, weight, CV_32F, window, {-1, -1}, true, cv::BORDER_CONSTANT);
  cv::boxFilter(image, mean, CV_32F, window, {-1, -1}, true, cv::BORDER_CONSTANT);
  const int channels = image.channels();
  for (int v = 0; v < mean.rows; ++v) {
    const auto* w = weight.ptr<float>(v);
    auto* m = mean.ptr<float>(v);
    for (int i = 0; i < mean.cols * channels; ++i) {
      const float share = w[i / channels];
      m[i] = share > 1e-4F ? m[i] / share : 0.0F;
    }
  }
  return mean;
}

/// Median of |x| over 0.6745, of the used blocks: a robust deviation, per channel.
std::array<float, 3> robust_deviation(const cv::Mat& x, const cv::Mat& use) {
  std::array<std::vector<float>, 3> values;
  const int channels = x.channels();
  for (int v = 0; v < x.rows; ++v) {
    const auto* w = use.ptr<float>(v);
    const auto* row = x.ptr<float>(v);
    for (int u = 0; u < x.cols; ++u) {
      if (w[u] <= 0) continue;
      for (int c = 0; c < channels; ++c)
        values[static_cast<std::size_t>(c)].push_back(std::abs(row[u * channels + c]));
    }
  }
  std::array<float, 3> out{};
  for (std::size_t c = 0; c < 3; ++c) {
    if (values[c].empty()) continue;
    const auto middle = values[c].begin() + std::ssize(values[c]) / 2;
    std::nth_element(values[c].begin(), middle, values[c].end());
    out[c] = *middle / 0.6745F;
  }
  return out;
}

/// Replaces what lies more than kRobustSigmas off the mean by that bound.
void clamp_to(cv::Mat& d, const cv::Mat& mean, const std::array<float, 3>& sigma,
              const cv::Mat& use) {
  const int channels = d.channels();
  for (int v = 0; v < d.rows; ++v) {
    const auto* w = use.ptr<float>(v);
    const auto* m = mean.ptr<float>(v);
    auto* x = d.ptr<float>(v);
    for (int i = 0; i < d.cols * channels; ++i) {
      const float reach = kRobustSigmas * sigma[static_cast<std::size_t>(i % channels)];
      x[i] = w[i / channels] > 0 ? std::clamp(x[i], m[i] - reach, m[i] + reach) : 0.0F;
    }
  }
}

/// Takes the cluster's slow departure from its blocks.
void take_background(DefectEvidence::Light& light, const cv::Mat& home, int cluster,
                     const cv::Size& window) {
  cv::Mat use;
  cv::Mat(home == cluster).convertTo(use, CV_32F, 1.0 / 255);
  use = use.mul(light.use);
  if (cv::countNonZero(use) == 0) return;
  const cv::Mat mask = use > 0;
  cv::Mat own = cv::Mat::zeros(light.residual.size(), light.residual.type());
  light.residual.copyTo(own, mask);
  cv::Mat mean = masked_mean(own, use, window);
  constexpr int kRounds = 2;
  for (int round = 0; round < kRounds; ++round) {
    const std::array<float, 3> sigma = robust_deviation(own - mean, use);
    cv::Mat clamped = own.clone();
    clamp_to(clamped, mean, sigma, use);
    mean = masked_mean(clamped, use, window);
  }
  cv::Mat(own - mean).copyTo(light.residual, mask);
}

}  // namespace

DefectBlocks::DefectBlocks(const StationGeometry& geometry, const CellGeometry& cells)
    : geometry_(geometry) {
  const cv::Size all = cells.position_m.size();
  const double at_centre = cell_area(cells.position_m, all.height / 2, all.width / 2);
  side_ = std::max(1, static_cast<int>(std::sqrt(kBlockArea / at_centre)));
  const cv::Size size(all.width / side_, all.height / side_);
  position_m_.create(size, CV_32FC2);
  area_m2_.create(size, CV_32FC1);
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      const cv::Rect block(u * side_, v * side_, side_, side_);
      const cv::Scalar mean = cv::mean(cells.position_m(block));
      position_m_.at<cv::Vec2f>(v, u) = {float(mean[0]), float(mean[1])};
      area_m2_.at<float>(v, u) = static_cast<float>(
          side_ * side_ * cell_area(cells.position_m, block.y + side_ / 2, block.x + side_ / 2));
    }
  }
  const int v = size.height / 2, u = size.width / 2;
  const auto apart = [&](int dv, int du) {
    return cv::norm(position_m_.at<cv::Vec2f>(v, u) - position_m_.at<cv::Vec2f>(v - dv, u - du));
  };
  pitch_m_ = {std::max(1e-6, apart(0, u / 2) / std::max(1, u / 2)),
              std::max(1e-6, apart(v / 2, 0) / std::max(1, v / 2))};
}

cv::Size DefectBlocks::span(double mm) const {
  const auto odd = [mm](double pitch) {
    return 2 * static_cast<int>(std::lround((mm * 1e-3 / pitch - 1) / 2 + 1e-9)) + 1;
  };
  return {std::max(1, odd(pitch_m_[0])), std::max(1, odd(pitch_m_[1]))};
}

Sightline DefectBlocks::sightline(std::size_t light, const cv::Point& block) const {
  const auto p = position_m_.at<cv::Vec2f>(block);
  const Eigen::Vector3d& at = geometry_.lights_W[light];
  return {geometry_.camera.position(), {p[0], p[1], 0}, {at.x(), at.y(), at.z(), 1}};
}

cv::Mat home_labels(const Regions& regions, const cv::Mat& expected) {
  cv::Mat home = regions.label.clone();
  if (!expected.empty()) {
    // Where the part really is: what lies off its outline now stays off.
    expected.copyTo(home, (expected < 8) & (home != kNotPart));
  }
  cv::Mat blobs;
  const int n = cv::connectedComponents(home == kUnknown, blobs, 8, CV_32S);
  if (n <= 1) return home;
  std::vector<std::array<int, 8>> votes(static_cast<std::size_t>(n), std::array<int, 8>{});
  cv::Mat around, as_float;  // of each cell, the highest blob number among itself and neighbours
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

DefectEvidence defect_evidence(const std::vector<Reflectance>& r, const cv::Mat& home,
                               const DefectBlocks& blocks, const PartPose& pose,
                               const std::vector<BrdfPtr>& materials, const cv::Mat& taught) {
  diffuse_light(r);  // checks types and sizes
  if (home.size() != r[0].value.size() || home.type() != CV_8UC1) {
    throw InputError("defects", "labels and reflectance of different sizes", "one size");
  }
  DefectEvidence out;
  Residuals(r, blocks, pose, materials).fill(out, block_clusters(home, blocks));
  for (DefectEvidence::Light& light : out.lights) {
    for (std::size_t k = 0; k < materials.size(); ++k)
      take_background(light, out.home, static_cast<int>(k), blocks.span(kBackgroundMm));
  }
  if (!taught.empty()) out.elsewhere = taught_elsewhere(out.home, block_clusters(taught, blocks));
  return out;
}

}  // namespace brdfgate
