#include "model/lamp_monitor.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr double kEdgeM = 0.001;
constexpr std::size_t kLeastCells = 50;
/// A cell off the median by more than this is no noise of a patch that fills half of full well.
constexpr double kForeign = 0.1;
constexpr double kMostForeign = 0.1;

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Mean of what lies within a tenth of the median: as robust, and a fifth less noisy.
double trimmed_mean(std::vector<double>& values) {
  const double middle = median(values);
  double sum = 0, count = 0;
  for (const double x : values) {
    if (!(std::abs(x - middle) <= kForeign * std::abs(middle))) continue;
    sum += x;
    count += 1;
  }
  return sum / count;
}

/// f of the usable cells, channel by channel.
std::vector<std::vector<double>> cell_values(const Radiance& now, const Radiance& white,
                                             const std::array<double, 3>& white_reflectance,
                                             const std::vector<cv::Point>& cells) {
  const int channels = now.value.channels();
  std::vector<std::vector<double>> f(static_cast<std::size_t>(channels));
  for (const cv::Point& at : cells) {
    if (now.mask.at<unsigned char>(at) != 0 || white.mask.at<unsigned char>(at) != 0) continue;
    const float* x = now.value.ptr<float>(at.y) + at.x * channels;
    const float* reference = white.value.ptr<float>(at.y) + at.x * channels;
    if (!std::all_of(reference, reference + channels, [](float r) { return r > 0; })) continue;
    for (std::size_t c = 0; c < f.size(); ++c) {
      f[c].push_back(white_reflectance[c] / std::numbers::pi * static_cast<double>(x[c]) /
                     reference[c]);
    }
  }
  return f;
}

/// Over a tenth of the cells, channels summed, are not what the others are.
bool covered(const std::vector<std::vector<double>>& f) {
  std::vector<double> sum(f.front().size());
  for (const auto& channel : f)
    std::transform(sum.begin(), sum.end(), channel.begin(), sum.begin(), std::plus<>());
  std::vector<double> sorted = sum;
  const double middle = median(sorted);
  const auto foreign = std::count_if(sum.begin(), sum.end(), [&](double s) {
    return !(std::abs(s - middle) <= kForeign * std::abs(middle));
  });
  return static_cast<double>(foreign) > kMostForeign * static_cast<double>(sum.size());
}

void check(const std::vector<Radiance>& lights, const Calibration& calibration) {
  if (lights.size() != calibration.white.size()) {
    throw InputError("capture", std::to_string(lights.size()) + " lights",
                     std::to_string(calibration.white.size()) + " as calibrated");
  }
  for (std::size_t l = 0; l < lights.size(); ++l) {
    const cv::Mat& white = calibration.white[l].value;
    if (lights[l].value.size() != white.size() || lights[l].value.type() != white.type()) {
      throw InputError("light " + std::to_string(l + 1), "an image of another size or kind",
                       "as calibrated");
    }
  }
}

LampLevel level_of(const Radiance& now, const Calibration& calibration, std::size_t light,
                   const std::vector<cv::Point>& cells, const Eigen::Array3d& expected) {
  LampLevel level;
  level.channels = now.value.channels();
  auto f = cell_values(now, calibration.white[light], calibration.white_reflectance, cells);
  const std::size_t usable = f.front().size();
  if (usable < kLeastCells || 2 * usable < cells.size() || covered(f)) return level;
  Eigen::Array3d ratio = Eigen::Array3d::Ones();
  for (std::size_t c = 0; c < f.size(); ++c)
    ratio[static_cast<Eigen::Index>(c)] =
        trimmed_mean(f[c]) / expected[static_cast<Eigen::Index>(c)];
  level.known = ratio.allFinite() && (ratio > 0).all();
  if (level.known) level.ratio = ratio;
  return level;
}

}  // namespace

double LampLevel::drift() const {
  return known ? ratio.head(channels).mean() - 1 : std::numeric_limits<double>::quiet_NaN();
}

std::vector<cv::Point> patch_cells(const StationGeometry& geometry, const SensorFormat& sensor,
                                   const MonitorPatch& patch) {
  const Eigen::Array2d edge = (patch.size_m.array() / 4).min(kEdgeM);
  const Eigen::Array2d half = patch.size_m.array() / 2 - edge;
  const Eigen::Vector3d eye = geometry.camera.position();
  std::vector<cv::Point> cells;
  for (int v = 0; v < sensor.cells().height; ++v) {
    for (int u = 0; u < sensor.cells().width; ++u) {
      const Eigen::Vector3d ray = geometry.camera.ray_W(cell_centre_px(sensor, u, v));
      if (!(ray.z() < 0)) continue;
      const Eigen::Vector3d p_W = eye - eye.z() / ray.z() * ray;
      if (((p_W.head<2>() - patch.at_m).array().abs() <= half).all()) cells.emplace_back(u, v);
    }
  }
  return cells;
}

std::vector<Eigen::Array3d> patch_reflectance(const MonitorPatch& patch,
                                              const Calibration& calibration) {
  if (!calibration.patch_f.empty()) return calibration.patch_f;
  return {calibration.white.size(), patch.albedo / std::numbers::pi};
}

std::vector<LampLevel> lamp_levels(const std::vector<Radiance>& lights,
                                   const Calibration& calibration,
                                   const std::vector<cv::Point>& cells,
                                   const std::vector<Eigen::Array3d>& expected) {
  check(lights, calibration);
  std::vector<LampLevel> levels;
  for (std::size_t l = 0; l < lights.size(); ++l)
    levels.push_back(level_of(lights[l], calibration, l, cells, expected.at(l)));
  return levels;
}

std::vector<Eigen::Array3d> measure_patch(const std::vector<Radiance>& lights,
                                          const Calibration& calibration,
                                          const MonitorPatch& patch) {
  const auto cells = patch_cells(calibration.geometry, calibration.sensor, patch);
  const std::vector<Eigen::Array3d> one(lights.size(), Eigen::Array3d::Ones());
  std::vector<Eigen::Array3d> f;
  for (const LampLevel& level : lamp_levels(lights, calibration, cells, one)) {
    if (!level.known) {
      throw InputError("monitor patch under light " + std::to_string(f.size() + 1),
                       "is covered, dirty, clipped or out of view",
                       "the open nest with the patch where inspection.monitor says");
    }
    f.push_back(level.ratio);
  }
  return f;
}

}  // namespace brdfgate
