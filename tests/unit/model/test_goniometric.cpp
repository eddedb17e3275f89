#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "catch.hpp"
#include "model/estimator.hpp"
#include "model/goniometric.hpp"
#include "support/input_error.hpp"
#include "support/mutate.hpp"
#include "support/shipped.hpp"
#include "support/small_basis.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::replaced;
using brdfgate::test::TempDir;

namespace {

constexpr double kPi = std::numbers::pi;

/// A list as the Cornell laboratory wrote them, with its line ends.
const std::string kSpectral =
    "# num wls\r\n3\r\n\r\n# wls\r\n400 500\r\n600\r\n\r\n# theta i, phi i, theta s, phi_s\r\n\r\n"
    "0.5 0 0.5 3.141592653589793 0.1 0.2 0.4\r\n"
    "0.872665 0.000000 0.573513 -0.261799 0 1e-3 9.178033  # grazing\r\n"
    "0 0 0.3 1 0.01 0.02 0.03\r\n";

std::string complaint(const std::string& text) {
  return input_error([&] { return parse_goniometric(text, "list.brdf").f.size(); });
}

std::vector<HalfDiff> fan() {
  std::vector<HalfDiff> directions;
  for (double h = 0; h < 0.8; h += 0.1) {
    for (double d = 0.05; d < 0.75; d += 0.1)
      directions.push_back({h, d, std::fmod(7 * h + 3 * d, kPi)});
  }
  return directions;
}

}  // namespace

TEST_CASE("a goniometric list is read line by line, with its wavelengths") {
  const GoniometricList list = parse_goniometric(kSpectral, "list.brdf");
  CHECK(list.wavelengths_nm == std::vector<double>{400, 500, 600});
  REQUIRE(list.f.rows() == 3);
  CHECK(list.f(1, 2) == 9.178033);
  // Mirror pair at 0.5: half vector on the normal, difference angle 0.5.
  CHECK(list.angles[0].theta_h == Approx(0).margin(1e-9));
  CHECK(list.angles[0].theta_d == Approx(0.5));
  // Light on the normal: half and difference angle are both half the other.
  CHECK(list.angles[2].theta_h == Approx(0.15));
  CHECK(list.angles[2].theta_d == Approx(0.15));
}

TEST_CASE("bands lie linearly between the neighbouring wavelengths") {
  const BinnedSamples samples = to_samples(parse_goniometric(kSpectral, "l"), {600, 525, 400});
  REQUIRE(samples.channels == 3);
  REQUIRE(samples.bins.size() == 3);
  CHECK(samples.bins[0].f[0] == 0.4);
  CHECK(samples.bins[0].f[1] == Approx(0.25));
  CHECK(samples.bins[0].f[2] == 0.1);
  CHECK(samples.bins[1].id == 1);
  CHECK(samples.bins[1].variance.isZero());
}

TEST_CASE("a list without wavelengths is R, G, B or one channel") {
  const BinnedSamples rgb =
      to_samples(parse_goniometric("0.1 0 0.2 1 0.3 0.4 0.5\n", "l"), {650, 550, 450});
  CHECK(rgb.channels == 3);
  CHECK(rgb.bins[0].f[2] == 0.5);
  const BinnedSamples mono = to_samples(parse_goniometric("0.1 0 0.2 1 0.3", "l"), {});
  CHECK(mono.channels == 1);
  CHECK(mono.bins[0].f[0] == 0.3);
}

TEST_CASE("a goniometric list that is wrong says in which line") {
  struct Bad {
    const char* from;
    const char* to;
    const char* said;
  };
  const std::vector<Bad> cases{
      {"0.2 0.4", "0.2 O.4", "list.brdf:10: 'O.4' is no number"},
      {"0.2 0.4", "0.2 0.4x", "list.brdf:10: '0.4x' is no number"},
      {"0.2 0.4", "0.2 -0.4", "list.brdf:10: value 3 is -0.4"},
      {"0.2 0.4", "0.2 nan", "list.brdf:10: value 3 is nan"},
      {"0.2 0.4", "0.2 inf", "list.brdf:10: value 3 is inf"},
      {"0.2 0.4", "0.2", "list.brdf:10: 6 numbers; expected 7"},
      {"0.01 0.02", "0.01 0.02 0.02", "list.brdf:12: 8 numbers; expected 7"},
      {"0.872665", "1.58", "list.brdf:11: theta_i 1.58"},
      {"0.573513", "-0.1", "list.brdf:11: theta_o -0.1"},
      {"-0.261799", "57", "list.brdf:11: phi_o 57"},
      {"-0.261799", "nan", "list.brdf:11: phi_o nan"},
      {"\n3\r", "\n0\r", "list.brdf:2: 0.0"},
      {"\n3\r", "\n2.5\r", "list.brdf:2: 2.5"},
      {"\n3\r", "\n2\r", "list.brdf:6: 1 numbers; expected four angles"},
      {"\n600", "\n600 700", "list.brdf:6: 4 wavelengths; expected 3"},
      {"400 500", "500 400", "list.brdf:5: wavelength 400"},
      {"400 500", "nan 500", "list.brdf:5: wavelength nan"},
  };
  for (const Bad& bad : cases) {
    const std::string message = complaint(replaced(kSpectral, bad.from, bad.to));
    INFO(bad.to << ": " << message);
    CHECK(contains(message, bad.said));
  }
  CHECK(contains(complaint(""), "list.brdf:0: no measurement"));
  CHECK(contains(complaint("# nothing\n"), "no measurement"));
  CHECK(contains(complaint("2\n400 500\n"), "no measurement"));
  CHECK(contains(complaint("2\n400\n"), "ends after 1 wavelengths"));
  CHECK(contains(complaint("0.1 0.2 0.3 0.4\n"), "4 numbers; expected four angles and values"));
  CHECK(contains(input_error([] { return read_goniometric("none.brdf").f.size(); }),
                 "none.brdf: cannot be read"));
}

