#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "catch.hpp"
#include "model/colour.hpp"

using namespace brdfgate;

namespace {

struct SharmaPair {
  std::array<double, 3> first;
  std::array<double, 3> second;
  double de00;
};

/// Table 1 of Sharma, Wu, Dalal 2005, "The CIEDE2000 color-difference formula: implementation
/// notes, supplementary test data, and mathematical observations": all 34 pairs.
const std::vector<SharmaPair> kSharma = {
    {{50.0000, 2.6772, -79.7751}, {50.0000, 0.0000, -82.7485}, 2.0425},
    {{50.0000, 3.1571, -77.2803}, {50.0000, 0.0000, -82.7485}, 2.8615},
    {{50.0000, 2.8361, -74.0200}, {50.0000, 0.0000, -82.7485}, 3.4412},
    {{50.0000, -1.3802, -84.2814}, {50.0000, 0.0000, -82.7485}, 1.0000},
    {{50.0000, -1.1848, -84.8006}, {50.0000, 0.0000, -82.7485}, 1.0000},
    {{50.0000, -0.9009, -85.5211}, {50.0000, 0.0000, -82.7485}, 1.0000},
    {{50.0000, 0.0000, 0.0000}, {50.0000, -1.0000, 2.0000}, 2.3669},
    {{50.0000, -1.0000, 2.0000}, {50.0000, 0.0000, 0.0000}, 2.3669},
    {{50.0000, 2.4900, -0.0010}, {50.0000, -2.4900, 0.0009}, 7.1792},
    {{50.0000, 2.4900, -0.0010}, {50.0000, -2.4900, 0.0010}, 7.1792},
    {{50.0000, 2.4900, -0.0010}, {50.0000, -2.4900, 0.0011}, 7.2195},
    {{50.0000, 2.4900, -0.0010}, {50.0000, -2.4900, 0.0012}, 7.2195},
    {{50.0000, -0.0010, 2.4900}, {50.0000, 0.0009, -2.4900}, 4.8045},
    {{50.0000, -0.0010, 2.4900}, {50.0000, 0.0010, -2.4900}, 4.8045},
    {{50.0000, -0.0010, 2.4900}, {50.0000, 0.0011, -2.4900}, 4.7461},
    {{50.0000, 2.5000, 0.0000}, {50.0000, 0.0000, -2.5000}, 4.3065},
    {{50.0000, 2.5000, 0.0000}, {73.0000, 25.0000, -18.0000}, 27.1492},
    {{50.0000, 2.5000, 0.0000}, {61.0000, -5.0000, 29.0000}, 22.8977},
    {{50.0000, 2.5000, 0.0000}, {56.0000, -27.0000, -3.0000}, 31.9030},
    {{50.0000, 2.5000, 0.0000}, {58.0000, 24.0000, 15.0000}, 19.4535},
    {{50.0000, 2.5000, 0.0000}, {50.0000, 3.1736, 0.5854}, 1.0000},
    {{50.0000, 2.5000, 0.0000}, {50.0000, 3.2972, 0.0000}, 1.0000},
    {{50.0000, 2.5000, 0.0000}, {50.0000, 1.8634, 0.5757}, 1.0000},
    {{50.0000, 2.5000, 0.0000}, {50.0000, 3.2592, 0.3350}, 1.0000},
    {{60.2574, -34.0099, 36.2677}, {60.4626, -34.1751, 39.4387}, 1.2644},
    {{63.0109, -31.0961, -5.8663}, {62.8187, -29.7946, -4.0864}, 1.2630},
    {{61.2901, 3.7196, -5.3901}, {61.4292, 2.2480, -4.9620}, 1.8731},
    {{35.0831, -44.1164, 3.7933}, {35.0232, -40.0716, 1.5901}, 1.8645},
    {{22.7233, 20.0904, -46.6940}, {23.0331, 14.9730, -42.5619}, 2.0373},
    {{36.4612, 47.8580, 18.3852}, {36.2715, 50.5065, 21.2231}, 1.4146},
    {{90.8027, -2.0831, 1.4410}, {91.1528, -1.6435, 0.0447}, 1.4441},
    {{90.9257, -0.5406, -0.9208}, {88.6381, -0.8985, -0.7239}, 1.5381},
    {{6.7747, -0.2908, -2.4247}, {5.8714, -0.0985, -2.2286}, 0.6377},
    {{2.0776, 0.0795, -1.1350}, {0.9033, -0.0636, -0.5514}, 0.9082},
};

Lab lab_of(const std::array<double, 3>& v) {
  return {v[0], v[1], v[2]};
}

}  // namespace

