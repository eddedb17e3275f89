#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "catch.hpp"
#include "model/registration.hpp"
#include "support/input_error.hpp"
#include "support/synthetic_part.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

/// A part of 60 x 50 mm with a bar and, unless it is missing, a disc printed on it; turned in its
/// nest, because cells have hard edges here and an edge along them could lie anywhere within one.
int printed_part(double x_nest, double y_nest, bool with_disc = true) {
  const Eigen::Vector2d turned = Eigen::Rotation2Dd(0.3) * Eigen::Vector2d(x_nest, y_nest);
  const double x = turned.x(), y = turned.y();
  if (std::abs(x) > 0.030 || std::abs(y) > 0.025) return kNotPart;
  if (std::abs(y + 0.012) < 0.004 && std::abs(x) < 0.02) return 1;
  if (with_disc && std::hypot(x - 0.012, y - 0.01) < 0.007) return 1;
  return 0;
}

const SyntheticStation& station() {
  static const SyntheticStation made(182, 136);
  return made;
}

RegionAt posed(const PlanarPose& pose, bool with_disc = true) {
  return [pose, with_disc](double x, double y) {
    const Eigen::Vector2d q = pose.to_taught({x, y});
    return printed_part(q.x(), q.y(), with_disc);
  };
}

std::vector<Reflectance> seen(const RegionAt& region, unsigned seed = 1) {
  SyntheticPart part;
  part.region = region;
  part.materials = {shiny({0.3, 0.1, 0.05}, Rgb::Constant(0.04), 0.25), matte({0.1, 0.2, 0.3})};
  part.seed = seed;
  return render(station(), part);
}

TaughtLayout taught() {
  static const TaughtLayout layout = [] {
    const RegionAt region = posed({});
    return make_layout(seen(region), station().map.cells, {true_labels(station(), region), 2, 1.0});
  }();
  return layout;
}

Registration registered(const RegionAt& region, unsigned seed = 2) {
  return register_part(taught(), seen(region, seed), station().map.cells,
                       true_not_part(station(), region));
}

}  // namespace

TEST_CASE("A part's shift and rotation are found to a fraction of a cell", "[registration]") {
  const double deg = std::numbers::pi / 180;
  const PlanarPose poses[] = {{},
                              {{0.0005, -0.0005}, 0},
                              {{0.005, 0}, 0},
                              {{-0.0035, 0.0035}, 5 * deg},
                              {{0.002, 0.003}, -5 * deg},
                              {{0, 0}, 4 * deg}};
  unsigned seed = 10;
  for (const PlanarPose& pose : poses) {
    const Registration found = registered(posed(pose), seed++);
    CAPTURE(pose.shift_m.transpose(), pose.rotation, found.pose.shift_m.transpose(),
            found.pose.rotation, found.agreement);
    // Cells are 0.45 mm wide and 0.8 mm deep here.
    CHECK((found.pose.shift_m - pose.shift_m).norm() < 2.2e-4);
    CHECK(std::abs(found.pose.rotation - pose.rotation) < 0.2 * deg);
    CHECK(found.agreement > 0.9);
  }
}

TEST_CASE("A missing print does not pull the part away", "[registration]") {
  const PlanarPose pose{{0.002, -0.001}, 0.03};
  const Registration found = registered(posed(pose, false));
  CHECK((found.pose.shift_m - pose.shift_m).norm() < 3e-4);
  CHECK(std::abs(found.pose.rotation - pose.rotation) < 0.005);
  CHECK(found.agreement > kLeastAgreement);
}

TEST_CASE("A part larger than the view lies where it was taught", "[registration]") {
  const RegionAt everywhere = [](double, double) { return 0; };
  const TaughtLayout plain = make_layout(seen(everywhere), station().map.cells,
                                         {true_labels(station(), everywhere), 1, 1.0});
  const Registration found = register_part(plain, seen(everywhere, 5), station().map.cells,
                                           true_not_part(station(), everywhere));
  CHECK(found.pose.shift_m.norm() < 5e-4);
  CHECK(std::abs(found.pose.rotation) < 0.01);
  CHECK(found.agreement > kLeastAgreement);
}

TEST_CASE("Another part does not agree", "[registration]") {
  const RegionAt disc = [](double x, double y) {
    return std::hypot(x + 0.02, y) < 0.012 ? 0 : int{kNotPart};
  };
  CHECK(registered(disc).agreement < kLeastAgreement);
}

TEST_CASE("The taught labels follow the part", "[registration]") {
  const PlanarPose pose{{0.004, -0.003}, 0.08};
  const cv::Mat expected = expected_labels(taught(), pose, station().map.cells);
  const cv::Mat truth = true_labels(station(), posed(pose));
  const cv::Mat inside = station().map.cells.inside;
  const double wrong = cv::countNonZero((expected != truth) & inside);
  CHECK(wrong / cv::countNonZero(inside) < 0.06);  // cells on a border
  cv::Mat core;
  cv::erode(truth == 1, core, cv::getStructuringElement(cv::MORPH_RECT, {7, 7}));
  CHECK(cv::countNonZero(core) > 20);
  CHECK(cv::countNonZero((expected != 1) & core) == 0);
}

TEST_CASE("Registration refuses what was not taught or does not fit", "[registration]") {
  const auto r = seen(posed({}));
  const cv::Mat not_part = true_not_part(station(), posed({}));
  CHECK(contains(input_error([&] { return register_part({}, r, station().map.cells, not_part); }),
                 "no layout was taught"));
  CHECK(contains(input_error([&] {
                   return register_part(taught(), r, station().map.cells,
                                        cv::Mat::zeros(3, 4, CV_8UC1));
                 }),
                 "4 x 3 cells against"));
}
