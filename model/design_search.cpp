#include "model/design_search.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <string>

#include "model/error.hpp"
#include "model/parallel.hpp"

namespace brdfgate {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
/// A new site of which no candidate is possible gets this many further rounds of candidates.
constexpr int kRounds = 20;
/// Gains below this share of the cost are rounding.
constexpr double kLeastGain = 1e-12;

/// One start: a place that grows site by site.
class Start {
 public:
  Start(const SearchProblem& problem, const SearchOptions& options, unsigned number)
      : problem_(problem), options_(options), cost_of_(problem.make_cost()) {
    std::seed_seq seeds{options.seed, number};
    random_.seed(seeds);
  }

  void run() {
    for (int site = 0; site < problem_.sites; ++site) {
      add_site();
      if (!std::isfinite(cost_)) return;
      for (const int step : options_.steps)
        descend(step);
    }
  }
  double cost() const { return cost_; }
  const std::vector<int>& place() const { return place_; }

 private:
  const SearchAxis& axis(std::size_t coordinate) const {
    const std::size_t shared = problem_.shared.size();
    return coordinate < shared ? problem_.shared[coordinate]
                               : problem_.site[(coordinate - shared) % problem_.site.size()];
  }

  /// The same on every platform, unlike std::uniform_int_distribution.
  int draw(int count) {
    return static_cast<int>(
        static_cast<std::uint64_t>(random_()) * static_cast<std::uint64_t>(count) >> 32U);
  }

  void add_site() {
    std::vector<int> candidate = place_;
    const std::size_t first = place_.size();
    candidate.resize((first == 0 ? problem_.shared.size() : first) + problem_.site.size());
    cost_ = kInfinity;
    for (int i = 0; i < kRounds * options_.candidates; ++i) {
      if (i >= options_.candidates && std::isfinite(cost_)) break;
      for (std::size_t c = first; c < candidate.size(); ++c)
        candidate[c] = draw(axis(c).count);
      accept(candidate);
    }
  }

  bool accept(const std::vector<int>& candidate) {
    const double cost = cost_of_(candidate);
    // A first finite cost gains against infinity too; NaN never does.
    const bool better =
        std::isfinite(cost_) ? cost < cost_ - kLeastGain * std::abs(cost_) : cost < kInfinity;
    if (!better) return false;
    cost_ = cost;
    place_ = candidate;
    return true;
  }

  /// Moves the groups of coordinates (shared, each site) in random order until none gains.
  void descend(int step) {
    std::vector<std::size_t> groups;
    if (!problem_.shared.empty()) groups.push_back(0);
    for (std::size_t c = problem_.shared.size(); c < place_.size(); c += problem_.site.size())
      groups.push_back(c);
    for (bool gained = true; gained;) {
      gained = false;
      for (std::size_t i = groups.size(); i-- > 1;)
        std::swap(groups[i], groups[static_cast<std::size_t>(draw(static_cast<int>(i) + 1))]);
      for (const std::size_t first : groups)
        gained = move_group(first, step) || gained;
    }
  }

  bool move_group(std::size_t first, int step) {
    const bool is_shared = first < problem_.shared.size();
    const std::size_t size = is_shared ? problem_.shared.size() : problem_.site.size();
    bool moved = false;
    while (best_neighbour(first, size, step))
      moved = true;
    return moved;
  }

  /// The best of the steps along each axis of a group: the numerical gradient of the papers. A
  /// shared coordinate also moves together with one of any site's: a camera with the light in its
  /// mirror direction, where neither gains alone.
  bool best_neighbour(std::size_t first, std::size_t size, int step) {
    const std::vector<int> from = place_;
    bool better = false;
    for (std::size_t c = first; c < first + size; ++c) {
      for (const int move : {-step, step}) {
        std::vector<int> candidate = from;
        if (!shift(candidate, c, move)) continue;
        better = accept(candidate) || better;
        if (first >= problem_.shared.size()) continue;
        for (std::size_t other = problem_.shared.size(); other < from.size(); ++other) {
          for (const int along : {-step, step}) {
            std::vector<int> both = candidate;
            if (shift(both, other, along)) better = accept(both) || better;
          }
        }
      }
    }
    return better;
  }

  /// False where the axis ends.
  bool shift(std::vector<int>& place, std::size_t coordinate, int move) const {
    const SearchAxis& a = axis(coordinate);
    int& value = place[coordinate];
    value += move;
    if (a.periodic) value = ((value % a.count) + a.count) % a.count;
    return value >= 0 && value < a.count;
  }

  const SearchProblem& problem_;
  const SearchOptions& options_;
  SearchCost cost_of_;
  std::mt19937 random_;
  std::vector<int> place_;
  double cost_ = kInfinity;
};

void check(const std::string& what, int value) {
  if (value < 1) throw InputError(what, std::to_string(value), "at least 1");
}

}  // namespace

SearchResult search_design(const SearchProblem& problem, const SearchOptions& options) {
  check(problem.name, problem.sites);
  check("starts", options.starts);
  check("candidates", options.candidates);
  SearchResult result;
  result.costs.resize(static_cast<std::size_t>(options.starts));
  std::vector<std::vector<int>> places(result.costs.size());
  parallel_for_each(options.starts, [&](int i) {
    Start start(problem, options, static_cast<unsigned>(i));
    start.run();
    result.costs[static_cast<std::size_t>(i)] = start.cost();
    places[static_cast<std::size_t>(i)] = start.place();
    if (options.started) options.started();
  });
  const auto best = std::min_element(result.costs.begin(), result.costs.end());
  if (!std::isfinite(*best)) {
    throw InputError("design", "no start of the search found a rig that sees anything",
                     "wider limits or more candidates");
  }
  result.cost = *best;
  result.place = places[static_cast<std::size_t>(best - result.costs.begin())];
  return result;
}

}  // namespace brdfgate
