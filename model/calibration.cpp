#include "model/calibration.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "model/error.hpp"
#include "model/merge.hpp"
#include "model/noise_measurement.hpp"

namespace brdfgate {
namespace {

/// A dark frame may lie this far from the datasheet's black level, as a share of the range.
constexpr double kBlackTolerance = 0.02;
/// Rise of a dark frame over the shortest one (dark current, or a light leak), share of the range.
constexpr double kDarkRise = 0.0025;
/// A white must reach this share of full well in its longest exposure.
constexpr double kLeastWhite = 0.10;
/// Cells of a white that may be clipped in the shortest exposure (dust glints); they are masked.
constexpr double kMostClipped = 0.01;

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

std::string capture_name(const char* kind, std::size_t index) {
  return std::string(kind) + "[" + std::to_string(index) + "]";
}

std::string frame_name(const std::string& capture, std::size_t index) {
  return capture + ".frames[" + std::to_string(index) + "]";
}

double range_dn(const SensorFormat& sensor) {
  return sensor.full_well_dn - sensor.black_level_dn;
}

void check_formats(const char* kind, const std::vector<Capture>& captures,
                   const SensorFormat& sensor) {
  for (std::size_t i = 0; i < captures.size(); ++i) {
    if (!(captures[i].sensor == sensor)) {
      throw InputError(capture_name(kind, i), "another sensor format than darks[0]",
                       "recordings of one camera in one mode");
    }
    if (captures[i].frames.empty()) {
      throw InputError(capture_name(kind, i), "no frame", "a recording with frames");
    }
  }
}

/// Sizes, exposures and gains as merge_bracket wants them, named by recording.
void check_frames(const char* kind, const std::vector<Capture>& captures,
                  const SensorNoise& noise) {
  for (std::size_t i = 0; i < captures.size(); ++i) {
    try {
      check_bracket(captures[i].sensor, noise, captures[i].frames);
    } catch (const InputError& e) {
      throw InputError(capture_name(kind, i), e.what());
    }
  }
}

void check_input(const CalibrationInput& input) {
  if (input.darks.empty()) {
    throw InputError("darks", "no dark recording", "at least one, with every light off");
  }
  if (input.whites.empty()) {
    throw InputError("whites", "no white recording",
                     "at least one of the reference plate under every light");
  }
  if (input.geometry.lights_W.empty()) {
    throw InputError("geometry", "no light", "the position of every light");
  }
  check_formats("darks", input.darks, input.darks.front().sensor);
  check_formats("whites", input.whites, input.darks.front().sensor);
  check_frames("darks", input.darks, input.nominal);
  check_frames("whites", input.whites, input.nominal);
}

struct DarkFrame {
  std::string name;
  double exposure_s = 0;
  double mean_dn = 0;
};

std::vector<DarkFrame> dark_frames(const std::vector<Capture>& darks) {
  std::vector<DarkFrame> out;
  for (std::size_t i = 0; i < darks.size(); ++i) {
    for (std::size_t j = 0; j < darks[i].frames.size(); ++j) {
      const RawFrame& frame = darks[i].frames[j];
      const std::string name = frame_name(capture_name("darks", i), j);
      if (frame.light != kNoLight) {
        throw InputError(name, "taken under light " + std::to_string(frame.light),
                         "every light off");
      }
      out.push_back({name, frame.exposure_s, cv::mean(frame.counts)[0]});
    }
  }
  return out;
}

void check_darks(const CalibrationInput& input) {
  const SensorFormat& sensor = input.darks.front().sensor;
  const std::vector<DarkFrame> frames = dark_frames(input.darks);
  const DarkFrame& shortest = *std::min_element(
      frames.begin(), frames.end(),
      [](const DarkFrame& a, const DarkFrame& b) { return a.exposure_s < b.exposure_s; });
  const double tolerance = kBlackTolerance * range_dn(sensor);
  const double rise = std::max(kDarkRise * range_dn(sensor), 3 * input.nominal.read_noise_dn);
  for (const DarkFrame& frame : frames) {
    if (std::abs(frame.mean_dn - sensor.black_level_dn) > tolerance) {
      throw InputError(frame.name, "a dark with a mean of " + number(frame.mean_dn) + " DN",
                       "the black level, " + number(sensor.black_level_dn) + " DN, within " +
                           number(tolerance) + ": lights off, lens covered");
    }
    if (frame.mean_dn > shortest.mean_dn + rise) {
      throw InputError(frame.name,
                       "a dark that rises by " + number(frame.mean_dn - shortest.mean_dn) +
                           " DN from " + number(shortest.exposure_s * 1e3) + " to " +
                           number(frame.exposure_s * 1e3) + " ms",
                       "at most " + number(rise) + " DN: light leaks in, cover the lens");
    }
  }
}

/// The light gathered by the frames must follow their exposure times.
void check_exposure_order(const Capture& white, const std::string& name, LightIndex light) {
  std::vector<const RawFrame*> frames;
  for (const RawFrame& frame : white.frames) {
    if (frame.light == light) frames.push_back(&frame);
  }
  const auto time = [](const RawFrame* f) { return f->exposure_s * f->gain; };
  std::stable_sort(frames.begin(), frames.end(),
                   [&](auto* a, auto* b) { return time(a) < time(b); });
  for (std::size_t i = 1; i < frames.size(); ++i) {
    const double before = cv::mean(frames[i - 1]->counts)[0];
    const double after = cv::mean(frames[i]->counts)[0];
    if (after < before - kDarkRise * range_dn(white.sensor)) {
      throw InputError(name,
                       "under light " + std::to_string(light) + " the mean falls from " +
                           number(before) + " to " + number(after) + " DN from " +
                           number(time(frames[i - 1]) * 1e3) + " to " +
                           number(time(frames[i]) * 1e3) + " ms",
                       "more signal in more time: exposures mixed up, or the light failed");
    }
  }
}

/// Median over the middle of the image, where the plate is sure to lie, of the weakest channel.
double central_radiance(const Radiance& white) {
  const cv::Mat& all = white.value;
  const cv::Rect middle(all.cols / 4, all.rows / 4, std::max(1, all.cols / 2),
                        std::max(1, all.rows / 2));
  std::vector<cv::Mat> channels;
  cv::split(all(middle), channels);
  double least = HUGE_VAL;
  for (const cv::Mat& channel : channels) {
    std::vector<float> values(channel.begin<float>(), channel.end<float>());
    const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), half, values.end());
    least = std::min(least, static_cast<double>(*half));
  }
  return least;
}