TEST_CASE("bands and columns that a list has not are refused") {
  const GoniometricList list = parse_goniometric(kSpectral, "l");
  const auto message = [&](double band) {
    return input_error([&] { return to_samples(list, {500, band, 450}).channels; });
  };
  CHECK(contains(message(399), "outside the list's wavelengths; expected 400"));
  CHECK(contains(message(601), "band 601"));
  CHECK(contains(message(std::nan("")), "band nan"));
  const GoniometricList two = parse_goniometric("0.1 0 0.2 1 0.3 0.4\n", "l");
  CHECK(contains(input_error([&] { return to_samples(two, {}).channels; }), "2 values per line"));
}

TEST_CASE("a goniometric list is read from its file") {
  const TempDir dir;
  CHECK(read_goniometric(dir.write("a.brdf", kSpectral)).f.rows() == 3);
  CHECK(contains(input_error([&] { return read_goniometric(dir.path()).f.size(); }),
                 "cannot be read"));
}

TEST_CASE("chosen directions differ, come in the same order every time and grow by one") {
  const auto basis = test::small_basis();
  for (const auto criterion :
       {DirectionCriterion::expected_error, DirectionCriterion::determinant}) {
    const auto chosen = choose_directions(*basis, fan(), 12, criterion);
    CHECK(std::set<std::size_t>(chosen.begin(), chosen.end()).size() == 12);
    const auto fewer = choose_directions(*basis, fan(), 5, criterion);
    CHECK(std::equal(fewer.begin(), fewer.end(), chosen.begin()));
  }
  CHECK(
      choose_directions(*basis, fan(), int(fan().size()), DirectionCriterion::determinant).size() ==
      fan().size());
}

TEST_CASE("the first direction by the determinant has the longest row") {
  const auto basis = test::small_basis();
  const auto first = choose_directions(*basis, fan(), 1, DirectionCriterion::determinant).front();
  Eigen::Index longest = 0;
  basis->rows(fan()).q.rowwise().norm().maxCoeff(&longest);
  CHECK(first == static_cast<std::size_t>(longest));
}

TEST_CASE("each greedy choice is the best next one, by the covariance computed afresh") {
  const auto basis = test::small_basis();
  const std::vector<HalfDiff> directions = fan();
  const Eigen::MatrixXd q = basis->rows(directions).q;
  const auto mean_variance = [&](const std::vector<std::size_t>& chosen) {
    Eigen::MatrixXd precision = kRidgeEta * Eigen::MatrixXd::Identity(q.cols(), q.cols());
    for (const std::size_t i : chosen)
      precision += q.row(Eigen::Index(i)).transpose() * q.row(Eigen::Index(i));
    return (q * precision.inverse()).cwiseProduct(q).sum();
  };
  auto chosen = choose_directions(*basis, directions, 4, DirectionCriterion::expected_error);
  const double reached = mean_variance(chosen);
  for (std::size_t i = 0; i < directions.size(); ++i) {
    chosen.back() = i;
    CHECK(mean_variance(chosen) >= reached * (1 - 1e-9));
  }
}

TEST_CASE("as many directions as are wanted must be there") {
  const auto basis = test::small_basis();
  for (const int count : {0, -1, static_cast<int>(fan().size()) + 1}) {
    CHECK(contains(
        input_error([&] {
          return choose_directions(*basis, fan(), count, DirectionCriterion::determinant).size();
        }),
        "directions to choose: "));
  }
}
