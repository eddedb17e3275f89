#include <random>
#include <string>
#include <vector>

#include "catch.hpp"
#include "hal/gpio/debounce.hpp"

using brdfgate::EdgeDebouncer;

namespace {

constexpr std::int64_t kMs = 1'000'000;

struct Edge {
  std::int64_t at_ms;
  bool active;
};

int count(EdgeDebouncer& debouncer) {
  int taken = 0;
  while (debouncer.take())
    ++taken;
  return taken;
}

/// Edges that count in a line's whole history, the plain way: levels that stood for the period.
int by_hand(const std::vector<Edge>& edges, std::int64_t period_ms, std::int64_t end_ms) {
  int counted = 0;
  bool settled = false;
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const std::int64_t until = i + 1 < edges.size() ? edges[i + 1].at_ms : end_ms;
    if (until - edges[i].at_ms < period_ms || edges[i].active == settled) continue;
    settled = edges[i].active;
    if (settled) ++counted;
  }
  return counted;
}

}  // namespace

TEST_CASE("An edge counts once its level has stood for the period") {
  struct Case {
    std::string name;
    std::vector<Edge> edges;
    std::int64_t quiet_until_ms;
    int counted;
  };
  const auto c = GENERATE(values<Case>({
      {"a clean press", {{10, true}, {50, false}}, 100, 1},
      {"not yet stood", {{10, true}}, 14, 0},
      {"just stood", {{10, true}}, 15, 1},
      {"a spike", {{10, true}, {14, false}}, 100, 0},
      {"bouncing contact", {{10, true}, {11, false}, {12, true}, {13, false}, {14, true}}, 30, 1},
      {"bouncing release", {{10, true}, {50, false}, {51, true}, {53, false}}, 100, 1},
      {"two presses", {{10, true}, {20, false}, {40, true}, {50, false}}, 100, 2},
      {"press with a release too short to count", {{10, true}, {20, false}, {22, true}}, 100, 1},
      {"a lost release: still bouncing", {{10, true}, {13, true}}, 17, 0},
      {"a lost release, then quiet", {{10, true}, {13, true}}, 18, 1},
      {"a release that was active at the start", {{10, false}}, 100, 0},
  }));
  CAPTURE(c.name);
  EdgeDebouncer debouncer(5 * kMs, false);
  for (const Edge& edge : c.edges)
    debouncer.edge(edge.active, edge.at_ms * kMs);
  debouncer.no_edge_until(c.quiet_until_ms * kMs);
  CHECK(count(debouncer) == c.counted);
}

TEST_CASE("Without a period every active edge counts at once") {
  EdgeDebouncer debouncer(0, false);
  debouncer.edge(true, 1);
  CHECK(debouncer.take());
  CHECK_FALSE(debouncer.take());
  debouncer.edge(false, 1);
  debouncer.edge(true, 1);
  CHECK(count(debouncer) == 1);
}

TEST_CASE("A line that is active at the start has no edge before it was released") {
  EdgeDebouncer debouncer(5 * kMs, true);
  debouncer.no_edge_until(100 * kMs);
  CHECK(count(debouncer) == 0);
  debouncer.edge(false, 100 * kMs);
  debouncer.edge(true, 110 * kMs);
  debouncer.no_edge_until(120 * kMs);
  CHECK(count(debouncer) == 1);
}

TEST_CASE("A change under way says when it will count") {
  EdgeDebouncer debouncer(5 * kMs, false);
  CHECK_FALSE(debouncer.decided_at_ns());
  debouncer.edge(true, 10 * kMs);
  CHECK(debouncer.decided_at_ns() == 15 * kMs);
  debouncer.edge(false, 12 * kMs);
  CHECK_FALSE(debouncer.decided_at_ns());
}

TEST_CASE("Any history counts what stood in it, and no more, however it is fed") {
  std::mt19937_64 random(17);
  for (int run = 0; run < 200; ++run) {
    std::vector<Edge> edges;
    std::int64_t at = 0;
    for (int i = 0; i < 40; ++i) {
      at += std::uniform_int_distribution<std::int64_t>(1, 12)(random);
      edges.push_back({at, i % 2 == 0});
    }
    EdgeDebouncer debouncer(5 * kMs, false);
    int counted = 0;
    for (std::size_t i = 0; i < edges.size(); ++i) {
      debouncer.edge(edges[i].active, edges[i].at_ms * kMs);
      if (i + 1 < edges.size() && random() % 2 == 0) {
        debouncer.no_edge_until((edges[i + 1].at_ms - 1) * kMs);
      }
      counted += count(debouncer);
    }
    debouncer.no_edge_until((at + 20) * kMs);
    CAPTURE(run);
    CHECK(counted + count(debouncer) == by_hand(edges, 5, at + 20));
  }
}
