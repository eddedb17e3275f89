// Linear interpolation on a grid of half/difference angles, as MERL tables and the basis use it.
//
// Cells are even in sqrt(theta_h), theta_d and phi_d; values belong to cell centres. phi_d is
// periodic over pi (reciprocity). At theta_h = 0 and at theta_d = 0 phi_d is undefined, so the grid
// gets one more node there, the pole: the mean over phi_d of the ring next to it. Between pole and
// ring the weights run linearly, and a lookup at the pole is the same for every phi_d.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "model/directions.hpp"

namespace brdfgate {

struct HalfDiffGrid {
  int theta_h = 0;
  int theta_d = 0;
  int phi_d = 0;

  constexpr std::size_t cells() const { return std::size_t(theta_h) * theta_d * phi_d; }
  constexpr std::size_t cell(int h, int d, int p) const {
    return (static_cast<std::size_t>(h) * theta_d + d) * phi_d + p;
  }
  /// Cells, then the pole theta_h = 0 for each theta_d, then the pole theta_d = 0 for each theta_h,
  /// then both at once.
  constexpr std::size_t nodes() const { return cells() + theta_d + theta_h + 1; }
  constexpr std::size_t theta_h_pole(int d) const { return cells() + d; }
  constexpr std::size_t theta_d_pole(int h) const { return cells() + theta_d + h; }
  constexpr std::size_t double_pole() const { return nodes() - 1; }

  /// Angles of a cell's centre.
  HalfDiff centre(int h, int d, int p) const { return at(h + 0.5, d + 0.5, p + 0.5); }
  /// Angles at fractional axis indices, 0 at the lower edge of the first cell.
  HalfDiff at(double h, double d, double p) const {
    constexpr double kRight = std::numbers::pi / 2;
    const double root = h / theta_h;
    return {root * root * kRight, d / theta_d * kRight, p / phi_d * std::numbers::pi};
  }
};

/// Eight nodes around a point and their weights (sum 1, none negative).
struct GridStencil {
  std::array<std::size_t, 8> node;
  std::array<double, 8> weight;
};

namespace grid_detail {

/// Two neighbours on one axis; lower = -1 is the pole.
struct Neighbours {
  int lower;
  int upper;
  double upper_weight;
};

inline Neighbours with_pole(double index, int cells) {
  if (!(index > 0)) index = 0;  // also NaN
  if (index < 0.5) return {-1, 0, 2 * index};
  if (index >= cells - 0.5) return {cells - 1, cells - 1, 0.0};
  const double from_centre = index - 0.5;
  const int lower = static_cast<int>(from_centre);
  return {lower, lower + 1, from_centre - lower};
}

inline Neighbours periodic(double index, int cells) {
  double from_centre = index - 0.5;
  if (!(from_centre >= 0 && from_centre < cells)) {
    from_centre =
        std::isfinite(from_centre) ? from_centre - cells * std::floor(from_centre / cells) : 0.0;
  }
  const int lower = std::min(static_cast<int>(from_centre), cells - 1);
  return {lower, lower + 1 < cells ? lower + 1 : 0, from_centre - lower};
}

/// First node of a ring of constant theta_h and theta_d and the step along it (0 at a pole).
struct Ring {
  std::size_t start;
  std::size_t step;
};

inline Ring ring(const HalfDiffGrid& grid, int h, int d) {
  if (h >= 0 && d >= 0) return {grid.cell(h, d, 0), 1};
  if (d >= 0) return {grid.theta_h_pole(d), 0};
  return {h >= 0 ? grid.theta_d_pole(h) : grid.double_pole(), 0};
}

}  // namespace grid_detail

/// The axis index of theta_h on a grid, 0 at the peak.
inline double theta_h_index(const HalfDiffGrid& grid, double theta_h) {
  return std::sqrt(std::max(theta_h, 0.0) * (2 / std::numbers::pi)) * grid.theta_h;
}

/// Stencil at an axis index of theta_h and two angles; angles outside the grid are held at its
/// edge.
inline GridStencil grid_stencil(const HalfDiffGrid& grid, double h_index, double theta_d,
                                double phi_d) {
  using namespace grid_detail;
  const Neighbours h = with_pole(h_index, grid.theta_h);
  const Neighbours d = with_pole(theta_d * (2 / std::numbers::pi) * grid.theta_d, grid.theta_d);
  const Neighbours p = periodic(phi_d * (1 / std::numbers::pi) * grid.phi_d, grid.phi_d);
  GridStencil s;
  std::size_t corner = 0;
  for (const bool upper_h : {false, true}) {
    for (const bool upper_d : {false, true}) {
      const Ring r = ring(grid, upper_h ? h.upper : h.lower, upper_d ? d.upper : d.lower);
      const double weight = (upper_h ? h.upper_weight : 1 - h.upper_weight) *
                            (upper_d ? d.upper_weight : 1 - d.upper_weight);
      s.node[corner] = r.start + r.step * p.lower;
      s.weight[corner++] = weight * (1 - p.upper_weight);
      s.node[corner] = r.start + r.step * p.upper;
      s.weight[corner++] = weight * p.upper_weight;
    }
  }
  return s;
}

/// Stencil over valid nodes only, weights renormalised; where none of the eight is valid, the point
/// moves cell by cell toward the peak, then (on its last cells nothing may be above the horizon)
/// toward theta_d = 0. All weights are zero where there is nothing valid down to there.
template <typename IsValid>
GridStencil valid_stencil(const HalfDiffGrid& grid, const HalfDiff& angles, IsValid&& is_valid) {
  constexpr double kRight = std::numbers::pi / 2;
  double index = std::min(theta_h_index(grid, angles.theta_h), double(grid.theta_h));
  double theta_d = std::clamp(angles.theta_d, 0.0, kRight);
  for (;;) {
    GridStencil s = grid_stencil(grid, index, theta_d, angles.phi_d);
    double sum = 0;
    for (std::size_t i = 0; i < 8; ++i) {
      if (s.weight[i] > 0 && !is_valid(s.node[i])) s.weight[i] = 0;
      sum += s.weight[i];
    }
    if (sum > 0) {
      for (double& w : s.weight)
        w /= sum;
      return s;
    }
    if (index > 0) {
      index = std::max(index - 1, 0.0);
    } else if (theta_d > 0) {
      theta_d = std::max(theta_d - kRight / grid.theta_d, 0.0);
    } else {
      return s;
    }
  }
}

/// Values per pole node from values per cell: the mean over the valid cells of the ring next to it.
/// @param value     value(cell) -> T
/// @param is_valid  is_valid(cell) -> bool
/// @param set       set(node, mean, count): called for every pole node; count 0 means no valid cell
template <typename T, typename Value, typename IsValid, typename Set>
void fill_poles(const HalfDiffGrid& grid, T zero, Value&& value, IsValid&& is_valid, Set&& set) {
  const auto mean_of_ring = [&](int h, int d, std::size_t node) {
    T sum = zero;
    int count = 0;
    for (int p = 0; p < grid.phi_d; ++p) {
      const std::size_t cell = grid.cell(h, d, p);
      if (!is_valid(cell)) continue;
      sum += value(cell);
      ++count;
    }
    if (count > 0) sum *= 1.0 / count;
    set(node, sum, count);
  };
  for (int d = 0; d < grid.theta_d; ++d)
    mean_of_ring(0, d, grid.theta_h_pole(d));
  for (int h = 0; h < grid.theta_h; ++h)
    mean_of_ring(h, 0, grid.theta_d_pole(h));
  mean_of_ring(0, 0, grid.double_pole());
}

}  // namespace brdfgate
