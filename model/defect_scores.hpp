// Residuals over windows in units of their deviation: what teaching and looking for local defects
// share (local_defects.hpp says what they are).
#pragma once

#include <array>
#include <opencv2/core.hpp>

#include "model/local_defects.hpp"

namespace brdfgate {

/// Windows that defects are looked for in; about a defect's own size each.
inline constexpr std::array<double, 3> kDefectWindowsMm{1.0, 2.2, 4.0};
/// Deviation, ln units, that stands in where fewer than three parts, or none, or none of that
/// cluster were seen.
inline constexpr float kUntaughtDeviation = 0.03F;

/// What a window of one size shows of one light.
struct DefectWindows {
  cv::Mat mean;      ///< CV_32FC(channels)
  cv::Mat variance;  ///< of that, from noise; -1: not looked at
  cv::Mat use;       ///< CV_32FC1, share of the window that counts
};

/// @param span  blocks along columns and rows: DefectBlocks::span()
DefectWindows windows_of(const DefectEvidence::Light& light, const cv::Size& span);

/// Mean and deviation of good parts over the blocks of one light, CV_32FC(channels) each. Where the
/// part shows a cluster that the taught parts did not show there: none, and kUntaughtDeviation.
struct ExpectedResidual {
  cv::Mat mean, deviation;
};

/// Throws InputError where the taught images do not fit the part's.
ExpectedResidual expected_residual(const DefectReference& taught, const DefectEvidence& part,
                                   std::size_t light);

/// Tiles that hold so many blocks.
cv::Size defect_tiles(const cv::Size& blocks);

/// Signed z of every block and channel; 0 where it is not looked at.
cv::Mat defect_scores(const DefectWindows& windows, const ExpectedResidual& expected);

/// Windows that a part has, all sizes, lights and channels; at least 1.
double independent_windows(const DefectEvidence& part, const DefectBlocks& blocks);

}  // namespace brdfgate
