#include <cmath>
#include <cstdlib>
#include <limits>
#include <opencv2/core/utility.hpp>

#include "catch.hpp"
#include "model/design_search.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;

namespace {

SearchProblem problem_of(std::vector<SearchAxis> site, int sites, SearchCost cost) {
  SearchProblem problem;
  problem.site = std::move(site);
  problem.sites = sites;
  problem.make_cost = [cost = std::move(cost)] { return cost; };
  return problem;
}

SearchOptions few_starts() {
  SearchOptions options;
  options.starts = 6;
  options.candidates = 10;
  return options;
}

/// Distance on a circle of `count` cells.
int around(int a, int b, int count) {
  const int d = std::abs(a - b) % count;
  return std::min(d, count - d);
}

/// One wanted place per site and a bowl around each.
double bowls(const std::vector<int>& place) {
  double cost = 0;
  for (std::size_t i = 0; i < place.size(); i += 2) {
    const int wanted = 13 + 20 * static_cast<int>(i / 2);
    const double x = place[i] - wanted;
    const double y = around(place[i + 1], 2, 60);
    cost += x * x + y * y;
  }
  return cost;
}

}  // namespace

TEST_CASE("The search ends at the bottom of a bowl, site by site, around a periodic axis") {
  const SearchResult found = search_design(problem_of({{90}, {60, true}}, 3, bowls), few_starts());
  CHECK(found.place == std::vector<int>{13, 2, 33, 2, 53, 2});
  CHECK(found.cost == 0);
  CHECK(found.costs.size() == 6);
}

TEST_CASE("Shared coordinates move too and are drawn once") {
  SearchProblem problem = problem_of({{50}}, 2, [](const std::vector<int>& p) {
    double cost = std::abs(p[0] - 31);
    for (std::size_t i = 1; i < p.size(); ++i)
      cost += std::abs(p[i] - p[0] + 5.0 * static_cast<double>(i));
    return cost;
  });
  problem.shared = {{80}};
  const SearchResult found = search_design(problem, few_starts());
  CHECK(found.place.size() == 3);
  CHECK(found.cost == 0);  // along a ridge only camera and site together gain
}

TEST_CASE("The search is the same for a seed, on any number of threads") {
  const auto rugged = [](const std::vector<int>& p) {
    return std::sin(0.7 * p[0]) * std::cos(1.3 * p[1]) + 0.001 * p[0] + 0.002 * p[1];
  };
  const SearchProblem problem = problem_of({{200}, {200}}, 1, rugged);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const SearchResult one = search_design(problem, few_starts());
  cv::setNumThreads(4);
  const SearchResult four = search_design(problem, few_starts());
  cv::setNumThreads(threads);
  CHECK(one.place == four.place);
  CHECK(one.costs == four.costs);
  SearchOptions other = few_starts();
  other.seed = 2;
  CHECK(search_design(problem, other).costs != one.costs);
}

TEST_CASE("Places that cannot be are neither started from nor ended at") {
  const auto halved = [](const std::vector<int>& p) {
    return p[0] % 100 < 97 ? std::numeric_limits<double>::infinity() : double(p[0]);
  };
  const SearchResult found = search_design(problem_of({{400}}, 1, halved), few_starts());
  CHECK(found.cost == found.place[0]);
  CHECK(found.place[0] % 100 >= 97);
}

TEST_CASE("A search for nothing, with nothing or of nothing says so") {
  const SearchCost flat = [](const std::vector<int>&) { return 1.0; };
  const auto error_with = [&](auto change) {
    SearchProblem problem = problem_of({{10}}, 1, flat);
    problem.name = "lights";
    SearchOptions options = few_starts();
    change(problem, options);
    return input_error([&] { return search_design(problem, options); });
  };
  CHECK(
      contains(error_with([](auto& p, auto&) { p.sites = 0; }), "lights: 0; expected at least 1"));
  CHECK(contains(error_with([](auto&, auto& o) { o.starts = 0; }), "starts: 0"));
  CHECK(contains(error_with([](auto&, auto& o) { o.candidates = -3; }), "candidates: -3"));
  const auto never = [](auto& p, auto&) {
    p.make_cost = [] {
      return [](const std::vector<int>&) { return std::numeric_limits<double>::infinity(); };
    };
  };
  CHECK(contains(error_with(never), "sees anything"));
  const auto nan = [](auto& p, auto&) {
    p.make_cost = [] {
      return [](const std::vector<int>&) { return std::numeric_limits<double>::quiet_NaN(); };
    };
  };
  CHECK(contains(error_with(nan), "sees anything"));
}
