// Which exposures a material needs: as few as possible.
#pragma once

#include <string>
#include <vector>

#include "model/frame.hpp"
#include "model/radiance.hpp"

namespace brdfgate {

/// A material's radiance as once measured with a generous bracket, under one light.
struct BracketNeed {
  const Radiance* radiance = nullptr;  ///< DN/s at gain 1; masked cells are not counted
  const cv::Mat* cells = nullptr;      ///< CV_8UC1, those that matter; null: all
};

struct BracketLimits {
  double most_masked = 0.001;  ///< share of the cells that may stay clipped or in the noise floor
  double least_snr = 1;        ///< of the merged radiance, in a cell's weakest channel
  double budget_s = 1e9;       ///< sum of the exposures and of the readouts
  double readout_s = 0;        ///< per frame
};

struct BracketChoice {
  std::vector<double> exposures_s;  ///< rising
  double masked = 0;                ///< share of cells that it leaves masked, predicted
  double time_s = 0;                ///< exposures and readouts
};

/// The fewest of the candidate exposures that serve all needs (both lights share one bracket); of
/// equally many the quickest. Every cell is judged by its worst channel: clipped where it saturates
/// in the shortest exposure, in the noise floor where its merged SNR (the merge's own variance at
/// the known radiance) is under the limit. Throws InputError: no candidate or more than 16, none
/// positive, no cell to judge; nothing within the budget meets the limit (says what the best would
/// leave masked, and what it takes without the budget).
BracketChoice choose_bracket(const SensorFormat& sensor, const SensorNoise& noise,
                             const std::vector<BracketNeed>& needs,
                             const std::vector<double>& candidates_s, const BracketLimits& limits);

/// Candidates for a sensor: from `shortest_s` by factors of `step` up to `longest_s`, at most 16.
std::vector<double> exposure_ladder(double shortest_s, double longest_s, double step);

}  // namespace brdfgate
