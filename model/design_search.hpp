// The search of C.IV section 4 and C.VI section 5: candidates, then moves on an integer grid with
// steps of 3 cells, then 1, from many random starts.
#pragma once

#include <array>
#include <functional>
#include <string>
#include <vector>

namespace brdfgate {

/// One coordinate of a site: integers [0, count), around in a circle where it is periodic.
struct SearchAxis {
  int count = 1;
  bool periodic = false;
};

/// The lower the better; infinity for a place that cannot be. May keep what it computed last.
using SearchCost = std::function<double(const std::vector<int>& place)>;

/// A place is a list of integers: the shared axes' (a fixed camera), then each site's (a light, a
/// point, an image) in turn. Sites are added one by one, each optimised before the next.
struct SearchProblem {
  std::string name = "sites";  ///< what a site is called in an error
  std::vector<SearchAxis> shared;
  std::vector<SearchAxis> site;
  int sites = 1;
  /// Makes the cost function of one start; it is called for places of 1 to `sites` sites.
  std::function<SearchCost()> make_cost;
};

struct SearchOptions {
  int starts = 50;
  unsigned seed = 1;
  int candidates = 200;            ///< tried for every new site; C.VI: 500
  std::array<int, 2> steps{3, 1};  ///< cells; C.IV and C.VI: 3, then 1
  std::function<void()> started;   ///< called from any thread after each start; may be empty
};

struct SearchResult {
  std::vector<int> place;  ///< of the lowest cost
  double cost = 0;
  std::vector<double> costs;  ///< of each start, in turn
};

/// Runs the starts on all cores; the result depends on the seed alone.
/// Throws InputError for starts, candidates or sites under 1, and where no start found a place of
/// finite cost.
SearchResult search_design(const SearchProblem& problem, const SearchOptions& options);

}  // namespace brdfgate
