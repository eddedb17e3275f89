#include "model/posed_view.hpp"

#include <cmath>
#include <numbers>

namespace brdfgate {
namespace {

/// to_half_diff() in single precision; phi_d in [0, pi).
cv::Vec3f half_diff(const Eigen::Vector3f& wi, const Eigen::Vector3f& wo) {
  constexpr auto kPi = std::numbers::pi_v<float>;
  const Eigen::Vector3f sum = wi + wo;
  const float length = sum.norm();
  const Eigen::Vector3f h = sum / length;
  const float sin_h = std::sqrt(h.x() * h.x() + h.y() * h.y());
  const float cos_phi = sin_h > 0 ? h.x() / sin_h : 1.0F;
  const float sin_phi = sin_h > 0 ? h.y() / sin_h : 0.0F;
  const float x = cos_phi * wi.x() + sin_phi * wi.y();
  const float y = cos_phi * wi.y() - sin_phi * wi.x();
  float phi = std::atan2(y, x * h.z() - wi.z() * sin_h);
  if (phi < 0) phi += kPi;
  if (phi >= kPi) phi -= kPi;
  return {std::atan2(sin_h, h.z()), std::atan2((wi - wo).norm(), length), phi};
}

}  // namespace

PosedView::PosedView(const StationGeometry& taught, std::size_t light, const PartPose& pose)
    : light_W_(taught.lights_W[light].cast<float>()),
      R_PW_(pose.rotation().transpose().cast<float>()),
      t_PW_((-pose.rotation().transpose() * Eigen::Vector3d(0, 0, pose.height_m)).cast<float>()),
      eye_P_(R_PW_ * taught.camera.position().cast<float>() + t_PW_),
      light_P_(R_PW_ * light_W_ + t_PW_) {}

PosedView::Seen PosedView::see(const cv::Vec2f& at) const {
  const Eigen::Vector3f p_W(at[0], at[1], 0);
  const Eigen::Vector3f ray_P = R_PW_ * p_W + t_PW_ - eye_P_;
  const Eigen::Vector3f p_P = eye_P_ - ray_P * (eye_P_.z() / ray_P.z());
  const Eigen::Vector3f to_light_P = light_P_ - p_P;
  const Eigen::Vector3f to_eye_P = eye_P_ - p_P;
  Seen seen;
  seen.above = to_light_P.z() > 0 && to_eye_P.z() > 0;
  if (!seen.above) return seen;
  const float square_P = to_light_P.squaredNorm();
  const float distance_P = std::sqrt(square_P);
  const Eigen::Vector3f to_light_W = light_W_ - p_W;
  const float square_W = to_light_W.squaredNorm();
  seen.gain =
      to_light_W.z() / (square_W * std::sqrt(square_W)) * (square_P * distance_P) / to_light_P.z();
  seen.angles = half_diff(to_light_P / distance_P, to_eye_P.normalized());
  return seen;
}

}  // namespace brdfgate
