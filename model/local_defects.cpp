#include "model/local_defects.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <string>

#include "model/defect_scores.hpp"

namespace brdfgate {
namespace {

/// A blob's mean change per light and channel, and where it is.
struct Blob {
  double area = 0;  ///< m^2
  cv::Vec2d position{0, 0};
  std::array<std::array<double, 3>, 2> change{};
  double roughening = 0;  ///< what a rougher surface would do to light 1 there, ln units per ln
  double z = 0;
  double largest() const {
    double most = 0;
    for (const auto& light : change)
      for (const double c : light)
        if (std::abs(c) > std::abs(most)) most = c;
    return most;
  }
};

class BlobFinder {
 public:
  BlobFinder(const DefectEvidence& part, const DefectBlocks& blocks, const DefectReference& taught,
             const std::vector<BrdfPtr>& materials)
      : part_(part), blocks_(blocks), materials_(materials) {
    const double limit = taught.limit;
    beyond_ = cv::Mat::zeros(part.home.size(), CV_8UC1);
    peak_ = cv::Mat::zeros(part.home.size(), CV_32FC1);
    for (std::size_t light = 0; light < part.lights.size(); ++light) {
      const DefectEvidence::Light& seen = part.lights[light];
      const ExpectedResidual expected = expected_residual(taught, part, light);
      own_.push_back(windows_of(seen, blocks.span(kDefectWindowsMm[0])).mean - expected.mean);
      for (const double mm : kDefectWindowsMm)
        mark(defect_scores(windows_of(seen, blocks.span(mm)), expected), limit);
    }
  }

