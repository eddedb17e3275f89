// A mixture of smooth trends over the image: one cubic surface of ln f per material and channel.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace brdfgate {

inline constexpr int kTrendTerms = 10;  ///< of a cubic polynomial in two coordinates
using TrendTerms = Eigen::Array<double, kTrendTerms, 1>;

/// 1, u, v, u^2, uv, v^2, u^3, u^2 v, u v^2, v^3 of coordinates in about [-1, 1].
TrendTerms trend_terms(double u, double v);

/// Cells that the mixture is fitted to.
struct TrendSamples {
  Eigen::MatrixXd terms;  ///< n x kTrendTerms
  Eigen::MatrixXd y;      ///< n x channels, ln f
  Eigen::VectorXd noise;  ///< n, variance of y by pixel noise, mean over channels
  /// Per sample, the piece without edges that it lies in: 1 is the largest, 0 none. May be empty.
  std::vector<int> segment;
};

/// One material: where its ln f lies over the image, how far its cells scatter about that, and how
/// many of the samples are its own.
struct Trend {
  Eigen::MatrixXd coefficients;  ///< kTrendTerms x channels
  /// Scatter beyond pixel noise, never under the discrepancy's: of the level (all channels
  /// together, where texture shows) and of the hue (channels against each other).
  double level_variance = 0;
  double hue_variance = 0;
  double share = 0;  ///< of the samples
};

/// Least scatter of one material's cells about a smooth surface, in ln f: texture, and a lobe that
/// is no cubic. Fine enough that a step of a few per cent between two halves does not pass for a
/// bend of one surface; what that splits too far, kTrendDistance merges again.
inline constexpr double kTrendDiscrepancy = 0.02;

/// Two materials whose ln f differ by less than this (RMS over channels and cells) are one.
inline constexpr double kTrendDistance = 0.12;

/// Squared residuals of one cell split orthogonally: level^2 + hue^2 is their sum over channels.
struct Residual {
  double level2 = 0;
  double hue2 = 0;
};
inline Residual split_residual(double sum, double sum_of_squares, double channels) {
  const double level2 = sum * sum / channels;
  return {level2, sum_of_squares > level2 ? sum_of_squares - level2 : 0};
}

struct TrendFit {
  std::vector<Trend> trends;
  /// Trend of segment 1, 2, ...; -1 for one that belongs to none. Empty when the segments were not
  /// used.
  std::vector<int> of_segment;
};

/// Finds the materials. Where segments cover most of the part, they are gathered into clusters at
/// kTrendDistance from each other: cells on one side of an edge are one material. Where they do not
/// (fine prints, texture), mixtures of rising size are fitted by expectation-maximisation with an
/// outlier class, each made from the one before by splitting where residuals say most; the Bayesian
/// information criterion chooses, and trends closer than kTrendDistance are merged. Either way a
/// material needs about one per cent of the samples. Deterministic.
/// @pre at least 30 samples, max_trends >= 1
TrendFit fit_trends(const TrendSamples& samples, int max_trends);

}  // namespace brdfgate
