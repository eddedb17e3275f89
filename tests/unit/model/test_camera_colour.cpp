#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "catch.hpp"
#include "model/analytic.hpp"
#include "model/camera_colour.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;

namespace {

/// A camera whose channels overlap more than those of sRGB, white balanced.
const Eigen::Matrix3d& camera_from_srgb() {
  static const Eigen::Matrix3d m{{0.72, 0.23, 0.05}, {0.16, 0.74, 0.10}, {0.04, 0.20, 0.76}};
  return m;
}

std::vector<Eigen::Array3d> seen_by(const Eigen::Matrix3d& camera, double level = 1) {
  std::vector<Eigen::Array3d> rgb;
  for (const ChartPatch& patch : classic_chart().patches)
    rgb.emplace_back(level * (camera * xyz_to_linear_srgb(patch.xyz).matrix()).array());
  return rgb;
}

/// Sum of squared linearised L*a*b* differences, computed otherwise than by the fit.
double objective(const Eigen::MatrixXd& to_xyz, ColourModel model,
                 const std::vector<Eigen::Array3d>& rgb) {
  double sum = 0;
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    const Eigen::Array3d& xyz = classic_chart().patches[i].xyz;
    const Eigen::Array3d off = (to_xyz * colour_terms(model, rgb[i])).array() - xyz;
    // The directional derivative of L*a*b* along the difference.
    constexpr double kStep = 1e-4;
    sum += ((xyz_to_lab(xyz + kStep * off) - xyz_to_lab(xyz - kStep * off)) / (2 * kStep))
               .square()
               .sum();
  }
  return sum;
}

}  // namespace

TEST_CASE("the classic chart's published colours are those of its maker") {
  const ColourChart& chart = classic_chart();
  REQUIRE(chart.patches.size() == 24);
  // sRGB codes that the maker published with them (D65), within the change of illuminant's model.
  const std::vector<std::pair<std::size_t, std::array<double, 3>>> codes{
      {0, {115, 82, 68}},  {2, {98, 122, 157}},  {7, {80, 91, 166}},    {13, {70, 148, 73}},
      {14, {175, 54, 60}}, {15, {231, 199, 31}}, {18, {243, 243, 242}}, {22, {85, 85, 85}}};
  for (const auto& [patch, code] : codes) {
    Eigen::Array3d linear;
    for (int c = 0; c < 3; ++c) {
      const double v = code[static_cast<std::size_t>(c)] / 255;
      linear[c] = v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
    }
    INFO(chart.patches[patch].name);
    CHECK(delta_e00(linear_srgb_to_lab(linear), xyz_to_lab(chart.patches[patch].xyz)) < 3);
  }
  // The perfect diffuser is white under any illuminant.
  CHECK((d50_to_d65(lab_d50_to_xyz({100, 0, 0})) - linear_srgb_to_xyz(Eigen::Array3d::Ones()))
            .abs()
            .maxCoeff() < 1e-12);
}

TEST_CASE("a chart's places and patches agree") {
  const ColourChart& chart = classic_chart();
  for (std::size_t i = 0; i < chart.patches.size(); ++i) {
    CHECK(chart.patch_at(chart.centre_m(i)) == i);
    CHECK(chart.patch_at(chart.centre_m(i) + Eigen::Vector2d(0.0059, -0.0059)) == i);
    CHECK(chart.patch_at(chart.centre_m(i) + Eigen::Vector2d(0, 0.007)) == 24);
  }
  CHECK(chart.patch_at({1, 1}) == 24);
  // Row by row along +y; the first row is the farthest from the camera.
  CHECK(chart.centre_m(1).y() > chart.centre_m(0).y());
  CHECK(chart.centre_m(6).x() > chart.centre_m(0).x());
}

