#include <Eigen/Geometry>
#include <cmath>
#include <complex>
#include <vector>

#include "catch.hpp"
#include "model/tilted_registration.hpp"

using namespace brdfgate;

namespace {

constexpr double kDegree = EIGEN_PI / 180;

/// A square part of 80 mm, without a cut corner, on a grid of half a millimetre.
TaughtLayout square_layout(bool cut) {
  TaughtLayout layout;
  layout.pitch_m = kLayoutPitch;
  layout.label = cv::Mat(201, 201, CV_8UC1, cv::Scalar(kNotPart));
  layout.label(cv::Rect(20, 20, 161, 161)) = 0;
  if (cut) layout.label(cv::Rect(20, 20, 60, 40)) = kNotPart;
  return layout;
}

Eigen::Vector3d eye() {
  return 0.18 * Eigen::Vector3d(std::sin(55 * kDegree), 0, std::cos(55 * kDegree));
}

/// Where the plane shows a point of a part that lies tilted: the long way, by a line in the world.
Eigen::Vector2d shown(const Eigen::Vector2d& p_P, const PartPose& lie) {
  const Eigen::Vector3d p_W =
      lie.rotation() * Eigen::Vector3d(p_P.x(), p_P.y(), 0) + Eigen::Vector3d(0, 0, lie.height_m);
  const Eigen::Vector3d ray = p_W - eye();
  return (eye() + ray * (eye().z() / -ray.z())).head<2>();
}

/// The rigid motion that a registration finds: least squares over the part.
PlanarPose registered(const TaughtLayout& layout, const PlanarPose& truth, const PartPose& lie) {
  using Point = std::complex<double>;
  std::vector<Point> from, to;
  Point from_mean = 0, to_mean = 0;
  for (int v = 0; v < layout.label.rows; v += 4) {
    for (int u = 0; u < layout.label.cols; u += 4) {
      if (layout.label.at<unsigned char>(v, u) == kNotPart) continue;
      const Eigen::Vector2d q = layout.pitch_m * Eigen::Vector2d(u - 100, v - 100);
      const Eigen::Vector2d p = shown(Eigen::Rotation2Dd(truth.rotation) * q + truth.shift_m, lie);
      from_mean += from.emplace_back(q.x(), q.y());
      to_mean += to.emplace_back(p.x(), p.y());
    }
  }
  const auto n = static_cast<double>(from.size());
  from_mean /= n;
  to_mean /= n;
  Point turn = 0;
  for (std::size_t i = 0; i < from.size(); ++i)
    turn += std::conj(from[i] - from_mean) * (to[i] - to_mean);
  turn /= std::abs(turn);
  const Point shift = to_mean - turn * from_mean;
  return {{shift.real(), shift.imag()}, std::arg(turn)};
}

}  // namespace

TEST_CASE("A tilt reads as a rotation, and is taken out of it", "[registration]") {
  struct Row {
    PartPose lie;
    PlanarPose truth;
    double turned_deg;  ///< by which the registered rotation is off, about
  };
  const Row rows[] = {{{0.3 * kDegree, 0, 0}, {{0, 0}, 0}, 0.21},
                      {{-0.3 * kDegree, 0, 0}, {{0.003, -0.002}, 4.8 * kDegree}, -0.21},
                      {{0, 0.3 * kDegree, 0}, {{0.003, 0.003}, -4 * kDegree}, 0},
                      {{0.2 * kDegree, -0.3 * kDegree, 0.0004}, {{-0.003, 0.001}, 0.04}, 0.14}};
  for (const bool cut : {false, true}) {
    const TaughtLayout layout = square_layout(cut);
    for (const Row& row : rows) {
      const PlanarPose seen = registered(layout, row.truth, row.lie);
      CAPTURE(cut, row.lie.tilt_x, row.lie.tilt_y, row.truth.rotation, seen.rotation);
      CHECK((seen.rotation - row.truth.rotation) / kDegree == Approx(row.turned_deg).margin(0.06));
      const PlanarPose told = without_tilt(layout, seen, row.lie, eye());
      CHECK((told.rotation - row.truth.rotation) / kDegree == Approx(0).margin(0.01));
      CHECK((told.shift_m - row.truth.shift_m).norm() < 3e-5);
    }
  }
}

TEST_CASE("A part that lies as taught keeps its registered pose", "[registration]") {
  const PlanarPose seen{{0.001, -0.002}, 0.03};
  const PlanarPose told = without_tilt(square_layout(false), seen, {}, eye());
  CHECK(told.rotation == seen.rotation);
  CHECK(told.shift_m == seen.shift_m);
  TaughtLayout nothing;
  CHECK(without_tilt(nothing, seen, {0.01, 0, 0}, eye()).rotation == seen.rotation);
}
