// The inner loop of merge_bracket: blocks of neighbouring sensor pixels through all exposures.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "model/radiance.hpp"

namespace brdfgate {

/// Pixels merged at once: a multiple of the vector width and of the dither's period in pixels.
inline constexpr int kMergeBlock = 64;
using MergeLane = Eigen::Array<float, kMergeBlock, 1>;
using CountLane = std::array<std::uint16_t, kMergeBlock>;

/// Throws InputError for what merge_bracket refuses.
void check_bracket(const SensorFormat& sensor, const SensorNoise& noise,
                   const std::vector<RawFrame>& frames);

/// What the exposures of one bracket have in common for all pixels. With t_j = exposure * gain,
/// w_j = t_j^2 / (g gain t_j x + gain^2 s_r^2 + 1/12) = exposure_j / (g x + k_j): read noise is
/// taken as ahead of the analogue gain, where it is largest.
struct MergePlan {
  struct Exposure {
    const cv::Mat* counts = nullptr;
    float exposure_s = 0;
    float per_gain = 1;  ///< 1 / analogue gain
    float k = 0;         ///< (gain^2 s_r^2 + 1/12) / (exposure gain^2), DN^2/s
    /// First saturated count by row of the dither pattern and pixel of a block.
    std::array<CountLane, 8> saturated_from{};
  };
  /// Borrows the frames' counts.
  MergePlan(const SensorFormat& sensor, const SensorNoise& noise,
            const std::vector<RawFrame>& frames);

  std::vector<Exposure> exposures;  ///< [0] collects the least light
  SensorFormat sensor;
  float gain_dn_per_e = 0;
};

/// Merged sensor pixels of one row.
struct MergedRow {
  std::vector<float> value, variance;
  std::vector<std::uint8_t> clipped;  ///< saturated in the shortest exposure
};

/// One thread's working memory.
struct MergeScratch {
  explicit MergeScratch(const MergePlan& plan);
  // Exposures that the present block uses, packed.
  std::vector<MergeLane>
      signal;  ///< per exposure: count above black, DN at gain 1, 0 where saturated
  std::vector<MergeLane> time;  ///< per exposure: exposure in s, 0 where saturated
  std::vector<float> k;         ///< per exposure, as in the plan
  std::array<MergedRow, 2> rows;
};

/// Merges row v of the measured image (mosaic: two sensor rows) into `out`.
void merge_cell_row(const MergePlan& plan, int v, MergeScratch& scratch, Radiance& out);

}  // namespace brdfgate
