#include "model/radiance.hpp"

#include <algorithm>
#include <string>

#include "model/error.hpp"
#include "model/merge.hpp"

namespace brdfgate {
namespace {

std::string size_text(const cv::Mat& m) {
  return std::to_string(m.cols) + " x " + std::to_string(m.rows) + " x " +
         std::to_string(m.channels());
}

void check_same_layout(const Radiance& lit, const Radiance& ambient) {
  if (lit.value.size() != ambient.value.size() || lit.value.type() != ambient.value.type()) {
    throw InputError("ambient frame", size_text(ambient.value),
                     size_text(lit.value) + " like the frame under light");
  }
}

std::vector<RawFrame> frames_under(const Capture& capture, LightIndex light) {
  std::vector<RawFrame> frames;
  for (const RawFrame& frame : capture.frames) {
    if (frame.light == light) frames.push_back(frame);
  }
  return frames;
}

void check_lights(const Capture& capture, int lights) {
  for (std::size_t i = 0; i < capture.frames.size(); ++i) {
    const LightIndex light = capture.frames[i].light;
    if (light < kNoLight || light > lights) {
      throw InputError("frame " + std::to_string(i), "light " + std::to_string(light),
                       "none or 1 to " + std::to_string(lights));
    }
  }
}

Radiance merge_light(const Capture& capture, const BracketMerge& merge, LightIndex light) {
  const std::vector<RawFrame> frames = frames_under(capture, light);
  if (frames.empty()) {
    const std::string name = light == kNoLight ? "the ambient frame"
                                               : "the bracket under light " + std::to_string(light);
    throw InputError("capture", name + " is missing",
                     light == kNoLight ? "at least one frame with every light off"
                                       : "at least one frame under each light");
  }
  return merge(frames);
}

}  // namespace

Radiance merge_bracket(const SensorFormat& sensor, const SensorNoise& noise,
                       const std::vector<RawFrame>& frames) {
  check_bracket(sensor, noise, frames);
  const cv::Size size = sensor.cells();
  const int type = CV_32FC(sensor.channels());
  Radiance out;
  out.value.create(size, type);
  out.variance.create(size, type);
  out.mask.create(size, CV_8UC1);
  const MergePlan plan(sensor, noise, frames);
  cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& rows) {
    MergeScratch scratch(plan);
    for (int v = rows.start; v < rows.end; ++v)
      merge_cell_row(plan, v, scratch, out);
  });
  return out;
}

Radiance subtract_ambient(const Radiance& lit, const Radiance& ambient) {
  check_same_layout(lit, ambient);
  Radiance out;
  cv::subtract(lit.value, ambient.value, out.value);
  cv::add(lit.variance, ambient.variance, out.variance);
  cv::bitwise_and(ambient.mask, cv::Scalar(static_cast<unsigned char>(~kNoiseFloor)), out.mask);
  cv::bitwise_or(out.mask, lit.mask, out.mask);
  return out;
}

RadianceSet to_radiance(const Capture& capture, const SensorNoise& noise, int lights) {
  return to_radiance(capture, lights, [&](const std::vector<RawFrame>& bracket) {
    return merge_bracket(capture.sensor, noise, bracket);
  });
}

RadianceSet to_radiance(const Capture& capture, int lights, const BracketMerge& merge) {
  check_lights(capture, lights);
  RadianceSet set;
  set.ambient = merge_light(capture, merge, kNoLight);
  for (LightIndex light = 1; light <= lights; ++light) {
    set.lights.push_back(subtract_ambient(merge_light(capture, merge, light), set.ambient));
  }
  return set;
}

}  // namespace brdfgate
