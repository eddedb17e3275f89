#include "model/colour_chart.hpp"

#include <Eigen/LU>
#include <array>
#include <cmath>

namespace brdfgate {
namespace {

struct PublishedPatch {
  const char* name;
  double l, a, b;  ///< D50, 2 degrees
};
constexpr std::array<PublishedPatch, 24> kClassic{
    {{"dark skin", 37.986, 13.555, 14.059},     {"light skin", 65.711, 18.130, 17.810},
     {"blue sky", 49.927, -4.880, -21.925},     {"foliage", 43.139, -13.095, 21.905},
     {"blue flower", 55.112, 8.844, -25.399},   {"bluish green", 70.719, -33.397, -0.199},
     {"orange", 62.661, 36.067, 57.096},        {"purplish blue", 40.020, 10.410, -45.964},
     {"moderate red", 51.124, 48.239, 16.248},  {"purple", 30.325, 22.976, -21.587},
     {"yellow green", 72.532, -23.709, 57.255}, {"orange yellow", 71.941, 19.363, 67.857},
     {"blue", 28.778, 14.179, -50.297},         {"green", 55.261, -38.342, 31.370},
     {"red", 42.101, 53.378, 28.190},           {"yellow", 81.733, 4.039, 79.819},
     {"magenta", 51.935, 49.986, -14.574},      {"cyan", 51.038, -28.631, -28.638},
     {"white", 96.539, -0.425, 1.186},          {"neutral 8", 81.257, -0.638, -0.335},
     {"neutral 6.5", 66.766, -0.734, -0.504},   {"neutral 5", 50.867, -0.153, -0.270},
     {"neutral 3.5", 35.656, -0.421, -1.231},   {"black", 20.461, -0.079, -0.973}}};

/// Six columns of 14 mm pitch cover most of the default inspected region.
constexpr double kPitchM = 0.014;
constexpr double kPatchM = 0.012;

/// ISO 15076-1 annex E: cone responses.
const Eigen::Matrix3d& bradford() {
  static const Eigen::Matrix3d m{
      {0.8951, 0.2664, -0.1614}, {-0.7502, 1.7135, 0.0367}, {0.0389, -0.0685, 1.0296}};
  return m;
}

const Eigen::Array3d& white_d50() {
  static const Eigen::Array3d white(0.9642, 1.0, 0.8249);
  return white;
}

}  // namespace

Eigen::Vector2d ColourChart::centre_m(std::size_t patch) const {
  const auto at = static_cast<int>(patch);
  const int row = at / columns;
  const int column = at % columns;
  return {pitch_m * (row - (rows - 1) / 2.0), pitch_m * (column - (columns - 1) / 2.0)};
}

std::size_t ColourChart::patch_at(const Eigen::Vector2d& p_m) const {
  const double row = std::round(p_m.x() / pitch_m + (rows - 1) / 2.0);
  const double column = std::round(p_m.y() / pitch_m + (columns - 1) / 2.0);
  if (row < 0 || column < 0 || row >= rows || column >= columns) return patches.size();
  const auto patch = static_cast<std::size_t>(row * columns + column);
  const bool on_it = ((p_m - centre_m(patch)).array().abs() <= patch_m / 2).all();
  return on_it ? patch : patches.size();
}

const ColourChart& classic_chart() {
  static const ColourChart chart = [] {
    ColourChart c{"classic 24 patches", "D50", 6, 4, kPitchM, kPatchM, {}};
    for (const PublishedPatch& p : kClassic)
      c.patches.push_back({p.name, d50_to_d65(lab_d50_to_xyz({p.l, p.a, p.b}))});
    return c;
  }();
  return chart;
}

Eigen::Array3d d50_to_d65(const Eigen::Array3d& xyz) {
  static const Eigen::Matrix3d adapt = [] {
    // The white that L*a*b* is relative to here: that of linear sRGB's matrix.
    const Eigen::Vector3d d65 = linear_srgb_to_xyz(Eigen::Array3d::Ones()).matrix();
    const Eigen::Vector3d to = bradford() * d65;
    const Eigen::Vector3d from = bradford() * white_d50().matrix();
    return Eigen::Matrix3d(bradford().inverse() * to.cwiseQuotient(from).asDiagonal() * bradford());
  }();
  return (adapt * xyz.matrix()).array();
}

Eigen::Array3d lab_d50_to_xyz(const Lab& lab) {
  // lab_to_xyz() is relative to D65's white; the ratio to the white is the same under any.
  const Eigen::Array3d d65 = linear_srgb_to_xyz(Eigen::Array3d::Ones());
  return lab_to_xyz(lab) / d65 * white_d50();
}

}  // namespace brdfgate