double share_of_clipped(const Radiance& radiance) {
  cv::Mat clipped;
  cv::bitwise_and(radiance.mask, cv::Scalar(kClipped), clipped);
  return cv::countNonZero(clipped) / static_cast<double>(clipped.total());
}

void check_white(const Capture& capture, const Radiance& white, const std::string& name,
                 LightIndex light) {
  double longest = 0, shortest = HUGE_VAL;
  for (const RawFrame& frame : capture.frames) {
    if (frame.light != light) continue;
    longest = std::max(longest, frame.exposure_s * frame.gain);
    shortest = std::min(shortest, frame.exposure_s * frame.gain);
  }
  const double reached = central_radiance(white) * longest / range_dn(capture.sensor);
  const std::string under = " under light " + std::to_string(light);
  if (!(reached >= kLeastWhite)) {
    throw InputError(name,
                     "white is dark" + under + ": " + number(100 * reached) +
                         " % of full well in " + number(longest * 1e3) + " ms",
                     "at least " + number(100 * kLeastWhite) +
                         " %: the plate under the camera and the light burning");
  }
  const double clipped = share_of_clipped(white);
  if (clipped > kMostClipped) {
    throw InputError(name,
                     "white is clipped" + under + ": " + number(100 * clipped) +
                         " % of the cells even in " + number(shortest * 1e3) + " ms",
                     "a shorter exposure in the bracket");
  }
}

