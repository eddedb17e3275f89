#include "model/tilted_registration.hpp"

#include <Eigen/Geometry>
#include <cmath>

namespace brdfgate {
namespace {

/// Step over the layout's grid: a few hundred points tell three numbers.
constexpr int kStep = 6;

/// Points of the plane, in turn, on a part that lies so.
class OnPart {
 public:
  OnPart(const PartPose& lie, const Eigen::Vector3d& eye_W)
      : R_PW_(lie.rotation().transpose()),
        lift_W_(0, 0, lie.height_m),
        eye_P_(R_PW_ * (eye_W - lift_W_)) {}

  Eigen::Vector2d operator()(const Eigen::Vector2d& p_W) const {
    const Eigen::Vector3d p_P = R_PW_ * (Eigen::Vector3d(p_W.x(), p_W.y(), 0) - lift_W_);
    const Eigen::Vector3d ray = p_P - eye_P_;
    return (eye_P_ - ray * (eye_P_.z() / ray.z())).head<2>();
  }

 private:
  Eigen::Matrix3d R_PW_;
  Eigen::Vector3d lift_W_;
  Eigen::Vector3d eye_P_;
};

/// Sums over pairs of points, for the rigid motion from one to the other.
struct PairSums {
  double n = 0;
  Eigen::Vector2d from = Eigen::Vector2d::Zero(), to = Eigen::Vector2d::Zero();
  double dot = 0, cross = 0;

  void add(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    ++n;
    from += a;
    to += b;
    dot += a.dot(b);
    cross += a.x() * b.y() - a.y() * b.x();
  }
  PlanarPose motion() const {
    const double along = dot - from.dot(to) / n;
    const double across = cross - (from.x() * to.y() - from.y() * to.x()) / n;
    const double turn = std::atan2(across, along);
    return {(to - Eigen::Rotation2Dd(turn) * from) / n, turn};
  }
};

}  // namespace

PlanarPose without_tilt(const TaughtLayout& layout, const PlanarPose& seen, const PartPose& lie,
                        const Eigen::Vector3d& eye_W) {
  if (lie.none()) return seen;
  const OnPart on_part(lie, eye_W);
  const Eigen::Rotation2Dd turn(seen.rotation);
  PairSums sums;
  const double middle = 0.5 * (layout.label.rows - 1);
  for (int v = 0; v < layout.label.rows; v += kStep) {
    for (int u = 0; u < layout.label.cols; u += kStep) {
      if (layout.label.at<unsigned char>(v, u) == kNotPart) continue;
      const Eigen::Vector2d q = layout.pitch_m * Eigen::Vector2d(u - middle, v - middle);
      sums.add(q, on_part(turn * q + seen.shift_m));
    }
  }
  return sums.n < 3 ? seen : sums.motion();
}

}  // namespace brdfgate
