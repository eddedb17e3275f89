#include "model/log_image.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>

#include "model/error.hpp"

namespace brdfgate {
namespace {

const cv::Size kWindow(3, 3);

void check(const Reflectance& r) {
  const bool type = r.value.type() == CV_32FC1 || r.value.type() == CV_32FC3;
  if (!type || r.variance.type() != r.value.type() || r.mask.type() != CV_8UC1) {
    throw InputError("reflectance",
                     "images of types " + std::to_string(r.value.type()) + ", " +
                         std::to_string(r.variance.type()) + ", " + std::to_string(r.mask.type()),
                     "32-bit float of 1 or 3 channels with an 8-bit mask");
  }
  if (r.variance.size() != r.value.size() || r.mask.size() != r.value.size()) {
    throw InputError("reflectance", "value, variance and mask of different sizes", "one size");
  }
}

cv::Mat window_sum(const cv::Mat& image, const cv::Mat& outside) {
  cv::Mat sum = image.clone();
  sum.setTo(0, outside);
  cv::boxFilter(sum, sum, CV_32F, kWindow, {-1, -1}, false, cv::BORDER_CONSTANT);
  return sum;
}

}  // namespace

const Reflectance& diffuse_light(const std::vector<Reflectance>& r) {
  if (r.empty()) throw InputError("reflectance", "no light", "lights 1 and 2");
  for (const Reflectance& light : r)
    check(light);
  return r.size() > 1 ? r[1] : r[0];
}

LogImage smoothed_log(const Reflectance& r, const cv::Mat& use) {
  cv::Mat used = use & ((r.mask & cv::Scalar(kInvalid)) == 0);
  const cv::Mat outside = ~used;
  cv::Mat count;
  cv::boxFilter(used / 255, count, CV_32F, kWindow, {-1, -1}, false, cv::BORDER_CONSTANT);
  LogImage out{window_sum(r.value, outside), window_sum(r.variance, outside)};
  const int channels = r.value.channels();
  for (int v = 0; v < used.rows; ++v) {
    const auto* u8 = used.ptr<unsigned char>(v);
    const auto* n = count.ptr<float>(v);
    auto* value = out.value.ptr<float>(v);
    auto* variance = out.variance.ptr<float>(v);
    for (int i = 0; i < used.cols * channels; ++i) {
      const int u = channels == 1 ? i : i / channels;
      if (!u8[u]) {
        value[i] = variance[i] = 0;
        continue;
      }
      const float inverse = 1.0F / n[u];
      const float f = std::max(value[i] * inverse, 0.0F) + static_cast<float>(kLogFloor);
      value[i] = std::log(f);
      variance[i] *= inverse * inverse / (f * f);
    }
  }
  return out;
}

}  // namespace brdfgate
