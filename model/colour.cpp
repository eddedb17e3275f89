#include "model/colour.hpp"

#include <Eigen/LU>
#include <cmath>

namespace brdfgate {
namespace {

constexpr double kDegree = EIGEN_PI / 180;

/// IEC 61966-2-1, equation for linear sRGB to CIE 1931 XYZ (D65), to the four digits it prints.
const Eigen::Matrix3d& srgb_matrix() {
  static const Eigen::Matrix3d m{
      {0.4124, 0.3576, 0.1805}, {0.2126, 0.7152, 0.0722}, {0.0193, 0.1192, 0.9505}};
  return m;
}

/// White of that matrix: its row sums, so that RGB = 1, 1, 1 is exactly L* = 100, a* = b* = 0.
const Eigen::Array3d& white_xyz() {
  static const Eigen::Array3d white = srgb_matrix().rowwise().sum().array();
  return white;
}

/// CIE 15: the cube root above (6/29)^3, its tangent below; delta = 6/29.
constexpr double kDelta = 6.0 / 29.0;

double lab_f(double t) {
  return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3 * kDelta * kDelta) + 4.0 / 29.0;
}

double lab_f_inverse(double f) {
  return f > kDelta ? f * f * f : 3 * kDelta * kDelta * (f - 4.0 / 29.0);
}

/// C^7 / (C^7 + 25^7) of CIEDE2000, under its root.
double chroma_root(double chroma) {
  constexpr double k25To7 = 6103515625.0;
  const double c7 = std::pow(chroma, 7);
  return std::sqrt(c7 / (c7 + k25To7));
}

/// Hue angle in [0, 2 pi); 0 where there is no chroma.
double hue(double a, double b) {
  if (a == 0 && b == 0) return 0;
  const double h = std::atan2(b, a);
  return h < 0 ? h + 2 * EIGEN_PI : h;
}

/// Opposite hues differ by pi up to rounding; the standard's "<= 180 degrees" includes them.
constexpr double kHalfTurn = EIGEN_PI + 1e-12;

/// Sharma et al. 2005, eq. 10.
double hue_difference(double h1, double h2) {
  double d = h2 - h1;
  if (d > kHalfTurn) d -= 2 * EIGEN_PI;
  if (d < -kHalfTurn) d += 2 * EIGEN_PI;
  return d;
}

/// Sharma et al. 2005, eq. 14, both chromas nonzero.
double mean_hue(double h1, double h2) {
  const double sum = h1 + h2;
  if (std::abs(h1 - h2) <= kHalfTurn) return sum / 2;
  return sum < 2 * EIGEN_PI ? sum / 2 + EIGEN_PI : sum / 2 - EIGEN_PI;
}

struct Chromatic {
  double chroma = 0;
  double hue = 0;
};

Chromatic scaled(const Lab& lab, double a_scale) {
  const double a = lab[1] * a_scale;
  return {std::hypot(a, lab[2]), hue(a, lab[2])};
}

}  // namespace

const Eigen::Matrix3d& linear_srgb_xyz_matrix() {
  return srgb_matrix();
}

Eigen::Matrix3d lab_slope(const Eigen::Array3d& xyz) {
  constexpr double kStep = 1e-5;
  Eigen::Matrix3d slope;
  for (int i = 0; i < 3; ++i) {
    Eigen::Array3d up = xyz, down = xyz;
    up[i] += kStep;
    down[i] -= kStep;
    slope.col(i) = ((xyz_to_lab(up) - xyz_to_lab(down)) / (2 * kStep)).matrix();
  }
  return slope;
}

Eigen::Array3d linear_srgb_to_xyz(const Eigen::Array3d& rgb) {
  return (srgb_matrix() * rgb.matrix()).array();
}

Eigen::Array3d xyz_to_linear_srgb(const Eigen::Array3d& xyz) {
  static const Eigen::Matrix3d inverse = srgb_matrix().inverse();
  return (inverse * xyz.matrix()).array();
}

Lab xyz_to_lab(const Eigen::Array3d& xyz) {
  const Eigen::Array3d f = (xyz / white_xyz()).unaryExpr(&lab_f);
  return {116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])};
}

Eigen::Array3d lab_to_xyz(const Lab& lab) {
  const double fy = (lab[0] + 16) / 116;
  const Eigen::Array3d f(fy + lab[1] / 500, fy, fy - lab[2] / 200);
  return f.unaryExpr(&lab_f_inverse) * white_xyz();
}

double delta_e00(const Lab& a, const Lab& b) {
  // Equation numbers of Sharma, Wu, Dalal 2005.
  const double mean_ab_chroma = (std::hypot(a[1], a[2]) + std::hypot(b[1], b[2])) / 2;  // 2, 3
  const double a_scale = 1 + 0.5 * (1 - chroma_root(mean_ab_chroma));                   // 4, 5
  const Chromatic p = scaled(a, a_scale);                                               // 6, 7
  const Chromatic q = scaled(b, a_scale);
  const bool achromatic = p.chroma * q.chroma == 0;

  const double dl = b[0] - a[0];
  const double dc = q.chroma - p.chroma;
  const double dh_angle = achromatic ? 0 : hue_difference(p.hue, q.hue);
  const double dh = 2 * std::sqrt(p.chroma * q.chroma) * std::sin(dh_angle / 2);  // 11

  const double l = (a[0] + b[0]) / 2;
  const double c = (p.chroma + q.chroma) / 2;
  const double h = achromatic ? p.hue + q.hue : mean_hue(p.hue, q.hue);
  const double t = 1 - 0.17 * std::cos(h - 30 * kDegree) + 0.24 * std::cos(2 * h) +
                   0.32 * std::cos(3 * h + 6 * kDegree) - 0.20 * std::cos(4 * h - 63 * kDegree);
  const double rotation_at = (h / kDegree - 275) / 25;
  const double rotation = 30 * kDegree * std::exp(-rotation_at * rotation_at);  // 16
  const double l50 = (l - 50) * (l - 50);
  const double sl = 1 + 0.015 * l50 / std::sqrt(20 + l50);         // 18
  const double sc = 1 + 0.045 * c;                                 // 19
  const double sh = 1 + 0.015 * c * t;                             // 20
  const double rt = -std::sin(2 * rotation) * 2 * chroma_root(c);  // 17, 21
  const double el = dl / sl, ec = dc / sc, eh = dh / sh;
  const double square = el * el + ec * ec + eh * eh + rt * ec * eh;
  return square < 0 ? 0 : std::sqrt(square);  // 22; NaN stays NaN
}

Eigen::Array3d rotate_hue(const Eigen::Array3d& linear_srgb, double hue_deg) {
  const Lab lab = linear_srgb_to_lab(linear_srgb);
  const double c = std::cos(hue_deg * kDegree), s = std::sin(hue_deg * kDegree);
  const Lab turned(lab[0], c * lab[1] - s * lab[2], s * lab[1] + c * lab[2]);
  return xyz_to_linear_srgb(lab_to_xyz(turned)).max(0.0);
}

}  // namespace brdfgate
