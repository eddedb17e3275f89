// Which edges of a bouncing contact count.
#pragma once

#include <cstdint>
#include <optional>

namespace brdfgate {

/// Takes a line's edges with their times and counts a change of level once the new level has stood
/// for the whole period. Pure: time comes in as an argument, ns on any one clock.
class EdgeDebouncer {
 public:
  /// Period 0: every edge counts at once. `active`: the line's level when the first edge is yet to
  /// come; it is no edge.
  EdgeDebouncer(std::int64_t period_ns, bool active) : period_ns_(period_ns), settled_(active) {}

  /// An edge to this level. Precondition: times do not decrease.
  void edge(bool active, std::int64_t at_ns) {
    no_edge_until(at_ns);
    // The level it already has: an edge between was lost, so the line is still bouncing.
    changing_ = active != settled_;
    since_ns_ = at_ns;
    if (period_ns_ == 0) no_edge_until(at_ns);
  }

  /// Nothing came before this time.
  void no_edge_until(std::int64_t now_ns) {
    if (!changing_ || now_ns - since_ns_ < period_ns_) return;
    changing_ = false;
    settled_ = !settled_;
    if (settled_) ++taken_;
  }

  /// When a change under way will count if no edge comes; nothing: none is under way.
  std::optional<std::int64_t> decided_at_ns() const {
    if (!changing_) return std::nullopt;
    return since_ns_ + period_ns_;
  }

  /// Takes one edge to the active level, if there is one that counts.
  bool take() {
    if (taken_ == 0) return false;
    --taken_;
    return true;
  }

 private:
  std::int64_t period_ns_;
  bool settled_;
  bool changing_ = false;  ///< since since_ns_, away from the settled level
  std::int64_t since_ns_ = 0;
  std::uint64_t taken_ = 0;
};

}  // namespace brdfgate
