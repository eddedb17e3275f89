#include "model/bracket_check.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace brdfgate {
namespace {

constexpr int kRowStep = 8;
/// Shares of the sensor's range. Below the first, black level and noise count too much.
constexpr double kFaint = 0.03;
constexpr double kDark = 0.1;
constexpr double kBright = 0.9;
/// Linear sensors keep a few per cent; a wrong exposure of a bracket is off by far more.
constexpr double kTolerance = 0.25;
constexpr double kOffsetTolerance = 0.02;  ///< of the range: a black level from the datasheet
constexpr int kEnoughPixels = 64;
/// Exposures nearer than this are not told apart.
constexpr double kLeastRatio = 1.2;

double dose(const RawFrame& frame) {
  return frame.exposure_s * frame.gain;
}

std::string name_of(const RawFrame& frame) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.4g ms at gain %.3g", 1e3 * frame.exposure_s,
                frame.gain);
  return text.data();
}

/// Calls `look(a, b)` with the counts of every pixel looked at.
template <typename Look>
void each_pixel(const RawFrame& a, const RawFrame& b, const Look& look) {
  for (int y = kRowStep / 2 % std::max(a.counts.rows, 1); y < a.counts.rows; y += kRowStep) {
    const auto* row_a = a.counts.ptr<std::uint16_t>(y);
    const auto* row_b = b.counts.ptr<std::uint16_t>(y);
    for (int x = 0; x < a.counts.cols; ++x)
      look(row_a[x], row_b[x]);
  }
}

/// The same picture twice, although a picture with noise never comes twice.
bool frozen(const RawFrame& a, const RawFrame& b, const SensorFormat& sensor) {
  bool same = true;
  int least = 65535;
  int most = 0;
  int between = 0;  // neither black nor clipped
  each_pixel(a, b, [&](int za, int zb) {
    same = same && za == zb;
    least = std::min(least, za);
    most = std::max(most, za);
    between += za > sensor.black_level_dn + 1 && za < sensor.full_well_dn ? 1 : 0;
  });
  if (!same || least == most) return false;
  // Clipped and black alone may be what both exposures see.
  const bool tells = most < sensor.full_well_dn || between > 0;
  return tells && cv::norm(a.counts, b.counts, cv::NORM_INF) == 0;
}

struct Sums {
  double predicted = 0;
  double seen = 0;
  int pixels = 0;
  bool enough() const { return pixels >= kEnoughPixels; }
};

/// What the longer exposure should show of pixels that the shorter one shows well.
Sums predict_longer(const RawFrame& brief, const RawFrame& longer, const SensorFormat& sensor,
                    double ratio) {
  const double range = sensor.full_well_dn - sensor.black_level_dn;
  Sums sums;
  each_pixel(brief, longer, [&](int z_brief, int z_longer) {
    const double signal = z_brief - sensor.black_level_dn;
    if (signal < kFaint * range || signal > kBright * range) return;
    sums.predicted += std::min(signal * ratio, range);
    sums.seen += std::min(z_longer - sensor.black_level_dn, range);
    ++sums.pixels;
  });
  return sums;
}

/// What the shorter exposure should show of pixels that the longer one shows well.
Sums predict_briefer(const RawFrame& brief, const RawFrame& longer, const SensorFormat& sensor,
                     double ratio) {
  const double range = sensor.full_well_dn - sensor.black_level_dn;
  Sums sums;
  each_pixel(brief, longer, [&](int z_brief, int z_longer) {
    const double signal = z_longer - sensor.black_level_dn;
    if (signal < kDark * range || signal > kBright * range) return;
    sums.predicted += signal / ratio;
    sums.seen += z_brief - sensor.black_level_dn;
    ++sums.pixels;
  });
  return sums;
}

bool contradicts(const Sums& sums, double range, bool linear) {
  if (!sums.enough()) return false;
  const double predicted = sums.predicted / sums.pixels;
  const double seen = sums.seen / sums.pixels;
  const double slack = kOffsetTolerance * range + kTolerance * predicted;
  return linear ? std::abs(seen - predicted) > slack : seen < predicted - slack;
}

bool wrongly_exposed(const RawFrame& brief, const RawFrame& longer, const SensorFormat& sensor,
                     bool linear) {
  const double ratio = dose(longer) / dose(brief);
  const double range = sensor.full_well_dn - sensor.black_level_dn;
  // Of a tone curve only this is known: more light is not darker.
  if (!linear) return contradicts(predict_longer(brief, longer, sensor, 1), range, false);
  return contradicts(predict_longer(brief, longer, sensor, ratio), range, true) ||
         contradicts(predict_briefer(brief, longer, sensor, ratio), range, true);
}

}  // namespace

std::optional<std::string> bracket_contradiction(std::span<const RawFrame> frames,
                                                 const SensorFormat& sensor, bool linear) {
  for (std::size_t i = 1; i < frames.size(); ++i) {
    const RawFrame& a = frames[i - 1];
    const RawFrame& b = frames[i];
    if (frozen(a, b, sensor)) {
      return "the same picture for " + name_of(a) + " and " + name_of(b) + ": frozen";
    }
    const bool rising = dose(b) >= dose(a);
    const RawFrame& brief = rising ? a : b;
    const RawFrame& longer = rising ? b : a;
    if (dose(longer) < kLeastRatio * dose(brief)) continue;
    if (wrongly_exposed(brief, longer, sensor, linear)) {
      return name_of(a) + " and " + name_of(b) +
             " do not show the same scene: an exposure was not applied, or a frame is black";
    }
  }
  return std::nullopt;
}

}  // namespace brdfgate
