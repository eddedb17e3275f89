#include "model/validation.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>
#include <string>

#include "model/error.hpp"
#include "model/mapping.hpp"

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

/// Cells nearer to the horizon do not count.
constexpr double kLeastCosine = 0.02;

Eigen::MatrixXd three_channels(const Weights& weights, const Basis& basis) {
  const Eigen::MatrixXd& c = weights.c;
  if (c.rows() != basis.info().components || (c.cols() != 1 && c.cols() != 3) || !c.allFinite()) {
    throw InputError("weights",
                     std::to_string(c.rows()) + " components of " + std::to_string(c.cols()) +
                         " channels, " + (c.allFinite() ? "finite" : "not all finite"),
                     std::to_string(basis.info().components) + " of 1 or 3, finite");
  }
  return c.cols() == 1 ? Eigen::MatrixXd(c.replicate(1, 3)) : c;
}

/// Squared errors of the channels at one direction.
Eigen::Array3d squared_error(const Brdf& truth, const Basis& basis, const Eigen::MatrixXf& rows,
                             const HalfDiff& direction) {
  const Basis::Location at = basis.locate(direction);
  Eigen::Array3d x = Eigen::Array3d::Zero();
  for (std::size_t i = 0; i < at.row.size(); ++i) {
    if (at.weight[i] > 0) {
      x += at.weight[i] * rows.row(at.row[i]).transpose().array().cast<double>();
    }
  }
  const Rgb f = truth.eval(direction);
  for (Eigen::Index channel = 0; channel < 3; ++channel)
    x[channel] -= to_mapped(f[channel], at.median, at.cosine_weight);
  return x.square();
}

/// The value at a share of the way through sorted values.
double quantile(const std::vector<double>& sorted, double share) {
  const double at = share * static_cast<double>(sorted.size() - 1);
  const auto lower = static_cast<std::size_t>(at);
  const std::size_t upper = std::min(lower + 1, sorted.size() - 1);
  return std::lerp(sorted[lower], sorted[upper], at - static_cast<double>(lower));
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

ReconstructionError reconstruction_error(const Brdf& truth, const Basis& basis,
                                         const Weights& weights, const BasisGrid& grid) {
  const Eigen::MatrixXf rows = basis.mapped_rows(three_channels(weights, basis));
  ReconstructionError error;
  Eigen::Array3d squares = Eigen::Array3d::Zero();
  for (int h = 0; h < grid.theta_h; ++h) {
    for (int d = 0; d < grid.theta_d; ++d) {
      for (int p = 0; p < grid.phi_d; ++p) {
        const HalfDiff direction = grid.centre(h, d, p);
        if (!cosines(direction).above_horizon(kLeastCosine)) continue;
        squares += squared_error(truth, basis, rows, direction);
        ++error.cells;
      }
    }
  }
  const Eigen::Array3d rms =
      (squares / static_cast<double>(std::max<std::size_t>(error.cells, 1))).sqrt();
  error.per_channel = {rms[0], rms[1], rms[2]};
  error.mapped_rms = rms.mean();
  return error;
}

std::vector<int> assign_folds(int materials, int folds, std::uint64_t seed) {
  if (folds < 2 || folds > materials) {
    throw InputError("folds",
                     std::to_string(folds) + " for " + std::to_string(materials) + " material(s)",
                     "2 up to the number of materials");
  }
  std::vector<int> order(static_cast<std::size_t>(materials));
  std::iota(order.begin(), order.end(), 0);
  // By hand: std::shuffle draws differently from library to library.
  std::mt19937_64 random(seed);
  for (std::size_t i = order.size() - 1; i > 0; --i)
    std::swap(order[i], order[random() % (i + 1)]);
  std::vector<int> fold(order.size());
  for (std::size_t i = 0; i < order.size(); ++i)
    fold[static_cast<std::size_t>(order[i])] =
        static_cast<int>(i * static_cast<std::size_t>(folds) / order.size());
  return fold;
}

ErrorSummary summarise(std::vector<double> errors) {
  if (errors.empty()) return {};
  std::sort(errors.begin(), errors.end());
  return {std::accumulate(errors.begin(), errors.end(), 0.0) / static_cast<double>(errors.size()),
          quantile(errors, 0.5), quantile(errors, 0.9)};
}

}  // namespace brdfgate
