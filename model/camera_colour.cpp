#include "model/camera_colour.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr double kInnerHalf = 0.25;  ///< of a patch's side, from its centre
constexpr int kLeastCells = 20;
constexpr double kUneven = 0.10;         ///< RMS over the cells beyond noise, relative
constexpr double kDarkestUneven = 0.01;  ///< of white: below it, unevenness is that of white
constexpr double kWorstMean = 5;         ///< CIEDE2000

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

/// Sums over one patch's cells.
struct PatchSum {
  int cells = 0;
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  Eigen::Array3d squares = Eigen::Array3d::Zero();
  Eigen::Array3d noise = Eigen::Array3d::Zero();  ///< variances

  void add(const cv::Vec3f& f, const cv::Vec3f& variance) {
    ++cells;
    for (int c = 0; c < 3; ++c) {
      const double x = std::numbers::pi * static_cast<double>(f[c]);
      sum[c] += x;
      squares[c] += x * x;
      noise[c] += std::numbers::pi * std::numbers::pi * static_cast<double>(variance[c]);
    }
  }
  Eigen::Array3d mean() const { return sum / cells; }
  /// RMS departure from the mean that noise does not explain.
  Eigen::Array3d unevenness() const {
    return ((squares - noise) / cells - mean().square()).max(0.0).sqrt();
  }
};

std::vector<PatchSum> patch_sums(const Reflectance& f, const Calibration& calibration,
                                 const ColourChart& chart) {
  std::vector<PatchSum> sums(chart.patches.size());
  const PinholeCamera& camera = calibration.geometry.camera;
  const Eigen::Vector3d eye = camera.position();
  for (int v = 0; v < f.value.rows; ++v) {
    for (int u = 0; u < f.value.cols; ++u) {
      if ((f.mask.at<unsigned char>(v, u) & (kClipped | kInvalid)) != 0) continue;
      const Eigen::Vector3d ray = camera.ray_W(cell_centre_px(calibration.sensor, u, v));
      if (!(ray.z() < 0)) continue;
      const Eigen::Vector2d p = (eye - eye.z() / ray.z() * ray).head<2>();
      const std::size_t patch = chart.patch_at(p);
      if (patch == chart.patches.size()) continue;
      const Eigen::Array2d from = (p - chart.centre_m(patch)).array().abs();
      if ((from <= kInnerHalf * chart.patch_m).all())
        sums[patch].add(f.value.at<cv::Vec3f>(v, u), f.variance.at<cv::Vec3f>(v, u));
    }
  }
  return sums;
}

/// The transformed BRDF: linear sRGB of what the camera's channels say.
class LinearSrgb final : public Brdf {
 public:
  LinearSrgb(BrdfPtr camera, CameraColour colour)
      : camera_(std::move(camera)), colour_(std::move(colour)) {}
  Rgb diffuse(double theta_d) const override { return srgb(camera_->diffuse(theta_d)); }
  /// Roots do not add: the rest of the whole, so that both parts sum to it.
  Rgb specular(const HalfDiff& angles) const override {
    const Rgb diffuse = camera_->diffuse(angles.theta_d);
    return srgb(diffuse + camera_->specular(angles)) - srgb(diffuse);
  }

 private:
  Rgb srgb(const Rgb& rgb) const { return xyz_to_linear_srgb(colour_.xyz(rgb)); }

  BrdfPtr camera_;
  CameraColour colour_;
};

}  // namespace

Eigen::VectorXd colour_terms(ColourModel model, const Eigen::Array3d& rgb) {
  if (model == ColourModel::matrix) return rgb.matrix();
  const Eigen::Array3d x = rgb.max(0.0);
  Eigen::VectorXd terms(6);
  terms << rgb[0], rgb[1], rgb[2], std::sqrt(x[0] * x[1]), std::sqrt(x[1] * x[2]),
      std::sqrt(x[0] * x[2]);
  return terms;
}

Eigen::Matrix3d CameraColour::xyz_slope(const Eigen::Array3d& rgb) const {
  if (model == ColourModel::matrix) return to_xyz;
  // d sqrt(xy) / dx = sqrt(y / x) / 2; held where x is (nearly) 0.
  constexpr double kDarkest = 1e-9;
  const Eigen::Array3d x = rgb.max(kDarkest);
  const auto half_ratio = [&](int over, int under) { return std::sqrt(x[over] / x[under]) / 2; };
  Eigen::Matrix<double, 6, 3> terms;
  terms.topRows(3).setIdentity();
  terms.row(3) << half_ratio(1, 0), half_ratio(0, 1), 0;
  terms.row(4) << 0, half_ratio(2, 1), half_ratio(1, 2);
  terms.row(5) << half_ratio(2, 0), 0, half_ratio(0, 2);
  return to_xyz * terms;
}

