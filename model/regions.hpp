// Which cells show which material (thesis, C.VI section 8; method.md section 7).
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "model/geometry.hpp"
#include "model/pose.hpp"
#include "model/reflectance.hpp"
#include "model/samples.hpp"

namespace brdfgate {

inline constexpr unsigned char kUnknown = 254;  ///< part, but none of the taught materials
inline constexpr unsigned char kNotPart = 255;  ///< fixture or outside the inspected region

/// Label per cell: cluster 0..7, kUnknown or kNotPart.
struct Regions {
  cv::Mat label;  ///< CV_8UC1
  int clusters = 0;
  /// Part cells (clusters and unknown) over inspected cells, 0..1.
  double coverage = 0;
};

/// The bare fixture under the part: Lambertian, in a colour that no part has.
struct FixtureAppearance {
  Eigen::Array3d reflectance = Eigen::Array3d::Zero();  ///< albedo per channel
  double tolerance = 0.25;                              ///< relative, per channel and light
};

/// Cells that show the fixture: within tolerance of its Lambertian value in every channel and
/// light.
cv::Mat fixture_cells(const std::vector<Reflectance>& r, const FixtureAppearance& fixture);

/// Finds the materials of an unknown part from light 2's log reflectance (colour and level): a
/// mixture of smooth trends over the image, one per material, their number by the Bayesian
/// information criterion; one is the answer for a plain part. Clusters are ordered by falling area.
/// @param max_clusters 1..8
Regions find_regions(const std::vector<Reflectance>& r, const CellGeometry& cells,
                     const cv::Mat& not_part, int max_clusters);

/// What a taught material looks like in light 2: expected ln f per bin and channel.
struct TaughtAppearance {
  Eigen::ArrayXXd log_f;  ///< bins x channels; NaN in bins of other lights
};
/// Assigns every part cell to the nearest taught cluster, or kUnknown beyond `tolerance` (RMS over
/// channels of ln f) after noise.
/// @param prior  CV_8UC1, the taught label of each cell (expected_labels), or empty: that cluster
///               counts as nearer by kPriorBonus, so that materials that light 2 shows alike are
///               told apart by their place
Regions assign_regions(const std::vector<Reflectance>& r, const BinMap& bins,
                       const cv::Mat& not_part, const std::vector<TaughtAppearance>& taught,
                       double tolerance, const cv::Mat& prior = {});

/// RMS over channels of ln f: under the least distance at which find_regions tells materials apart.
inline constexpr double kPriorBonus = 0.15;

/// Averages a cluster's good cells bin by bin, in linear reflectance, before any logarithm. Cells
/// within `margin_cells` of another label are left out (mixed pixels). Bins with fewer than
/// `min_pixels` are dropped; negative means (pure noise) are held at 0. A bin with a clipped cell
/// is dropped as a whole and cells under the noise floor are used with their value: leaving out
/// only the bright or only the dark cells would bias the mean. Angles are means over the cells
/// used. Throws InputError where sizes, lights or the cluster do not fit each other.
struct BinningOptions {
  int margin_cells = 2;
  int min_pixels = 4;
};
BinnedSamples bin_samples(const std::vector<Reflectance>& r, const StationMap& map,
                          const Regions& regions, int cluster, const BinningOptions& options = {});
/// The same for every cluster in one pass over the cells.
std::vector<BinnedSamples> bin_all(const std::vector<Reflectance>& r, const StationMap& map,
                                   const Regions& regions, const BinningOptions& options = {});

/// A part that lies otherwise than the geometry its reflectance was computed for.
struct PosedPart {
  const StationGeometry& taught;
  PartPose pose;
};
/// The same on the part itself: a cell belongs to the bin of the angles that it sees there, and its
/// reflectance is corrected for the light that the part receives (App. H eq. 20).
std::vector<BinnedSamples> bin_all(const std::vector<Reflectance>& r, const StationMap& map,
                                   const Regions& regions, const PosedPart& part,
                                   const BinningOptions& options = {});

}  // namespace brdfgate