RadianceSet white_radiance(const Capture& capture, const Calibration& calibration,
                           const std::string& name) {
  const int lights = static_cast<int>(calibration.geometry.lights_W.size());
  Capture levelled = capture;  // shares the counts
  levelled.sensor = calibration.sensor;
  RadianceSet set;
  try {
    set = to_radiance(capture, calibration);
  } catch (const InputError& e) {
    throw InputError(name, e.what());
  }
  for (LightIndex light = 1; light <= lights; ++light) {
    check_exposure_order(levelled, name, light);
    check_white(levelled, set.lights[static_cast<std::size_t>(light - 1)], name, light);
  }
  return set;
}

void add(Radiance& sum, const Radiance& term) {
  if (sum.value.empty()) {
    sum = term;
    return;
  }
  cv::add(sum.value, term.value, sum.value);
  cv::add(sum.variance, term.variance, sum.variance);
  cv::bitwise_or(sum.mask, term.mask, sum.mask);
}

std::vector<Radiance> mean_white(const CalibrationInput& input, const Calibration& calibration) {
  std::vector<Radiance> mean(calibration.geometry.lights_W.size());
  for (std::size_t i = 0; i < input.whites.size(); ++i) {
    const RadianceSet set = white_radiance(input.whites[i], calibration, capture_name("whites", i));
    for (std::size_t l = 0; l < mean.size(); ++l)
      add(mean[l], set.lights[l]);
  }
  const double n = static_cast<double>(input.whites.size());
  for (Radiance& white : mean) {
    white.value /= n;
    white.variance /= n * n;
  }
  return mean;
}

}  // namespace

DarkLevels measure_darks(const CalibrationInput& input) {
  if (input.darks.empty()) {
    throw InputError("darks", "no dark recording", "at least one, with every light off");
  }
  check_formats("darks", input.darks, input.darks.front().sensor);
  check_frames("darks", input.darks, input.nominal);
  check_darks(input);
  return {measure_black_level(input.darks), measure_read_noise(input.darks, input.nominal)};
}

Capture levelled(const Capture& capture, const Calibration& calibration) {
  SensorFormat expected = capture.sensor;
  expected.black_level_dn = calibration.sensor.black_level_dn;
  expected.full_well_dn = calibration.sensor.full_well_dn;
  if (!(expected == calibration.sensor)) {
    throw InputError("capture",
                     std::to_string(expected.width) + " x " + std::to_string(expected.height) +
                         " at " + std::to_string(expected.bits) + " bits is another sensor format",
                     std::to_string(calibration.sensor.width) + " x " +
                         std::to_string(calibration.sensor.height) + " at " +
                         std::to_string(calibration.sensor.bits) + " bits, as calibrated");
  }
  return {calibration.sensor, capture.frames};
}

RadianceSet to_radiance(const Capture& capture, const Calibration& calibration) {
  const Capture seen = levelled(capture, calibration);
  const int lights = static_cast<int>(calibration.geometry.lights_W.size());
  if (calibration.response.empty()) return to_radiance(seen, calibration.noise, lights);
  return to_radiance(seen, lights, [&](const std::vector<RawFrame>& bracket) {
    return merge_bracket(calibration.sensor, calibration.response, bracket);
  });
}

Calibration calibrate(const CalibrationInput& input) {
  check_input(input);
  const DarkLevels dark = measure_darks(input);
  Calibration out;
  out.sensor = input.darks.front().sensor;
  out.sensor.black_level_dn = dark.black_level_dn;
  if (input.full_well_dn)
    out.sensor.full_well_dn = std::min(out.sensor.full_well_dn, *input.full_well_dn);
  out.noise = input.nominal;
  out.noise.read_noise_dn = dark.read_noise_dn;
  if (input.gain_dn_per_e) out.noise.gain_dn_per_e = *input.gain_dn_per_e;
  out.response = input.response;
  out.geometry = input.geometry;
  out.white_reflectance = input.white_reflectance;
  out.white = mean_white(input, out);
  if (input.whites.size() >= 2 && !input.gain_dn_per_e && input.response.empty()) {
    std::vector<Capture> levelled = input.whites;
    for (Capture& capture : levelled)
      capture.sensor = out.sensor;
    out.noise.gain_dn_per_e = measure_gain(levelled, out.noise);
    out.white = mean_white(input, out);  // again: weights and variances follow the gain
  }
  return out;
}

}  // namespace brdfgate
