// find_highlight of model/light_fit.hpp.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "model/light_fit.hpp"

namespace brdfgate {
namespace {

constexpr double kLeastContrast = 10;
constexpr double kTop = 0.5;  // of the peak
constexpr int kLeastCells = 12;
/// A gauge's own flatness and seating: no highlight knows the normal better, radians.
constexpr double kGaugeSigma = 2e-4;

cv::Mat summed(const cv::Mat& value) {
  if (value.channels() == 1) return value;
  cv::Mat sum;
  cv::transform(value, sum, cv::Matx13f::ones());
  return sum;
}

double median(const cv::Mat& image) {
  std::vector<float> values(image.begin<float>(), image.end<float>());
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The cells above half of the peak.
struct Top {
  Eigen::MatrixXd terms;  ///< 1, x, y, x^2, x y, y^2, by cell from the centroid
  Eigen::VectorXd level;  ///< ln X
  Eigen::VectorXd weight;
  Eigen::Vector2d centroid;
};

std::optional<Top> top_of(const cv::Mat& grey, const cv::Mat& mask, double peak) {
  std::vector<cv::Point> cells;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (int v = 0; v < grey.rows; ++v) {
    for (int u = 0; u < grey.cols; ++u) {
      if (grey.at<float>(v, u) < kTop * peak) continue;
      const bool border = u == 0 || v == 0 || u + 1 == grey.cols || v + 1 == grey.rows;
      if (border || mask.at<unsigned char>(v, u) != 0) return std::nullopt;
      cells.emplace_back(u, v);
      sum += Eigen::Vector2d(u, v);
    }
  }
  if (cells.size() < kLeastCells) return std::nullopt;
  Top top;
  const auto n = static_cast<Eigen::Index>(cells.size());
  top.centroid = sum / static_cast<double>(n);
  top.terms.resize(n, 6);
  top.level.resize(n);
  top.weight.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const cv::Point& at = cells[static_cast<std::size_t>(i)];
    const double x = at.x - top.centroid.x();
    const double y = at.y - top.centroid.y();
    top.terms.row(i) << 1, x, y, x * x, x * y, y * y;
    top.level[i] = std::log(grey.at<float>(at));
    top.weight[i] = grey.at<float>(at) / peak;
  }
  return top;
}

/// Where the parabola through the cells is highest, and how far a residual's noise moves it.
struct Peak {
  Eigen::Vector2d cell;
  Eigen::Vector2d sigma;
};

std::optional<Peak> parabola_peak(const Top& top) {
  const Eigen::MatrixXd A = top.weight.asDiagonal() * top.terms;
  const Eigen::VectorXd b = top.weight.cwiseProduct(top.level);
  const Eigen::MatrixXd normal = A.transpose() * A;
  const Eigen::LDLT<Eigen::MatrixXd> solver(normal);
  const Eigen::VectorXd c = solver.solve(A.transpose() * b);
  Eigen::Matrix2d H;
  H << 2 * c[3], c[4], c[4], 2 * c[5];
  if (!(H(0, 0) < 0 && H.determinant() > 0)) return std::nullopt;
  const Eigen::Vector2d at = -H.inverse() * c.segment<2>(1);
  const double variance = (A * c - b).squaredNorm() / static_cast<double>(b.size() - 6);
  const Eigen::MatrixXd covariance = variance * solver.solve(Eigen::MatrixXd::Identity(6, 6));
  const Eigen::Matrix2d shift = H.inverse() * covariance.block<2, 2>(1, 1) * H.inverse();
  return Peak{top.centroid + at, shift.diagonal().cwiseSqrt()};
}

Eigen::Vector2d on_plane(const PinholeCamera& camera, const SensorFormat& sensor,
                         const Eigen::Vector2d& cell) {
  const Eigen::Vector2d first = cell_centre_px(sensor, 0, 0);
  const double step = cell_centre_px(sensor, 1, 0).x() - first.x();
  const Eigen::Vector3d ray = camera.ray_W(first + step * cell);
  const Eigen::Vector3d eye = camera.position();
  return (eye - eye.z() / ray.z() * ray).head<2>();
}

}  // namespace

std::optional<Highlight> find_highlight(const Radiance& gauge, std::size_t light,
                                        const PinholeCamera& camera, const SensorFormat& sensor) {
  const cv::Mat grey = summed(gauge.value);
  double peak = 0;
  cv::minMaxLoc(grey, nullptr, &peak);
  if (!(peak > kLeastContrast * std::max(0.0, median(grey))) || !(peak > 0)) return std::nullopt;
  const auto top = top_of(grey, gauge.mask, peak);
  if (!top) return std::nullopt;
  const auto found = parabola_peak(*top);
  if (!found) return std::nullopt;
  Highlight out;
  out.light = light;
  out.at_m = on_plane(camera, sensor, found->cell);
  // A step on the plane turns the half vector by about that over the camera's distance.
  const Eigen::Vector2d moved = on_plane(camera, sensor, found->cell + found->sigma) - out.at_m;
  const double turn = moved.norm() / camera.position().norm();
  out.normal_sigma = std::hypot(turn, kGaugeSigma);
  return out;
}

}  // namespace brdfgate
