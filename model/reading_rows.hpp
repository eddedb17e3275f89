// Readings of a cluster with their uncertainties, from weights, without the whole BRDF.
//
// A reading needs the BRDF at few directions: some 1,200 for each gloss (readings.hpp), five for
// the colours. The basis' rows there are made once; a cluster then costs two products of matrices.
// The deviations are the weights' posterior covariance carried to the reading to first order (GUM,
// JCGM 100:2008, 5.2), and what a material can have beyond the basis (kBasisError): u^2 = sum over
// channels a, b of r_ab ((L_a^T g_a) . (L_b^T g_b) + s^2 h_a h_b), with g_a the reading's gradient
// in the weights of channel a, C_a = L_a L_a^T their covariance, h_a the reading's change with all
// its mapped values together, s = kBasisError, and r the correlation of the channels' errors
// (Weights::channel_correlation). How often the intervals hold: docs/readings.md.
//
// Not part of them: what all reflectance has in common (the white reference,
// PartResult::white_sigma) and an error of the part's pose.
#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <memory>
#include <optional>

#include "model/appearance.hpp"
#include "model/basis.hpp"
#include "model/colour_model.hpp"
#include "model/estimator.hpp"
#include "model/samples.hpp"

namespace brdfgate {

/// RMS that the best weights leave of a left-out material, mapped units: least_squares in
/// docs/accuracy.md has 0.068 and 0.051 on the two sets of fits of MERL materials. One error for
/// all directions of a gloss, or of a colour.
inline constexpr double kBasisError = 0.06;

/// A value, its standard deviation, and whether the rig looked where it is told from (else the
/// basis extrapolates). NaN: undefined for this material, or not known.
struct Reading {
  double value = std::numeric_limits<double>::quiet_NaN();
  double sigma = std::numeric_limits<double>::quiet_NaN();
  bool measured = false;

  /// Bounds of 90 %: value -+ 1.645 sigma.
  std::array<double, 2> interval() const;
  /// The same for what is positive and errs by factors (gloss): value / F, value * F with F =
  /// exp(1.645 sigma / value).
  std::array<double, 2> interval_by_factor() const;
};

struct ColourReading {
  std::array<Reading, 3> lab;  ///< L*, a*, b*
};

struct ClusterReadings {
  std::array<Reading, 3> gloss;            ///< GU at 20, 60, 85 degrees
  Reading haze;                            ///< GU, haze_gu()
  std::array<ColourReading, 5> aspecular;  ///< at kAspecularDeg; 45 is 45:0
  Reading flop;  ///< Alman's index; without a deviation where it is held at 0
  const ColourReading& at_45_0() const { return aspecular[2]; }
};

/// Immutable, thread-safe.
class ReadingRows {
 public:
  /// @param colour  camera RGB to XYZ; nothing: the channels are linear sRGB
  explicit ReadingRows(std::shared_ptr<const Basis> basis,
                       std::optional<CameraColour> colour = std::nullopt,
                       double basis_error = kBasisError);

  /// Values as gloss_gu(), haze_gu() and aspecular_readings() of the reconstructed BRDF have them
  /// (gloss within 0.2 % and 0.001 GU: one weight a node serves diffuse and specular). Mono weights
  /// stand for three equal channels. Without covariances the deviations are NaN.
  /// Throws InputError where the weights are not of this basis, or not finite.
  ClusterReadings read(const Weights& weights) const;
  /// The same, with each reading's `measured` told from the bins that were seen.
  ClusterReadings read(const Weights& weights, const BinnedSamples& seen) const;

 private:
  std::shared_ptr<const Basis> basis_;
  std::optional<CameraColour> colour_;
  double basis_error_;
  Eigen::MatrixXf q_;     ///< rows at all directions: gloss 20, 60, 85, then the colours
  Eigen::ArrayXf mean_;   ///< mu there
  Eigen::ArrayXf scale_;  ///< (f_ref w + e) / w: f = exp(x) scale - offset
  Eigen::ArrayXf offset_;
  Eigen::ArrayXf gloss_weight_;               ///< of the gloss nodes
  std::array<Eigen::Index, 4> gloss_from_{};  ///< first row of each gloss; of the colours
};

/// Mirror direction seen near enough to a gloss geometry's angle for it to be measured there.
inline constexpr double kGlossReach = 0.1396;  ///< rad of theta_d, 8 degrees
/// So near to the mirror direction a bin shows the peak.
inline constexpr double kPeakThetaH = 0.0349;  ///< rad, 2 degrees
bool is_gloss_measured(const BinnedSamples& seen, double incidence_deg);

}  // namespace brdfgate