TEST_CASE("CIEDE2000 gives all 34 published pairs to the fourth decimal, both ways round",
          "[colour]") {
  REQUIRE(kSharma.size() == 34);
  for (const SharmaPair& pair : kSharma) {
    CAPTURE(pair.first, pair.second, pair.de00);
    CHECK(std::abs(delta_e00(lab_of(pair.first), lab_of(pair.second)) - pair.de00) < 0.00005001);
    CHECK(std::abs(delta_e00(lab_of(pair.second), lab_of(pair.first)) - pair.de00) < 0.00005001);
    CHECK(delta_e00(lab_of(pair.first), lab_of(pair.first)) == 0.0);
  }
}

TEST_CASE("White is L* 100 without colour, black is 0, greys have no colour", "[colour]") {
  const Lab white = linear_srgb_to_lab({1, 1, 1});
  CHECK(white[0] == Approx(100).epsilon(1e-14));
  CHECK(std::abs(white[1]) < 1e-12);
  CHECK(std::abs(white[2]) < 1e-12);
  CHECK(linear_srgb_to_lab({0, 0, 0}).abs().maxCoeff() < 1e-12);
  for (const double grey : {1e-4, 0.004, 0.18, 0.5}) {
    const Lab lab = linear_srgb_to_lab(Eigen::Array3d::Constant(grey));
    CAPTURE(grey);
    CHECK(std::abs(lab[1]) < 1e-12);
    CHECK(std::abs(lab[2]) < 1e-12);
    // CIE 15: L* = 903.3 Y below Y = 0.008856, 116 cbrt(Y) - 16 above.
    const double lightness = grey > 0.008856 ? 116 * std::cbrt(grey) - 16 : 903.2963 * grey;
    CHECK(lab[0] == Approx(lightness).epsilon(1e-6));
  }
}

TEST_CASE("The primaries of sRGB have their published coordinates", "[colour]") {
  // CIE L*a*b* (D65) of pure sRGB red, green, blue, as widely tabulated to two decimals from the
  // white 0.95047, 1, 1.08883; the standard's own matrix sums to 0.9505, 1, 1.0890.
  const Lab red = linear_srgb_to_lab({1, 0, 0});
  const Lab green = linear_srgb_to_lab({0, 1, 0});
  const Lab blue = linear_srgb_to_lab({0, 0, 1});
  CHECK((red - Lab(53.24, 80.09, 67.20)).abs().maxCoeff() < 0.03);
  CHECK((green - Lab(87.73, -86.18, 83.18)).abs().maxCoeff() < 0.03);
  CHECK((blue - Lab(32.30, 79.19, -107.86)).abs().maxCoeff() < 0.03);
}

TEST_CASE("Each conversion is undone by its inverse", "[colour]") {
  for (const Eigen::Array3d& rgb : {Eigen::Array3d(0.2, 0.3, 0.4), Eigen::Array3d(1e-4, 2e-3, 5e-5),
                                    Eigen::Array3d(1, 1, 1), Eigen::Array3d(0.9, 0.01, 0.02)}) {
    const Eigen::Array3d xyz = linear_srgb_to_xyz(rgb);
    CHECK((xyz_to_linear_srgb(xyz) - rgb).abs().maxCoeff() < 1e-13);
    CHECK((lab_to_xyz(xyz_to_lab(xyz)) - xyz).abs().maxCoeff() < 1e-13);
  }
}

TEST_CASE("Turning a hue keeps lightness and chroma and comes back", "[colour]") {
  const Eigen::Array3d rgb(0.30, 0.25, 0.22);
  const Lab before = linear_srgb_to_lab(rgb);
  for (const double degrees : {-20.0, 5.0, 90.0, 180.0}) {
    const Eigen::Array3d turned = rotate_hue(rgb, degrees);
    const Lab after = linear_srgb_to_lab(turned);
    CAPTURE(degrees);
    CHECK(after[0] == Approx(before[0]).epsilon(1e-10));
    CHECK(std::hypot(after[1], after[2]) ==
          Approx(std::hypot(before[1], before[2])).epsilon(1e-10));
    const double turn = std::atan2(after[2], after[1]) - std::atan2(before[2], before[1]);
    CHECK(std::abs(std::remainder(turn - degrees * EIGEN_PI / 180, 2 * EIGEN_PI)) < 1e-9);
    CHECK((rotate_hue(turned, -degrees) - rgb).abs().maxCoeff() < 1e-12);
  }
  CHECK((rotate_hue(Eigen::Array3d::Constant(0.5), 77) - 0.5).abs().maxCoeff() < 1e-12);
}

TEST_CASE("A hue turned out of gamut is held at zero, never negative", "[colour]") {
  for (double degrees = 0; degrees < 360; degrees += 15)
    CHECK(rotate_hue({0.8, 0.02, 0.01}, degrees).minCoeff() >= 0);
}

TEST_CASE("A colour that is not a number is no small difference", "[colour]") {
  for (int i = 0; i < 3; ++i) {
    Lab lab(50, 20, 10);
    lab[i] = std::numeric_limits<double>::quiet_NaN();
    CHECK(std::isnan(delta_e00(lab, {50, 20, 10})));
    CHECK(std::isnan(delta_e00({50, 20, 10}, lab)));
  }
}
