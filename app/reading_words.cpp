#include "app/reading_words.hpp"

#include <fmt/core.h>

#include <cmath>

namespace brdfgate {
namespace {

std::string between(const std::array<double, 2>& bounds, int digits) {
  if (!std::isfinite(bounds[0]) || !std::isfinite(bounds[1])) return {};
  return fmt::format("{:.{}f} to {:.{}f}", bounds[0], digits, bounds[1], digits);
}

void add_gloss(std::vector<ReadingWords>& out, const ClusterReadings& r,
               const TaughtCluster* taught) {
  static constexpr std::array<int, 3> kDegrees{20, 60, 85};
  for (std::size_t i = 0; i < kDegrees.size(); ++i) {
    const Reading& g = r.gloss[i];
    out.push_back({fmt::format("gloss {} deg", kDegrees[i]), fmt::format("{:.2f} GU", g.value),
                   between(g.interval_by_factor(), 2),
                   taught != nullptr ? fmt::format("{:.2f}", taught->gloss_gu[i]) : std::string(),
                   g.measured});
  }
  if (std::isfinite(r.haze.value))
    out.push_back({"haze (D4039)",
                   fmt::format("{:.1f} GU", r.haze.value),
                   between(r.haze.interval(), 1),
                   {},
                   r.haze.measured});
}

void add_colour(std::vector<ReadingWords>& out, const ClusterReadings& r,
                const TaughtCluster* taught) {
  static constexpr std::array<const char*, 3> kNames{"L*", "a*", "b*"};
  for (std::size_t j = 0; j < kNames.size(); ++j) {
    const Reading& v = r.at_45_0().lab[j];
    out.push_back({fmt::format("{} at 45:0", kNames[j]), fmt::format("{:.1f}", v.value),
                   between(v.interval(), 1),
                   taught != nullptr
                       ? fmt::format("{:.1f}", taught->lab[static_cast<Eigen::Index>(j)])
                       : std::string(),
                   v.measured});
  }
  for (std::size_t i = 0; i < kAspecularDeg.size(); ++i) {
    const Reading& l = r.aspecular[i].lab[0];
    if (i != 2)  // 45 is 45:0
      out.push_back({fmt::format("L* at {:.0f} deg asp.", kAspecularDeg[i]),
                     fmt::format("{:.1f}", l.value),
                     between(l.interval(), 1),
                     {},
                     l.measured});
  }
  out.push_back({"flop index",
                 fmt::format("{:.2f}", r.flop.value),
                 between(r.flop.interval(), 2),
                 {},
                 r.flop.measured});
}

}  // namespace

std::vector<ReadingWords> reading_words(const ClusterResult& cluster, const TaughtCluster* taught) {
  std::vector<ReadingWords> out;
  if (!cluster.valid.weights) return out;
  add_gloss(out, cluster.readings, taught);
  if (cluster.valid.colour) add_colour(out, cluster.readings, taught);
  return out;
}

}  // namespace brdfgate
