#include "model/readings.hpp"

#include <algorithm>
#include <cmath>

namespace brdfgate {

double fresnel_dielectric(double cos_i, double n) {
  const double c = std::clamp(cos_i, 0.0, 1.0);
  const double g = std::sqrt(std::max(0.0, n * n - 1 + c * c));  // n cos_t, by Snell's law
  const double across = (c - g) / (c + g);
  const double in_plane = (n * n * c - g) / (n * n * c + g);
  return (across * across + in_plane * in_plane) / 2;
}

Lab lab_45_0(const Brdf& brdf) {
  constexpr double k45 = EIGEN_PI / 4;
  const DirectionPair directions{{std::sin(k45), 0, std::cos(k45)}, {0, 0, 1}};
  return linear_srgb_to_lab(EIGEN_PI * brdf.eval(to_half_diff(directions)));
}

}  // namespace brdfgate