  std::vector<Blob> blobs() const {
    cv::Mat joined, numbers, stats, centroids;
    cv::morphologyEx(beyond_, joined, cv::MORPH_CLOSE,
                     cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
    const int n = cv::connectedComponentsWithStats(joined, numbers, stats, centroids, 8, CV_32S);
    std::vector<Blob> out;
    for (int i = 1; i < n; ++i) {
      const cv::Rect box(stats.at<int>(i, cv::CC_STAT_LEFT), stats.at<int>(i, cv::CC_STAT_TOP),
                         stats.at<int>(i, cv::CC_STAT_WIDTH), stats.at<int>(i, cv::CC_STAT_HEIGHT));
      out.push_back(measure(numbers, i, box));
    }
    return out;
  }

 private:
  void mark(const cv::Mat& z, double limit) {
    const int channels = z.channels();
    for (int v = 0; v < z.rows; ++v) {
      for (int i = 0; i < z.cols * channels; ++i) {
        const float size = std::abs(z.ptr<float>(v)[i]);
        float& most = peak_.ptr<float>(v)[i / channels];
        most = std::max(most, size);
        if (size > limit) beyond_.ptr<unsigned char>(v)[i / channels] = 255;
      }
    }
  }

  /// The strongest departure of a component: light, channel and value.
  struct Strongest {
    std::size_t light = 0;
    int channel = 0;
    float value = 0;
  };
  Strongest strongest(const cv::Mat& numbers, int number, const cv::Rect& box) const {
    Strongest most;
    for (std::size_t light = 0; light < own_.size(); ++light) {
      const int channels = own_[light].channels();
      for (int v = box.y; v < box.y + box.height; ++v) {
        for (int u = box.x; u < box.x + box.width; ++u) {
          if (numbers.at<int>(v, u) != number) continue;
          for (int c = 0; c < channels; ++c) {
            const float x = own_[light].ptr<float>(v)[u * channels + c];
            if (std::abs(x) > std::abs(most.value)) most = {light, c, x};
          }
        }
      }
    }
    return most;
  }

  /// The component and its close surroundings, as far as they show half of its strongest departure
  /// or more: a window smears what it sees over its own width.
  Blob measure(const cv::Mat& numbers, int number, const cv::Rect& box) const {
    const Strongest most = strongest(numbers, number, box);
    const cv::Mat& image = own_[most.light];
    Blob blob;
    int count = 0;
    for (int v = box.y; v < box.y + box.height; ++v) {
      for (int u = box.x; u < box.x + box.width; ++u) {
        if (numbers.at<int>(v, u) != number) continue;
        blob.z = std::max(blob.z, double(peak_.at<float>(v, u)));
        const float x = image.ptr<float>(v)[u * image.channels() + most.channel];
        if (x * most.value < 0 || std::abs(x) < std::abs(most.value) / 2) continue;
        add(blob, {u, v});
        ++count;
      }
    }
    if (count == 0 || blob.area <= 0) return blob;
    blob.position /= blob.area;
    blob.roughening /= count;
    for (auto& light : blob.change)
      for (double& c : light)
        c /= count;
    return blob;
  }

  void add(Blob& blob, const cv::Point& at) const {
    const double area = blocks_.area_m2().at<float>(at);
    blob.area += area;
    blob.position += area * cv::Vec2d(blocks_.position_m().at<cv::Vec2f>(at));
    for (std::size_t light = 0; light < std::min<std::size_t>(2, own_.size()); ++light) {
      const int channels = own_[light].channels();
      for (int c = 0; c < 3; ++c) {
        blob.change[light][static_cast<std::size_t>(c)] +=
            own_[light].ptr<float>(at.y)[at.x * channels + (channels == 1 ? 0 : c)];
      }
    }
    blob.roughening += roughening(at);
  }

  /// d ln f / d ln(roughness) under light 1: the lobe widened and lowered at constant energy.
  double roughening(const cv::Point& at) const {
    const std::size_t cluster = part_.home.at<unsigned char>(at);
    if (cluster >= materials_.size() || !materials_[cluster]) return 0;
    constexpr double kWider = 1.1;
    const HalfDiff angles = blocks_.sightline(0, at).angles(PartPose{});
    HalfDiff narrow = angles;
    narrow.theta_h /= kWider;
    const Brdf& f = *materials_[cluster];
    const double before = f.eval(angles).mean();
    const double after =
        before - f.specular(angles).mean() + f.specular(narrow).mean() / (kWider * kWider);
    return before > 0 && after > 0 ? std::log(after / before) / std::log(kWider) : 0;
  }

  const DefectEvidence& part_;
  const DefectBlocks& blocks_;
  const std::vector<BrdfPtr>& materials_;
  cv::Mat beyond_;
  cv::Mat peak_;
  std::vector<cv::Mat> own_;  ///< per light: departures of the smallest window
};

double strongest_of(const std::array<double, 3>& light) {
  return *std::max_element(light.begin(), light.end(),
                           [](double a, double b) { return std::abs(a) < std::abs(b); });
}

/// Light 2 sees pigment; what light 1 alone shows is the lobe's. Channels that disagree in sign, or
/// spread by more than half of the strongest, are a colour.
std::string kind_of(const Blob& blob, std::size_t lights) {
  const std::array<double, 3>& diffuse = blob.change[lights > 1 ? 1 : 0];
  const double level = strongest_of(diffuse);
  if (lights > 1 && std::abs(level) < 0.5 * std::abs(strongest_of(blob.change[0]))) {
    const double lobe = strongest_of(blob.change[0]);
    // Away from the peak a rougher surface is brighter.
    const bool rougher = blob.roughening > 0.1 ? lobe > 0 : lobe < 0;
    return rougher ? "duller" : "glossier";
  }
  const auto [low, high] = std::minmax_element(diffuse.begin(), diffuse.end());
  if (*high - *low > 0.5 * std::abs(level)) return "colour";
  return level < 0 ? "darker" : "lighter";
}

}  // namespace

std::vector<Defect> find_defects(const DefectEvidence& part, const DefectBlocks& blocks,
                                 const DefectReference& taught,
                                 const std::vector<BrdfPtr>& materials,
                                 const JudgeSettings& settings) {
  DefectReference reference = taught;
  if (reference.parts == 0 || !(reference.limit > 0)) {
    reference.limit =
        defect_limit({}, independent_windows(part, blocks), settings.false_reject_rate);
  }
  std::vector<Defect> defects;
  for (const Blob& blob : BlobFinder(part, blocks, reference, materials).blobs()) {
    const double change = blob.largest();
    if (blob.area * 1e6 < settings.defect_min_mm2) continue;
    if (std::abs(change) < settings.defect_log_threshold) continue;
    Defect defect;
    defect.kind = kind_of(blob, part.lights.size());
    defect.at_mm = {blob.position[0] * 1e3, blob.position[1] * 1e3};
    defect.size_mm = 2 * std::sqrt(blob.area / std::numbers::pi) * 1e3;
    defect.score = blob.z / reference.limit;
    defect.change = change;
    defects.push_back(std::move(defect));
  }
  std::sort(defects.begin(), defects.end(),
            [](const Defect& a, const Defect& b) { return a.size_mm > b.size_mm; });
  return defects;
}

}  // namespace brdfgate
