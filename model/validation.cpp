#include "model/validation.hpp"

#include <cmath>
#include <numbers>

namespace brdfgate {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// Unit vector in the plane of incidence; positive angles lean toward the camera.
Eigen::Vector3d in_plane(double deg) {
  return {std::sin(deg * kDegree), 0, std::cos(deg * kDegree)};
}

/// Points of the plane, the camera's distance being 1.
std::vector<Eigen::Vector3d> disc(const ValidationRig& rig) {
  const double radius = std::tan(rig.fov_deg / 2 * kDegree);
  std::vector<Eigen::Vector3d> points;
  for (int j = 0; j < rig.lattice; ++j) {
    for (int i = 0; i < rig.lattice; ++i) {
      const double x = radius * (2.0 * i / (rig.lattice - 1) - 1);
      const double y = radius * (2.0 * j / (rig.lattice - 1) - 1);
      // Rim points belong to the disc whatever rounding says.
      if (x * x + y * y <= radius * radius * (1 + 1e-12)) points.emplace_back(x, y, 0);
    }
  }
  return points;
}

}  // namespace

BinnedSamples observe_exactly(const Brdf& brdf, const ValidationRig& rig) {
  BinnedSamples samples;
  const Eigen::Vector3d eye = in_plane(rig.camera_deg);
  const Eigen::Vector3d lights[2] = {in_plane(-rig.light_deg[0]), in_plane(rig.light_deg[1])};
  const std::vector<Eigen::Vector3d> points = disc(rig);
  for (int light = 1; light <= 2; ++light) {
    for (const Eigen::Vector3d& p : points) {
      Bin bin;
      bin.id = static_cast<int>(samples.bins.size());
      bin.light = light;
      bin.angles = to_half_diff({lights[light - 1], (eye - p).normalized()});
      bin.pixels = 1;
      bin.f = brdf.eval(bin.angles);
      samples.bins.push_back(bin);
    }
  }
  return samples;
}

}  // namespace brdfgate
