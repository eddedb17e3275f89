#include "model/camera_calibration.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/calib3d.hpp>

#include "model/error.hpp"

namespace brdfgate {
namespace {

/// Share of the focal length by which its own sigma may blur it.
constexpr double kWorstFocalSigma = 0.02;

struct Correspondences {
  std::vector<std::vector<cv::Point3f>> board;
  std::vector<std::vector<cv::Point2f>> image;
};

Correspondences to_opencv(const std::vector<BoardView>& views) {
  Correspondences out;
  for (const BoardView& view : views) {
    auto& board = out.board.emplace_back();
    auto& image = out.image.emplace_back();
    for (std::size_t i = 0; i < view.board_m.size(); ++i) {
      board.emplace_back(static_cast<float>(view.board_m[i].x()),
                         static_cast<float>(view.board_m[i].y()), 0.0F);
      image.emplace_back(static_cast<float>(view.image_px[i].x()),
                         static_cast<float>(view.image_px[i].y()));
    }
  }
  return out;
}

cv::Mat_<double> matrix_of(const PinholeCamera& c) {
  return (cv::Mat_<double>(3, 3) << c.focal_px, 0, c.centre_px.x(), 0, c.focal_px, c.centre_px.y(),
          0, 0, 1);
}

cv::Mat_<double> coefficients_of(const LensDistortion& d) {
  return (cv::Mat_<double>(1, 5) << d.k1, d.k2, d.p1, d.p2, d.k3);
}

/// Pose of the camera in the frame of the board.
Eigen::Isometry3d camera_pose(const cv::Mat& rotation, const cv::Mat& translation) {
  cv::Matx33d R;
  cv::Rodrigues(rotation, R);
  Eigen::Isometry3d X_CB = Eigen::Isometry3d::Identity();
  X_CB.linear() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.val);
  X_CB.translation() = Eigen::Map<const Eigen::Vector3d>(translation.ptr<double>());
  return X_CB.inverse();
}

std::string text(double value, const char* unit) {
  char out[40];
  std::snprintf(out, sizeof out, "%.3g %s", value, unit);
  return out;
}

/// How a wrong tilt or place of view 0 shows: the angle between the camera's seen and nominal
/// directions to the plane.
void check_first_view(const CameraFit& fit, const PinholeCamera& nominal, const std::string& name) {
  const auto polar = [](const PinholeCamera& c) {
    return std::acos(std::clamp(-c.X_WC.linear()(2, 2), -1.0, 1.0));
  };
  const double off = std::abs(polar(fit.camera) - polar(nominal));
  if (off <= kMostTilt) return;
  throw InputError(name,
                   "the first board is tilted by " + text(off * 57.29578, "deg") +
                       " against the configured camera",
                   "first a recording of the board flat in the nest, then the tilted ones");
}

void check_errors(const CameraFit& fit, const std::vector<std::string>& names, double worst_rms) {
  for (std::size_t v = 0; v < names.size(); ++v) {
    if (fit.view_rms_px[v] <= worst_rms) continue;
    throw InputError(names[v],
                     "the board fits no pose: reprojection error " + text(fit.view_rms_px[v], "px"),
                     "under " + text(worst_rms, "px") +
                         ": a flat board with squares of the size given, held still");
  }
}

void add_errors(CameraFit& fit, const Correspondences& seen, const cv::Mat& K, const cv::Mat& D,
                const std::vector<cv::Mat>& rotation, const std::vector<cv::Mat>& translation) {
  for (std::size_t v = 0; v < seen.board.size(); ++v) {
    std::vector<cv::Point2f> fitted;
    cv::projectPoints(seen.board[v], rotation[v], translation[v], K, D, fitted);
    auto& errors = fit.errors_px.emplace_back();
    double squares = 0;
    for (std::size_t i = 0; i < fitted.size(); ++i) {
      const cv::Point2f e = seen.image[v][i] - fitted[i];
      errors.emplace_back(e.x, e.y);
      squares += errors.back().squaredNorm();
    }
    fit.view_rms_px.push_back(std::sqrt(squares / static_cast<double>(fitted.size())));
  }
}

/// Sigma of the camera's centre in W from that of view 0's rotation and translation: p_W = -R^T t.
void add_pose_sigma(CameraFit& fit, const cv::Mat& deviations) {
  const Eigen::Map<const Eigen::Matrix<double, 6, 1>> sigma(deviations.ptr<double>());
  fit.rotation_sigma = sigma.head<3>().maxCoeff();
  const Eigen::Matrix3d R = fit.camera.X_WC.linear();
  // Rotation and translation are taken as independent: an upper bound, they move together.
  const double arm = fit.camera.position().norm();
  const Eigen::Vector3d shift = (R.cwiseAbs2() * sigma.tail<3>().cwiseAbs2()).cwiseSqrt();
  fit.position_sigma_m = shift + Eigen::Vector3d::Constant(arm * fit.rotation_sigma);
}

int flags_for(bool intrinsics) {
  const int common = cv::CALIB_USE_INTRINSIC_GUESS | cv::CALIB_FIX_ASPECT_RATIO;
  if (intrinsics) return common | cv::CALIB_FIX_K3;
  return common | cv::CALIB_FIX_FOCAL_LENGTH | cv::CALIB_FIX_PRINCIPAL_POINT | cv::CALIB_FIX_K1 |
         cv::CALIB_FIX_K2 | cv::CALIB_FIX_K3 | cv::CALIB_FIX_TANGENT_DIST;
}

}  // namespace

CameraFit fit_camera(const std::vector<BoardView>& views, const SensorFormat& sensor,
                     const PinholeCamera& nominal, const std::vector<std::string>& names,
                     double worst_rms) {
  if (views.empty()) throw InputError("boards", "no view", "at least one, flat in the nest");
  const Correspondences seen = to_opencv(views);
  CameraFit fit;
  fit.intrinsics = views.size() >= kLeastViews;
  cv::Mat K = matrix_of(nominal);
  cv::Mat D = coefficients_of(nominal.distortion);
  std::vector<cv::Mat> rotation, translation;
  cv::Mat inner, outer, per_view;
  fit.rms_px =
      cv::calibrateCamera(seen.board, seen.image, {sensor.width, sensor.height}, K, D, rotation,
                          translation, inner, outer, per_view, flags_for(fit.intrinsics),
                          {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 200, 1e-12});
  fit.camera.focal_px = K.at<double>(0, 0);
  fit.camera.centre_px = {K.at<double>(0, 2), K.at<double>(1, 2)};
  const auto* d = D.ptr<double>();
  fit.camera.distortion = {d[0], d[1], d[2], d[3], d[4]};
  fit.camera.X_WC = camera_pose(rotation[0], translation[0]);
  if (fit.intrinsics) {
    fit.focal_sigma_px = std::max(inner.at<double>(0), inner.at<double>(1));  // one is held
    fit.centre_sigma_px = {inner.at<double>(2), inner.at<double>(3)};
  }
  add_pose_sigma(fit, outer);
  add_errors(fit, seen, K, D, rotation, translation);
  check_errors(fit, names, worst_rms);
  check_first_view(fit, nominal, names[0]);
  if (fit.focal_sigma_px > kWorstFocalSigma * fit.camera.focal_px) {
    throw InputError("boards",
                     "the views are too alike to tell the focal length (" +
                         text(fit.focal_sigma_px, "px") + " of uncertainty)",
                     "views tilted by 10 to 30 degrees in different directions");
  }
  return fit;
}

}  // namespace brdfgate
