#include "model/noise_measurement.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr double kQuantisation = 1.0 / 12.0;  // variance of rounding to whole counts, DN^2
/// EMVA 1288: variances of dark counts below this are dominated by quantisation, DN^2.
constexpr double kLeastDarkVariance = 0.24;
constexpr double kOutlierSigmas = 6;
/// Photon transfer uses the part of the range where neither read noise nor saturation matters.
constexpr double kLeastShare = 0.05, kMostShare = 0.80;
/// A row's variance from fewer pixels than this is too uncertain to take a median of.
constexpr int kLeastPixels = 100;

using FramePair = std::pair<const RawFrame*, const RawFrame*>;

bool equal_settings(const RawFrame& a, const RawFrame& b) {
  return a.light == b.light && a.exposure_s == b.exposure_s && a.gain == b.gain;
}

std::vector<const RawFrame*> all_frames(const std::vector<Capture>& captures) {
  std::vector<const RawFrame*> frames;
  for (const Capture& capture : captures) {
    for (const RawFrame& frame : capture.frames)
      frames.push_back(&frame);
  }
  return frames;
}

/// Each frame with the next one of equal settings; no frame in two pairs.
std::vector<FramePair> equal_pairs(std::vector<const RawFrame*> frames) {
  std::vector<FramePair> pairs;
  while (!frames.empty()) {
    const RawFrame* first = frames.back();
    frames.pop_back();
    const auto twin = std::find_if(frames.rbegin(), frames.rend(), [&](const RawFrame* other) {
      return equal_settings(*first, *other);
    });
    if (twin == frames.rend()) continue;
    pairs.emplace_back(first, *twin);
    frames.erase(std::next(twin).base());
  }
  return pairs;
}

/// Variance of an image's values without those far out (hot pixels, telegraph noise).
double trimmed_variance(const cv::Mat& values) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(values, mean, deviation);
  for (int pass = 0; pass < 2; ++pass) {
    // Half a count more: whole counts next to the mean always belong.
    const double most = kOutlierSigmas * deviation[0] + 0.5;
    cv::Mat good;
    cv::inRange(values, mean[0] - most, mean[0] + most, good);
    cv::meanStdDev(values, mean, deviation, good);
  }
  return deviation[0] * deviation[0];
}

cv::Mat difference(const FramePair& pair) {
  cv::Mat out;
  cv::subtract(pair.first->counts, pair.second->counts, out, cv::noArray(), CV_32F);
  return out;
}

/// Variance of one dark count, quantisation included; at analogue gain 1.
double dark_variance(const std::vector<Capture>& darks) {
  const std::vector<const RawFrame*> frames = all_frames(darks);
  std::vector<double> found;
  for (const FramePair& pair : equal_pairs(frames)) {
    const double gain = pair.first->gain;
    found.push_back(trimmed_variance(difference(pair)) / 2 / (gain * gain));
  }
  if (found.empty()) {
    const RawFrame& shortest = **std::min_element(
        frames.begin(), frames.end(),
        [](const RawFrame* a, const RawFrame* b) { return a->exposure_s < b->exposure_s; });
    cv::Mat counts;
    shortest.counts.convertTo(counts, CV_32F);
    return trimmed_variance(counts) / (shortest.gain * shortest.gain);
  }
  // The least, not the mean: dark current and stray light only add.
  return *std::min_element(found.begin(), found.end());
}

double signal_sum(const RawFrame& frame, double black) {
  return cv::sum(frame.counts)[0] - black * static_cast<double>(frame.counts.total());
}

/// DN per electron from one row of an equal pair: with z1 - k z2 of mean 0,
/// var(z1 - k z2) = g gain (m1 + k^2 m2) + (1 + k^2) (read noise^2 + 1/12).
struct RowTransfer {
  double black = 0, least = 0, most = 0;  ///< counts
  double ratio = 1;                       ///< k: the light's drift between the frames
  double floor_variance = 0;              ///< of one count that saw nothing, DN^2

  /// Gain, or a negative number where the row has too few pixels in range.
  double gain_of(const std::uint16_t* a, const std::uint16_t* b, int width) const {
    double squares = 0, signal = 0;
    int pixels = 0;
    for (int x = 0; x < width; ++x) {
      const double mean = 0.5 * (a[x] + b[x]);
      if (mean < least || mean > most) continue;
      const double d = (a[x] - black) - ratio * (b[x] - black);
      squares += d * d - (1 + ratio * ratio) * floor_variance;
      signal += (a[x] - black) + ratio * ratio * (b[x] - black);
      ++pixels;
    }
    return pixels < kLeastPixels ? -1 : squares / signal;
  }
};

RowTransfer row_transfer(const SensorFormat& sensor, const SensorNoise& noise,
                         const FramePair& pair) {
  const double range = sensor.full_well_dn - sensor.black_level_dn;
  const double read = noise.read_noise_dn * pair.first->gain;
  RowTransfer out;
  out.black = sensor.black_level_dn;
  out.least = sensor.black_level_dn + kLeastShare * range;
  out.most = sensor.black_level_dn + kMostShare * range;
  out.ratio = signal_sum(*pair.first, out.black) / signal_sum(*pair.second, out.black);
  out.floor_variance = read * read + kQuantisation;
  return out;
}

/// Pairs of equal frames under a light, one frame from each of two captures.
std::vector<FramePair> white_pairs(const std::vector<Capture>& whites) {
  std::vector<FramePair> pairs;
  for (std::size_t i = 0; i + 1 < whites.size(); i += 2) {
    for (const RawFrame& a : whites[i].frames) {
      const auto& others = whites[i + 1].frames;
      const auto b = std::find_if(others.begin(), others.end(),
                                  [&](const RawFrame& o) { return equal_settings(a, o); });
      if (a.light != kNoLight && b != others.end()) pairs.emplace_back(&a, &*b);
    }
  }
  return pairs;
}

}  // namespace

double measure_black_level(const std::vector<Capture>& darks) {
  const std::vector<const RawFrame*> frames = all_frames(darks);
  double sum = 0;
  for (const RawFrame* frame : frames)
    sum += cv::mean(frame->counts)[0];
  return sum / static_cast<double>(frames.size());
}

double measure_read_noise(const std::vector<Capture>& darks, const SensorNoise& nominal) {
  const double variance = dark_variance(darks);
  if (variance < kLeastDarkVariance) return nominal.read_noise_dn;
  return std::sqrt(variance - kQuantisation);
}

double measure_gain(const std::vector<Capture>& whites, const SensorNoise& noise) {
  std::vector<double> gains;
  for (const FramePair& pair : white_pairs(whites)) {
    const RowTransfer row = row_transfer(whites.front().sensor, noise, pair);
    for (int y = 0; y < pair.first->counts.rows; ++y) {
      const double gain =
          row.gain_of(pair.first->counts.ptr<std::uint16_t>(y),
                      pair.second->counts.ptr<std::uint16_t>(y), pair.first->counts.cols);
      if (gain > 0) gains.push_back(gain / pair.first->gain);
    }
  }
  if (gains.empty()) {
    throw InputError("whites",
                     "no two recordings share a light and exposure at 5 to 80 % of full "
                     "well, so the gain cannot be measured",
                     "white recordings with the same exposures, one of them half exposed");
  }
  const auto middle = gains.begin() + static_cast<std::ptrdiff_t>(gains.size() / 2);
  std::nth_element(gains.begin(), middle, gains.end());
  return *middle;
}

}  // namespace brdfgate
