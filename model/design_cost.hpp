// What the layouts' searches share: MERL's grid, a cache of sites, the figure that is minimised.
#pragma once

#include <algorithm>
#include <limits>
#include <map>
#include <vector>

#include "model/design_layouts.hpp"
#include "model/grid_stencil.hpp"

namespace brdfgate::design_detail {

/// MERL's grid: the candidates of C.IV and C.VI.
inline constexpr HalfDiffGrid kMerlGrid{90, 90, 180};
/// Nearer to the horizon the basis has no cells (basis_training.cpp).
inline constexpr double kLeastCosine = 0.01;

/// What was computed for places already seen; forgets everything when it is full, which happens
/// between evaluations only.
template <typename Value>
class SiteCache {
 public:
  void make_room() {
    if (values_.size() > kMost) values_.clear();
  }
  /// Valid until the next make_room().
  template <typename Make>
  const Value& get(const std::vector<int>& key, Make&& make) {
    const auto found = values_.find(key);
    return found != values_.end() ? found->second : values_.emplace(key, make()).first->second;
  }

 private:
  static constexpr std::size_t kMost = 512;  // 15 MB of images at k = 60
  std::map<std::vector<int>, Value> values_;
};

/// The figure of a goal. A rank-deficient design is the worst one, not an impossible one.
template <typename Measurements>
double cost_of(const DesignBasis& basis, const Measurements& measurements, const DesignGoal& goal) {
  if (goal.criterion == DesignCriterion::error) {
    return expected_error(basis, measurements).total(goal.beta);
  }
  return std::min(condition_number(measurements), std::numeric_limits<double>::max());
}

/// Throws InputError unless beta is a finite number, not negative.
void check(const DesignGoal& goal);
/// Throws InputError unless max_theta is in (0, 90) deg and clearance in [0, 180) deg.
void check(const DesignLimits& limits);

}  // namespace brdfgate::design_detail