TEST_CASE("a linear camera's matrix is found exactly, whatever its primaries") {
  for (const Eigen::Matrix3d& camera :
       {Eigen::Matrix3d(Eigen::Matrix3d::Identity()), camera_from_srgb()}) {
    for (const ColourModel model : {ColourModel::matrix, ColourModel::root_polynomial}) {
      const auto rgb = seen_by(camera);
      const CameraColour found = fit_camera_colour(rgb, classic_chart(), model);
      if (model == ColourModel::matrix || camera != Eigen::Matrix3d::Identity()) {
        CHECK(found.de00_max < 1e-6);
      }
      if (model == ColourModel::matrix) {
        Eigen::Matrix3d truth;
        for (int c = 0; c < 3; ++c)
          truth.col(c) = linear_srgb_to_xyz(Eigen::Vector3d::Unit(c).array()).matrix();
        CHECK((found.to_xyz - truth * camera.inverse()).cwiseAbs().maxCoeff() < 1e-8);
      }
      // Twice the light is twice the colour.
      const Eigen::Array3d half = found.xyz(0.5 * rgb[3]);
      CHECK((found.xyz(rgb[3]) - 2 * half).abs().maxCoeff() < 1e-12);
    }
  }
}

TEST_CASE("with noise the fit is the least of its objective, and the polynomial no worse") {
  std::vector<Eigen::Array3d> rgb = seen_by(camera_from_srgb());
  // A camera that is not linear in XYZ: its red sees a little of what none of the three sees.
  for (std::size_t i = 0; i < rgb.size(); ++i)
    rgb[i] *= 1 + 0.04 * Eigen::Array3d(std::sin(3.0 * double(i)), std::cos(5.0 * double(i)),
                                        std::sin(7.0 * double(i)));
  double last = HUGE_VAL;
  for (const ColourModel model : {ColourModel::matrix, ColourModel::root_polynomial}) {
    const CameraColour found = fit_camera_colour(rgb, classic_chart(), model);
    const double least = objective(found.to_xyz, model, rgb);
    for (Eigen::Index i = 0; i < found.to_xyz.size(); ++i) {
      for (const double step : {-1e-3, 1e-3}) {
        Eigen::MatrixXd moved = found.to_xyz;
        moved.data()[i] += step;
        CHECK(objective(moved, model, rgb) > least);
      }
    }
    CHECK(least <= last);
    last = least;
    CHECK(found.de00_mean > 0.1);
    CHECK(found.de00_mean < found.de00_max);
    const auto residuals = chart_residuals(found, rgb, classic_chart());
    CHECK(*std::max_element(residuals.begin(), residuals.end()) == found.de00_max);
  }
}

TEST_CASE("a chart that is turned or another one is refused") {
  auto rgb = seen_by(camera_from_srgb());
  std::reverse(rgb.begin(), rgb.end());
  const auto fit = [&] { return fit_camera_colour(rgb, classic_chart(), ColourModel::matrix); };
  CHECK(contains(input_error(fit), "upright and in its place"));
  rgb.pop_back();
  CHECK(contains(input_error(fit), "23 colours seen"));
}

TEST_CASE("a BRDF of camera channels becomes one of linear sRGB") {
  const CameraColour colour =
      fit_camera_colour(seen_by(camera_from_srgb()), classic_chart(), ColourModel::matrix);
  const Rgb albedo(0.4, 0.2, 0.1), f0(0.05, 0.04, 0.06);
  const auto of = [](const Eigen::Array3d& kd, const Eigen::Array3d& ks) {
    return make_brdf(GgxParameters{kd, ks, 0.3});
  };
  const auto camera = [](const Rgb& x) -> Rgb { return (camera_from_srgb() * x.matrix()).array(); };
  const BrdfPtr truth = of(albedo, f0);
  const BrdfPtr corrected = in_linear_srgb(of(camera(albedo), camera(f0)), colour);
  for (const double theta_h : {0.0, 0.2, 0.6}) {
    const HalfDiff angles{theta_h, 0.5, 1.0};
    CHECK((corrected->diffuse(0.5) - truth->diffuse(0.5)).abs().maxCoeff() < 1e-9);
    // Fresnel's law is not linear in f0, but nearly so.
    CHECK((corrected->eval(angles) - truth->eval(angles)).abs().maxCoeff() <
          1e-3 * truth->eval(angles).maxCoeff());
  }
}
