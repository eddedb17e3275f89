#include "model/response.hpp"

#include <array>
#include <cmath>
#include <map>
#include <string>

#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr double kRounding = 1e-6;
constexpr std::size_t kLeastExposures = 3;

/// Colour channel of each pixel of the 2x2 cell, row by row.
std::array<int, 4> cell_channels(Mosaic mosaic) {
  switch (mosaic) {
    case Mosaic::bggr:
      return {2, 1, 1, 0};
    case Mosaic::grbg:
      return {1, 0, 2, 1};
    case Mosaic::gbrg:
      return {1, 2, 0, 1};
    case Mosaic::rggb:
      return {0, 1, 1, 2};
    case Mosaic::mono:
      break;
  }
  return {0, 0, 0, 0};
}

/// Every second pixel of every second row.
cv::Mat plane_of(const cv::Mat& counts, int row, int column) {
  cv::Mat out(counts.rows / 2, counts.cols / 2, CV_16UC1);
  for (int y = 0; y < out.rows; ++y) {
    const auto* in = counts.ptr<std::uint16_t>(2 * y + row) + column;
    auto* to = out.ptr<std::uint16_t>(y);
    for (int x = 0; x < out.cols; ++x)
      to[x] = in[std::ptrdiff_t{2} * x];
  }
  return out;
}

/// One plane of a sensor: its colour, and the counts of every frame there.
struct Plane {
  int channel = 0;
  std::vector<cv::Mat> images;
};

std::vector<Plane> planes_of(const SensorFormat& sensor,
                             const std::vector<const RawFrame*>& frames) {
  std::vector<Plane> planes;
  const int n = sensor.mosaic == Mosaic::mono ? 1 : 4;
  for (int i = 0; i < n; ++i) {
    planes.push_back({cell_channels(sensor.mosaic)[static_cast<std::size_t>(i)], {}});
    for (const RawFrame* frame : frames)
      planes.back().images.push_back(n == 1 ? frame->counts
                                            : plane_of(frame->counts, i / 2, i % 2));
  }
  return planes;
}

std::vector<double> times_of(const std::vector<const RawFrame*>& frames) {
  std::vector<double> times;
  for (const RawFrame* frame : frames)
    times.push_back(frame->exposure_s * frame->gain);
  return times;
}

/// One frame of each exposure under the light that has most of them.
std::vector<const RawFrame*> sweep_frames(const std::vector<Capture>& sweep) {
  std::map<LightIndex, std::map<double, const RawFrame*>> by_light;
  for (const Capture& capture : sweep) {
    if (!(capture.sensor == sweep.front().sensor)) {
      throw InputError("tone-curve sweep", "recordings of different sensor formats",
                       "one camera, one mode");
    }
    for (const RawFrame& frame : capture.frames) {
      if (frame.light != kNoLight)
        by_light[frame.light].emplace(frame.exposure_s * frame.gain, &frame);
    }
  }
  std::vector<const RawFrame*> best;
  for (const auto& [light, frames] : by_light) {
    if (frames.size() <= best.size()) continue;
    best.clear();
    for (const auto& entry : frames)
      best.push_back(entry.second);
  }
  if (best.size() < kLeastExposures) {
    throw InputError("tone-curve sweep", std::to_string(best.size()) + " exposures under one light",
                     "at least " + std::to_string(kLeastExposures) + ", with role: ptc");
  }
  return best;
}

/// X as a linear camera's counts over black, in round figures.
ToneCurve in_dn(ToneCurve curve, const SensorFormat& sensor) {
  const auto full = static_cast<std::size_t>(sensor.full_well_dn);
  const double shift = std::log(sensor.full_well_dn - sensor.black_level_dn) - curve.log_x[full];
  for (double& g : curve.log_x)
    g = std::round((g + shift) / kRounding) * kRounding;
  for (double& s : curve.sigma)
    s = std::max(kRounding, std::round(s / kRounding) * kRounding);
  return curve;
}

struct CellSum {
  cv::Mat value, variance;
  int planes = 0;
};

void add_plane(const Radiance& plane, CellSum& into) {
  if (into.planes++ == 0) {
    into.value = plane.value;
    into.variance = plane.variance;
    return;
  }
  into.value += plane.value;
  into.variance += plane.variance;
}

}  // namespace

Response recover_response(const std::vector<Capture>& sweep, double margin) {
  const std::vector<const RawFrame*> frames = sweep_frames(sweep);
  const SensorFormat& sensor = sweep.front().sensor;
  ToneCurveSettings settings;
  settings.levels = 1 << sensor.bits;
  settings.margin = margin;
  settings.black = sensor.black_level_dn;
  settings.top = sensor.full_well_dn;
  Response response(static_cast<std::size_t>(sensor.channels()));
  for (const Plane& plane : planes_of(sensor, frames)) {
    ToneCurve& curve = response[static_cast<std::size_t>(plane.channel)];
    if (curve.levels() > 0) continue;  // the second green
    curve = in_dn(recover_tone_curve(plane.images, times_of(frames), settings), sensor);
  }
  return response;
}

Radiance merge_bracket(const SensorFormat& sensor, const Response& response,
                       const std::vector<RawFrame>& frames) {
  const int channels = sensor.channels();
  if (static_cast<int>(response.size()) != channels ||
      response.front().levels() != 1 << sensor.bits) {
    throw InputError(
        "tone curve", "a response of another sensor",
        std::to_string(channels) + " channels of " + std::to_string(sensor.bits) + " bits");
  }
  if (frames.empty()) throw InputError("bracket", "no frame", "at least one exposure");
  std::vector<const RawFrame*> all;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (frames[i].counts.size() != cv::Size(sensor.width, sensor.height) ||
        frames[i].counts.type() != CV_16UC1) {
      throw InputError("frame " + std::to_string(i), "counts of another size or type",
                       std::to_string(sensor.width) + " x " + std::to_string(sensor.height));
    }
    all.push_back(&frames[i]);
  }
  std::vector<CellSum> sums(static_cast<std::size_t>(channels));
  cv::Mat mask = cv::Mat::zeros(sensor.cells(), CV_8UC1);
  for (const Plane& plane : planes_of(sensor, all)) {
    const auto c = static_cast<std::size_t>(plane.channel);
    const Radiance merged = merge_toned(plane.images, times_of(all), response[c]);
    add_plane(merged, sums[c]);
    mask |= merged.mask;
  }
  std::vector<cv::Mat> value, variance;
  for (const CellSum& sum : sums) {
    value.push_back(sum.value / sum.planes);
    variance.push_back(sum.variance / (sum.planes * sum.planes));
  }
  Radiance out;
  cv::merge(value, out.value);
  cv::merge(variance, out.variance);
  out.mask = mask;
  return out;
}

}  // namespace brdfgate
