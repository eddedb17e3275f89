// Local defects: where a part departs from its taught material over a few millimetres (method.md
// section 8).
//
// Cells are averaged into blocks of about a third of a square millimetre. In each, under both
// lights, the residual is
//   d = ln(f + e) - ln(f_taught(angles under the part's estimated pose) + e),
// from which the part's own slow departure is taken (a robust mean over kBackgroundMm within the
// cluster: lamp drift, albedo, the smooth change that a seating error or a wider lobe makes: those
// are the business of T^2 and SPE), and then what good parts show there on average. Over windows of
// three sizes the mean residual is put in units of its deviation,
//   z^2 = (m - m_taught)^2 / (s_taught^2 + v_noise),
// s_taught the good parts' own deviation there. A window beyond the limit is a defect's. The limit
// stands for a false-alarm rate per part, all lights, channels, places and sizes together: the
// predictive quantile of a Gumbel law fitted to the good parts' leave-one-out maxima (the largest
// of very many windows: Fisher and Tippett 1928), never under what Gaussian noise alone gives.
#pragma once

#include <Eigen/Core>
#include <array>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "model/brdf.hpp"
#include "model/pose.hpp"
#include "model/recipe.hpp"
#include "model/verdict.hpp"

namespace brdfgate {

/// One part's residuals on blocks, per light ([0] light 1).
struct DefectEvidence {
  struct Light {
    cv::Mat residual;  ///< CV_32FC(channels): d less the part's slow departure, ln units; 0 outside
    cv::Mat variance;  ///< same type, from pixel noise
    cv::Mat use;       ///< CV_32FC1: 1 where the block counts, else 0
    cv::Mat floor;     ///< CV_32FC1: variance that a small error of the pose leaves
  };
  std::vector<Light> lights;
  cv::Mat home;       ///< CV_8UC1: cluster of each block, kNotPart where it is on none or mixed
  cv::Mat elsewhere;  ///< CV_8UC1: not 0 where the taught parts show another cluster, and say
                      ///< nothing of this part; empty: nowhere
};

/// Where blocks lie and what each of them sees.
class DefectBlocks {
 public:
  /// @param cells  of the taught pose
  DefectBlocks(const StationGeometry& geometry, const CellGeometry& cells);

  int side() const { return side_; }  ///< cells
  cv::Size size() const { return position_m_.size(); }
  const cv::Mat& position_m() const { return position_m_; }  ///< CV_32FC2
  const cv::Mat& area_m2() const { return area_m2_; }        ///< CV_32FC1, of the plane
  /// Blocks that a length on the plane spans along the image's columns and rows, at least 1, odd.
  cv::Size span(double mm) const;
  Sightline sightline(std::size_t light, const cv::Point& block) const;

 private:
  StationGeometry geometry_;
  int side_ = 1;
  cv::Mat position_m_;
  cv::Mat area_m2_;
  cv::Vec2d pitch_m_;  ///< mean, along columns and rows
};

/// Each unknown blob takes the cluster that surrounds most of it; with the labels that the taught
/// layout expects there (empty: none), those instead, so that a stain which looks like another
/// taught material is not taken for it.
cv::Mat home_labels(const Regions& regions, const cv::Mat& expected = {});

/// A part's residuals against materials, one per cluster; nullptr: the cluster is left out.
/// @param r     as computed for the taught pose
/// @param home    home_labels(), of the cells
/// @param taught  labels of the taught layout where it was taught, of the cells; empty: not known.
///                A part that lies elsewhere shows another cluster than the taught parts in places
DefectEvidence defect_evidence(const std::vector<Reflectance>& r, const cv::Mat& home,
                               const DefectBlocks& blocks, const PartPose& pose,
                               const std::vector<BrdfPtr>& materials, const cv::Mat& taught = {});

/// From the good parts' residuals (all against the same materials, kept by the caller).
/// @param rate  false alarms per part, (0, 0.5)
/// Throws InputError when empty or of different sizes.
DefectReference teach_defects(const std::vector<DefectEvidence>& parts, const DefectBlocks& blocks,
                              double rate);

/// The largest |z| of a part: what the limit is compared with.
double defect_peak(const DefectEvidence& part, const DefectBlocks& blocks,
                   const DefectReference& taught);

/// Per light, of each block the z that is largest over channels and window sizes (signed), what
/// find_defects() compares with the limit; NaN where nothing was looked at.
std::vector<cv::Mat1f> largest_scores(const DefectEvidence& part, const DefectBlocks& blocks,
                                      const DefectReference& taught);

/// Blobs beyond the limit, largest first: kind from both lights together.
/// A blob of smaller area or of a smaller mean change than the settings say is not reported.
std::vector<Defect> find_defects(const DefectEvidence& part, const DefectBlocks& blocks,
                                 const DefectReference& taught,
                                 const std::vector<BrdfPtr>& materials,
                                 const JudgeSettings& settings);

/// Limit on |z| of a part from its good fellows' maxima: see this file's head. Fewer than
/// kFewMaxima: the Gaussian limit with a margin.
/// @param windows  independent windows per part
double defect_limit(const std::vector<double>& maxima, double windows, double rate);
inline constexpr int kFewMaxima = 5;

}  // namespace brdfgate
