#include "model/bracket_choice.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "model/error.hpp"
#include "model/saturation.hpp"

namespace brdfgate {
namespace {

constexpr std::size_t kMostCandidates = 16;
/// The cells' radiances as a histogram: sixteen bins per octave, fine against what a stop decides.
constexpr double kBinsPerOctave = 16;
constexpr double kQuantisation = 1.0 / 12;

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

/// A cell by its brightest and weakest channel: one clips it, the other drowns it.
struct Cell {
  double most = 0, least = 0;  ///< DN/s
  double count = 0;
};

int bin_of(double value) {
  return static_cast<int>(std::lround(kBinsPerOctave * std::log2(std::max(value, 1e-6))));
}

double value_of(int bin) {
  return std::exp2(bin / kBinsPerOctave);
}

struct Key {
  int most, least;
  auto operator<=>(const Key&) const = default;
};

std::vector<Key> keys_of(const BracketNeed& need) {
  const cv::Mat& value = need.radiance->value;
  const int channels = value.channels();
  std::vector<Key> keys;
  for (int v = 0; v < value.rows; ++v) {
    const auto* x = value.ptr<float>(v);
    for (int u = 0; u < value.cols; ++u) {
      const bool wanted = need.cells == nullptr || need.cells->at<std::uint8_t>(v, u) != 0;
      if (!wanted || (need.radiance->mask.at<std::uint8_t>(v, u) & kInvalid) != 0) continue;
      const float* pixel = x + std::ptrdiff_t{u} * channels;
      const auto [least, most] = std::minmax_element(pixel, pixel + channels);
      keys.push_back({bin_of(*most), bin_of(*least)});
    }
  }
  return keys;
}

/// All needs' cells, the like ones together.
std::vector<Cell> gather(const std::vector<BracketNeed>& needs) {
  std::vector<Key> keys;
  for (const BracketNeed& need : needs) {
    const std::vector<Key> more = keys_of(need);
    keys.insert(keys.end(), more.begin(), more.end());
  }
  if (keys.empty()) throw InputError("bracket", "no cell to choose by", "a measured radiance");
  std::sort(keys.begin(), keys.end());
  std::vector<Cell> cells;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (i == 0 || keys[i] != keys[i - 1])
      cells.push_back({value_of(keys[i].most), value_of(keys[i].least), 0});
    cells.back().count += 1;
  }
  return cells;
}

class Bench {
 public:
  Bench(const SensorFormat& sensor, const SensorNoise& noise, const BracketLimits& limits)
      : noise_(noise), limits_(limits) {
    const SaturationRule rule(sensor, noise, 1, false);
    room_dn_ = rule.first_saturated_dn(0, 0) - sensor.black_level_dn;
  }

  /// Signal-to-noise ratio of a radiance merged from the exposures that it does not saturate.
  double snr(double x, const std::vector<double>& exposures) const {
    double weights = 0;
    for (const double t : exposures) {
      if (x * t >= room_dn_) continue;
      const double read = noise_.read_noise_dn;
      weights += t * t / (noise_.gain_dn_per_e * t * x + read * read + kQuantisation);
    }
    return x * std::sqrt(weights);
  }

  double masked(const std::vector<Cell>& cells, const std::vector<double>& exposures) const {
    double bad = 0, all = 0;
    for (const Cell& cell : cells) {
      all += cell.count;
      const bool clipped = cell.most * exposures.front() >= room_dn_;
      if (clipped || snr(cell.least, exposures) < limits_.least_snr) bad += cell.count;
    }
    return bad / all;
  }

  double time(const std::vector<double>& exposures) const {
    double sum = limits_.readout_s * static_cast<double>(exposures.size());
    for (const double t : exposures)
      sum += t;
    return sum;
  }

 private:
  SensorNoise noise_;
  BracketLimits limits_;
  double room_dn_ = 0;
};

void check(const std::vector<double>& candidates) {
  if (candidates.empty() || candidates.size() > kMostCandidates) {
    throw InputError("bracket", std::to_string(candidates.size()) + " candidate exposures",
                     "1 to " + std::to_string(kMostCandidates));
  }
  for (const double t : candidates) {
    if (!(t > 0) || !std::isfinite(t)) {
      throw InputError("bracket", "an exposure of " + number(t) + " s", "over 0");
    }
  }
}

std::vector<double> subset(const std::vector<double>& all, unsigned int bits) {
  std::vector<double> out;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if ((bits >> i & 1U) != 0) out.push_back(all[i]);
  }
  return out;
}

/// Fewer exposures first, then less time.
bool better(const BracketChoice& a, const BracketChoice& b) {
  if (a.exposures_s.size() != b.exposures_s.size())
    return a.exposures_s.size() < b.exposures_s.size();
  return a.time_s < b.time_s;
}

[[noreturn]] void refuse(const BracketChoice& least_masked, const BracketChoice* without_budget,
                         const BracketLimits& limits) {
  std::string expected = "a longer or shorter exposure among the candidates";
  if (without_budget != nullptr) {
    expected = "a budget of " + number(1e3 * without_budget->time_s) + " ms";
  }
  throw InputError("bracket",
                   "within " + number(1e3 * limits.budget_s) + " ms no bracket leaves under " +
                       number(100 * limits.most_masked) + " % masked, the best " +
                       number(100 * least_masked.masked) + " %",
                   expected);
}

}  // namespace

BracketChoice choose_bracket(const SensorFormat& sensor, const SensorNoise& noise,
                             const std::vector<BracketNeed>& needs,
                             const std::vector<double>& candidates_s, const BracketLimits& limits) {
  check(candidates_s);
  const std::vector<Cell> cells = gather(needs);
  const Bench bench(sensor, noise, limits);
  std::vector<double> rising = candidates_s;
  std::sort(rising.begin(), rising.end());
  BracketChoice best, unlimited, least_masked;
  least_masked.masked = 2;
  for (unsigned int bits = 1; bits < 1U << rising.size(); ++bits) {
    BracketChoice choice;
    choice.exposures_s = subset(rising, bits);
    choice.time_s = bench.time(choice.exposures_s);
    const bool in_time = choice.time_s <= limits.budget_s;
    const BracketChoice& rival = in_time ? best : unlimited;
    // Nothing that is no improvement needs its cells looked at, once something fits.
    if (!rival.exposures_s.empty() && !better(choice, rival)) continue;
    choice.masked = bench.masked(cells, choice.exposures_s);
    if (in_time && choice.masked < least_masked.masked) least_masked = choice;
    if (choice.masked > limits.most_masked) continue;
    (in_time ? best : unlimited) = choice;
  }
  if (best.exposures_s.empty()) {
    if (least_masked.masked > 1) least_masked.masked = 1;
    refuse(least_masked, unlimited.exposures_s.empty() ? nullptr : &unlimited, limits);
  }
  return best;
}

std::vector<double> exposure_ladder(double shortest_s, double longest_s, double step) {
  if (!(shortest_s > 0) || !(longest_s >= shortest_s) || !(step > 1)) {
    throw InputError("bracket",
                     "no ladder of exposures from " + number(shortest_s) + " to " +
                         number(longest_s) + " s by " + number(step),
                     "rising exposures over 0, a step over 1");
  }
  std::vector<double> out;
  for (double t = shortest_s; t <= longest_s * (1 + 1e-9) && out.size() < kMostCandidates;
       t *= step)
    out.push_back(t);
  return out;
}

}  // namespace brdfgate
