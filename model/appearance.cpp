#include "model/appearance.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "model/basis.hpp"
#include "model/error.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

constexpr double kDegree = EIGEN_PI / 180;
constexpr double kIncidenceDeg = 45;
/// ASTM D4039, scope: gloss at 60 degrees from which the difference is haze.
constexpr double kHazeFrom = 70;
/// Luminance of linear sRGB (IEC 61966-2-1).
constexpr std::array<double, 3> kLuminance{0.2126, 0.7152, 0.0722};

/// dL*/dY of CIE 15, Y relative to white.
double lightness_slope(double y) {
  constexpr double kLinearBelow = 216.0 / 24389, kLinearSlope = 24389.0 / 27;
  return y > kLinearBelow ? 116.0 / 3 * std::pow(y, -2.0 / 3) : kLinearSlope;
}

}  // namespace

DirectionPair aspecular_directions(double aspecular_deg) {
  const double in = kIncidenceDeg * kDegree, out = (kIncidenceDeg - aspecular_deg) * kDegree;
  return {{-std::sin(in), 0, std::cos(in)}, {std::sin(out), 0, std::cos(out)}};
}

double haze_gu(const std::array<double, 3>& gloss) {
  return gloss[1] > kHazeFrom ? gloss[1] - gloss[0] : std::numeric_limits<double>::quiet_NaN();
}

AspecularReadings aspecular_readings(const Brdf& brdf) {
  AspecularReadings out;
  for (std::size_t i = 0; i < kAspecularDeg.size(); ++i) {
    const DirectionPair at = aspecular_directions(kAspecularDeg[i]);
    out.lab[i] = linear_srgb_to_lab(EIGEN_PI * brdf.eval(to_half_diff(at)));
  }
  const double fall = std::max(0.0, out.lab[0][0] - out.lab[4][0]);
  out.flop_index = out.lab[2][0] > 0 ? 2.69 * std::pow(fall, 1.11) / std::pow(out.lab[2][0], 0.86)
                                     : std::numeric_limits<double>::quiet_NaN();
  return out;
}

double lightness_sigma(const Basis& basis, const Weights& weights, const HalfDiff& directions) {
  const BasisRows rows = basis.rows({directions});
  const Eigen::Index channels = weights.c.cols();
  if (weights.c.rows() != rows.q.cols() || std::ssize(weights.covariance) != channels) {
    throw InputError("weights", std::to_string(weights.c.rows()) + " components",
                     std::to_string(rows.q.cols()) + " with a covariance per channel");
  }
  double y = 0, variance = 0;
  for (Eigen::Index ch = 0; ch < channels; ++ch) {
    const Eigen::MatrixXd& covariance = weights.covariance[static_cast<std::size_t>(ch)];
    const double x = rows.q.row(0).dot(weights.c.col(ch)) + rows.mean[0];
    const double x_variance = rows.q.row(0) * covariance * rows.q.row(0).transpose();
    const double f = from_mapped(x, rows.median[0], rows.weight[0]);
    // df/dx of the mapping's inverse.
    const double slope = f + kMappingEpsilon / rows.weight[0];
    const double share = channels == 1 ? 1 : kLuminance[static_cast<std::size_t>(ch)];
    y += share * EIGEN_PI * f;
    variance += std::pow(share * EIGEN_PI * slope, 2) * x_variance;
  }
  return lightness_slope(y) * std::sqrt(variance);
}

bool is_measured(const BinnedSamples& samples, const HalfDiff& at) {
  return std::any_of(samples.bins.begin(), samples.bins.end(), [&at](const Bin& bin) {
    const double h = bin.angles.theta_h - at.theta_h;
    const double turn = std::remainder(bin.angles.phi_d - at.phi_d, EIGEN_PI);
    const double across = turn * std::sin((bin.angles.theta_h + at.theta_h) / 2);
    return std::hypot(h, across) <= kMeasuredReach &&
           std::abs(bin.angles.theta_d - at.theta_d) <= kMeasuredReach;
  });
}

}  // namespace brdfgate
