#include "model/white_factor.hpp"

#include <algorithm>

#include "model/error.hpp"

namespace brdfgate {
namespace {

void check(const WhiteFactorTable& table, std::size_t lights) {
  if (table.lights.size() != lights) {
    throw InputError("white factor table", std::to_string(table.lights.size()) + " lights",
                     std::to_string(lights) + " as calibrated");
  }
  for (std::size_t l = 0; l < lights; ++l) {
    const std::string where = "white factor table, light " + std::to_string(l + 1);
    if (table.lights[l].empty()) throw InputError(where, "no figure", "one or more");
    for (std::size_t i = 0; i < table.lights[l].size(); ++i) {
      if (!(table.lights[l][i].second > 0)) throw InputError(where, "a factor not over 0");
      if (i > 0 && !(table.lights[l][i].first > table.lights[l][i - 1].first)) {
        throw InputError(where, "theta_h does not rise", "rising angles, each once");
      }
    }
  }
}

/// One light's white, cell by cell; cells that do not see the plane stay.
void scale(const WhiteFactorTable& table, std::size_t light, const StationGeometry& geometry,
           bool undo, Calibration& calibration) {
  Radiance& white = calibration.white[light];
  white.value = white.value.clone();
  white.variance = white.variance.clone();
  const int channels = white.value.channels();
  const Eigen::Vector3d eye = geometry.camera.position();
  for (int v = 0; v < white.value.rows; ++v) {
    for (int u = 0; u < white.value.cols; ++u) {
      const Eigen::Vector3d ray = geometry.camera.ray_W(cell_centre_px(calibration.sensor, u, v));
      if (!(ray.z() < 0)) continue;
      const Eigen::Vector3d p = eye - eye.z() / ray.z() * ray;
      const HalfDiff angles = to_half_diff(
          {.wi = (geometry.lights_W[light] - p).normalized(), .wo = (eye - p).normalized()});
      const double factor = table.factor(light, angles.theta_h);
      const auto by = static_cast<float>(undo ? factor : 1 / factor);
      for (int i = u * channels; i < (u + 1) * channels; ++i) {
        white.value.ptr<float>(v)[i] *= by;
        white.variance.ptr<float>(v)[i] *= by * by;
      }
    }
  }
}

}  // namespace

double WhiteFactorTable::factor(std::size_t light, double theta_h) const {
  const auto& figures = lights.at(light);
  const auto above =
      std::upper_bound(figures.begin(), figures.end(), theta_h,
                       [](double angle, const auto& figure) { return angle < figure.first; });
  if (above == figures.begin()) return figures.front().second;
  if (above == figures.end()) return figures.back().second;
  const auto below = above - 1;
  const double t = (theta_h - below->first) / (above->first - below->first);
  return (1 - t) * below->second + t * above->second;
}

void apply_white_factor(const WhiteFactorTable& table, const StationGeometry& geometry,
                        Calibration& calibration, bool undo) {
  check(table, calibration.white.size());
  for (std::size_t l = 0; l < calibration.white.size(); ++l)
    scale(table, l, geometry, undo, calibration);
  calibration.white_factor = undo ? "" : table.name;
  calibration.white_sigma = undo ? kUnknownWhiteSigma : table.sigma;
}

}  // namespace brdfgate