Eigen::Array3d CameraColour::xyz(const Eigen::Array3d& rgb) const {
  return (to_xyz * colour_terms(model, rgb)).array();
}

std::vector<Eigen::Array3d> chart_rgb(const std::vector<Reflectance>& f,
                                      const Calibration& calibration, const ColourChart& chart) {
  if (f.size() < 2 || f[1].value.type() != CV_32FC3) {
    throw InputError("chart", "no colour image under light 2", "a colour sensor and two lights");
  }
  std::vector<Eigen::Array3d> rgb;
  for (const PatchSum& sum : patch_sums(f[1], calibration, chart)) {
    const std::string where = "chart patch '" + chart.patches[rgb.size()].name + "'";
    if (sum.cells < kLeastCells) {
      throw InputError(where, std::to_string(sum.cells) + " usable cells of it are in view",
                       "the whole chart under the camera, not clipped");
    }
    const Eigen::Array3d mean = sum.mean();
    const double uneven = (sum.unevenness() / mean.max(kDarkestUneven)).maxCoeff();
    if (uneven > kUneven) {
      throw InputError(where, "is not uniform: " + number(100 * uneven) + " % rms",
                       "the chart centred and square in the nest, as its file says");
    }
    rgb.push_back(mean);
  }
  return rgb;
}

std::vector<double> chart_residuals(const CameraColour& colour,
                                    const std::vector<Eigen::Array3d>& rgb,
                                    const ColourChart& chart) {
  std::vector<double> out;
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    out.push_back(delta_e00(xyz_to_lab(chart.patches[i].xyz), xyz_to_lab(colour.xyz(rgb[i]))));
  }
  return out;
}

CameraColour fit_camera_colour(const std::vector<Eigen::Array3d>& rgb, const ColourChart& chart,
                               ColourModel model) {
  CameraColour colour;
  colour.model = model;
  colour.chart = chart.name;
  colour.illuminant = chart.illuminant;
  const Eigen::Index terms = colour_terms(model, Eigen::Array3d::Ones()).size();
  if (rgb.size() != chart.patches.size() || static_cast<Eigen::Index>(rgb.size()) <= terms) {
    throw InputError(
        "chart '" + chart.name + "'", std::to_string(rgb.size()) + " colours seen",
        std::to_string(chart.patches.size()) + " patches, more than " + std::to_string(terms));
  }
  // J (M t - xyz) for every patch: linear in the elements of M, taken column by column.
  Eigen::MatrixXd A(3 * static_cast<Eigen::Index>(rgb.size()), 3 * terms);
  Eigen::VectorXd b(A.rows());
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    const auto row = 3 * static_cast<Eigen::Index>(i);
    const Eigen::Matrix3d slope = lab_slope(chart.patches[i].xyz);
    const Eigen::VectorXd t = colour_terms(model, rgb[i]);
    for (Eigen::Index k = 0; k < terms; ++k)
      A.block(row, 3 * k, 3, 3) = t[k] * slope;
    b.segment(row, 3) = slope * chart.patches[i].xyz.matrix();
  }
  const Eigen::VectorXd x = A.colPivHouseholderQr().solve(b);
  colour.to_xyz = Eigen::Map<const Eigen::MatrixXd>(x.data(), 3, terms);
  const std::vector<double> residuals = chart_residuals(colour, rgb, chart);
  const auto worst = std::max_element(residuals.begin(), residuals.end());
  colour.de00_max = *worst;
  for (const double r : residuals)
    colour.de00_mean += r / static_cast<double>(residuals.size());
  if (!(colour.de00_mean <= kWorstMean)) {
    throw InputError("chart '" + chart.name + "'",
                     "its patches differ by " + number(colour.de00_mean) +
                         " CIEDE2000 on average; the worst is '" +
                         chart.patches[static_cast<std::size_t>(worst - residuals.begin())].name +
                         "'",
                     "under " + number(kWorstMean) + ": this chart, upright and in its place");
  }
  return colour;
}

BrdfPtr in_linear_srgb(const BrdfPtr& camera, const CameraColour& colour) {
  return std::make_shared<LinearSrgb>(camera, colour);
}

}  // namespace brdfgate
