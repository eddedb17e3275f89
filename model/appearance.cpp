#include "model/appearance.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace brdfgate {
namespace {

constexpr double kDegree = EIGEN_PI / 180;
constexpr double kIncidenceDeg = 45;
/// ASTM D4039, scope: gloss at 60 degrees from which the difference is haze.
constexpr double kHazeFrom = 70;

}  // namespace

DirectionPair aspecular_directions(double aspecular_deg) {
  const double in = kIncidenceDeg * kDegree, out = (kIncidenceDeg - aspecular_deg) * kDegree;
  return {{-std::sin(in), 0, std::cos(in)}, {std::sin(out), 0, std::cos(out)}};
}

double haze_gu(const std::array<double, 3>& gloss) {
  return gloss[1] > kHazeFrom ? gloss[1] - gloss[0] : std::numeric_limits<double>::quiet_NaN();
}

double flop_index(double l15, double l45, double l110) {
  const double fall = std::max(0.0, l15 - l110);
  return l45 > 0 ? 2.69 * std::pow(fall, 1.11) / std::pow(l45, 0.86)
                 : std::numeric_limits<double>::quiet_NaN();
}

AspecularReadings aspecular_readings(const Brdf& brdf) {
  AspecularReadings out;
  for (std::size_t i = 0; i < kAspecularDeg.size(); ++i) {
    const DirectionPair at = aspecular_directions(kAspecularDeg[i]);
    out.lab[i] = linear_srgb_to_lab(EIGEN_PI * brdf.eval(to_half_diff(at)));
  }
  out.flop_index = flop_index(out.lab[0][0], out.lab[2][0], out.lab[4][0]);
  return out;
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
