#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <utility>

#include "model/design_cost.hpp"
#include "model/design_layouts.hpp"
#include "model/error.hpp"
#include "model/parallel.hpp"

namespace brdfgate {
namespace {

using namespace design_detail;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

HalfDiff merl_cell(const std::vector<int>& place, std::size_t first) {
  return kMerlGrid.centre(place[first], place[first + 1], place[first + 2]);
}

/// Figure of points on MERL's grid, keeping what it computed for each cell.
class PointCost {
 public:
  PointCost(const DesignBasis& basis, const DesignGoal& goal, const DesignLimits& limits)
      : basis_(basis), goal_(goal), least_cosine_(std::cos(limits.max_theta)) {}

  double operator()(const std::vector<int>& place) {
    cache_.make_room();
    std::vector<const DesignPoint*> points;
    for (std::size_t i = 0; i < place.size(); i += 3) {
      const HalfDiff at = merl_cell(place, i);
      if (!cosines(at).above_horizon(least_cosine_)) return kInfinity;
      points.push_back(&cache_.get({place[i], place[i + 1], place[i + 2]},
                                   [&] { return make_design_point(basis_, at); }));
    }
    if (points.size() == 1 && goal_.criterion == DesignCriterion::condition) {
      return -points.front()->q.norm();  // C.IV section 4, n = 1
    }
    return cost_of(basis_, points, goal_);
  }

 private:
  const DesignBasis& basis_;
  DesignGoal goal_;
  double least_cosine_;
  SiteCache<DesignPoint> cache_;
};

}  // namespace

namespace design_detail {

void check(const DesignGoal& goal) {
  if (!(goal.beta >= 0 && std::isfinite(goal.beta))) {
    throw InputError("beta", std::to_string(goal.beta), "a finite number, not negative");
  }
}

void check(const DesignLimits& limits) {
  constexpr double kDegree = std::numbers::pi / 180;
  if (!(limits.max_theta > 0 && limits.max_theta < std::numbers::pi / 2)) {
    throw InputError("max theta", std::to_string(limits.max_theta / kDegree) + " deg",
                     "between 0 and 90");
  }
  if (!(limits.clearance >= 0 && limits.clearance < std::numbers::pi)) {
    throw InputError("clearance", std::to_string(limits.clearance / kDegree) + " deg",
                     "0 or more, under 180");
  }
}

}  // namespace design_detail

DesignScore score(const DesignBasis& basis, const Information& information) {
  return {information.rows, condition_number(information), std::sqrt(information.gram.trace()),
          expected_error(basis, information)};
}

Found<std::vector<HalfDiff>> design_points(const DesignBasis& basis, int n, const DesignGoal& goal,
                                           const DesignLimits& limits,
                                           const SearchOptions& options) {
  check(goal);
  check(limits);
  SearchProblem problem;
  problem.name = "points";
  problem.site = {{kMerlGrid.theta_h}, {kMerlGrid.theta_d}, {kMerlGrid.phi_d, true}};
  problem.sites = n;
  problem.make_cost = [&] {
    // std::function copies: share the cache.
    auto cost = std::make_shared<PointCost>(basis, goal, limits);
    return [cost](const std::vector<int>& place) { return (*cost)(place); };
  };
  const SearchResult found = search_design(problem, options);
  std::vector<HalfDiff> points;
  for (std::size_t i = 0; i < found.place.size(); i += 3)
    points.push_back(merl_cell(found.place, i));
  return {points, found.costs};
}

DesignScore score_points(const DesignBasis& basis, const std::vector<HalfDiff>& directions) {
  if (directions.empty()) throw InputError("directions", "none given", "at least 1");
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const HalfDiff& a = directions[i];
    const bool finite =
        std::isfinite(a.theta_h) && std::isfinite(a.theta_d) && std::isfinite(a.phi_d);
    if (!finite || !cosines(a).above_horizon()) {
      throw InputError("direction " + std::to_string(i + 1),
                       finite ? "lies below the horizon" : "is not finite",
                       "light and camera above the sample");
    }
  }
  return score(basis, Information::of(design_rows(basis, directions)));
}

std::vector<Information> sphere_images(const DesignBasis& basis,
                                       const std::function<void()>& done) {
  std::vector<Information> images(static_cast<std::size_t>(kMerlGrid.theta_d));
  parallel_for_each(kMerlGrid.theta_d, [&](int d) {
    std::vector<HalfDiff> directions;
    for (int h = 0; h < kMerlGrid.theta_h; ++h) {
      for (int p = 0; p < kMerlGrid.phi_d; ++p) {
        const HalfDiff at = kMerlGrid.centre(h, d, p);
        if (cosines(at).above_horizon(kLeastCosine)) directions.push_back(at);
      }
    }
    images[static_cast<std::size_t>(d)] = Information::of(design_rows(basis, directions));
    if (done) done();
  });
  return images;
}

Found<std::vector<int>> design_spheres(const DesignBasis& basis,
                                       const std::vector<Information>& images, int n,
                                       const DesignGoal& goal, const SearchOptions& options) {
  check(goal);
  SearchProblem problem;
  problem.name = "spheres";
  problem.site = {{static_cast<int>(images.size())}};
  problem.sites = n;
  problem.make_cost = [&] {
    return [&](const std::vector<int>& place) {
      Information all = Information::none(basis.components());
      for (const int d : place)
        all += images[static_cast<std::size_t>(d)];
      return all.rows > 0 ? cost_of(basis, all, goal) : kInfinity;
    };
  };
  SearchResult found = search_design(problem, options);
  std::sort(found.place.begin(), found.place.end());
  return {std::move(found.place), std::move(found.costs)};
}

}  // namespace brdfgate
