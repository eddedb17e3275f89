#include "model/local_defects.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <random>
#include <string>

#include "model/error.hpp"

namespace brdfgate {
namespace {

/// Windows that defects are looked for in; about a defect's own size each.
constexpr std::array<double, 3> kWindowsMm{1.0, 2.2, 4.0};
/// The one whose part-to-part deviation is taught.
constexpr std::size_t kTaughtWindow = 0;
/// Share of a window that must be inside the cluster.
constexpr float kLeastShare = 0.5F;
/// ln units: no deviation is taken for smaller (the calibration's own structure), and what stands
/// in for one where fewer than three parts, or none, were seen.
constexpr float kLeastDeviation = 0.004F;
constexpr float kUntaughtDeviation = 0.03F;
constexpr int kFewParts = 3;
/// Gaussian limit's factor where too few maxima tell of the tail.
constexpr double kFewMargin = 1.5;

double normal_quantile_above(double tail) {
  double low = 0, high = 40;
  for (int i = 0; i < 80; ++i) {
    const double x = (low + high) / 2;
    (0.5 * std::erfc(x / std::numbers::sqrt2) > tail ? low : high) = x;
  }
  return low;
}

struct Gumbel {
  double location = 0, scale = 0;
};
/// By moments.
Gumbel fit_gumbel(const std::vector<double>& x) {
  const auto n = static_cast<double>(x.size());
  const double mean = std::accumulate(x.begin(), x.end(), 0.0) / n;
  double squares = 0;
  for (const double v : x)
    squares += (v - mean) * (v - mean);
  const double scale = std::sqrt(squares / (n - 1) * 6) / std::numbers::pi;
  return {mean - std::numbers::egamma * scale, scale};
}

/// How many fitted scales above its fitted location the (1 - rate) quantile of a fresh maximum
/// lies, N maxima having made the fit: the fit is equivariant, so the standard Gumbel law tells it.
double predictive_reach(std::size_t n, double rate) {
  constexpr int kFits = 2000;
  std::mt19937 random(20190408);
  std::uniform_real_distribution<double> uniform(1e-12, 1.0);
  std::vector<Gumbel> fits;
  std::vector<double> drawn(n);
  for (int i = 0; i < kFits; ++i) {
    for (double& x : drawn)
      x = -std::log(-std::log(uniform(random)));
    fits.push_back(fit_gumbel(drawn));
  }
  double low = 0, high = 1000;
  for (int step = 0; step < 60; ++step) {
    const double reach = (low + high) / 2;
    double beyond = 0;
    for (const Gumbel& g : fits)
      beyond += -std::expm1(-std::exp(-(g.location + reach * g.scale)));
    (beyond / kFits > rate ? low : high) = reach;
  }
  return high;
}

/// What a window of one size shows of one light.
struct Windows {
  cv::Mat mean;      ///< CV_32FC(channels)
  cv::Mat variance;  ///< of that, from noise
  cv::Mat use;       ///< CV_32FC1, share of the window that counts
};

Windows windows_of(const DefectEvidence::Light& light, const cv::Size& span) {
  Windows w;
  const auto mean = [&span](const cv::Mat& image) {
    cv::Mat out;
    cv::boxFilter(image, out, CV_32F, span, {-1, -1}, true, cv::BORDER_CONSTANT);
    return out;
  };
  w.use = mean(light.use);
  w.mean = mean(light.residual);
  w.variance = mean(light.variance);
  const int channels = w.mean.channels();
  const auto blocks = static_cast<float>(span.area());
  for (int v = 0; v < w.use.rows; ++v) {
    const auto* share = w.use.ptr<float>(v);
    const auto* here = light.use.ptr<float>(v);
    const auto* floor = light.floor.ptr<float>(v);
    auto* m = w.mean.ptr<float>(v);
    auto* var = w.variance.ptr<float>(v);
    for (int i = 0; i < w.use.cols * channels; ++i) {
      const int u = i / channels;
      if (share[u] < kLeastShare || here[u] <= 0) {
        m[i] = 0;
        var[i] = -1;  // not looked at
        continue;
      }
      m[i] /= share[u];
      var[i] = var[i] / (share[u] * share[u] * blocks) + floor[u];
    }
  }
  return w;
}

/// A taught image on tiles, run on smoothly over the blocks.
cv::Mat over_blocks(const cv::Mat& tiles, const cv::Size& size) {
  cv::Mat out(size, tiles.type());
  constexpr int kTile = DefectReference::kTileBlocks;
  cv::Mat large;
  cv::resize(tiles, large, {tiles.cols * kTile, tiles.rows * kTile}, 0, 0, cv::INTER_LINEAR);
  large(cv::Rect({0, 0}, size)).copyTo(out);
  return out;
}

cv::Size tiles_of(const cv::Size& blocks) {
  constexpr int kTile = DefectReference::kTileBlocks;
  return {(blocks.width + kTile - 1) / kTile, (blocks.height + kTile - 1) / kTile};
}

/// Mean and deviation of good parts over the blocks of one light.
struct Expected {
  cv::Mat mean, deviation;
};
Expected expected_of(const DefectReference& taught, std::size_t light, const cv::Mat& like) {
  if (taught.parts == 0 || light >= taught.mean.size()) {
    return {cv::Mat::zeros(like.size(), like.type()),
            cv::Mat(like.size(), like.type(), cv::Scalar::all(kUntaughtDeviation))};
  }
  const cv::Mat &mean = taught.mean[light], &deviation = taught.deviation[light];
  if (mean.size() != tiles_of(like.size()) || mean.type() != like.type() ||
      deviation.size() != mean.size() || deviation.type() != like.type()) {
    throw InputError("recipe defects", "images of another station's size", "teach again");
  }
  return {over_blocks(mean, like.size()), over_blocks(deviation, like.size())};
}

/// Signed z of every block and channel; 0 where it is not looked at.
cv::Mat scores(const Windows& w, const Expected& expected) {
  cv::Mat z(w.mean.size(), w.mean.type());
  const int n = z.cols * z.channels();
  for (int v = 0; v < z.rows; ++v) {
    const auto* m = w.mean.ptr<float>(v);
    const auto* var = w.variance.ptr<float>(v);
    const auto* mean = expected.mean.ptr<float>(v);
    const auto* s = expected.deviation.ptr<float>(v);
    auto* out = z.ptr<float>(v);
    for (int i = 0; i < n; ++i)
      out[i] = var[i] < 0 ? 0.0F : (m[i] - mean[i]) / std::sqrt(s[i] * s[i] + var[i]);
  }
  return z;
}

template <typename Visit>
void for_each_score(const DefectEvidence& part, const DefectBlocks& blocks,
                    const DefectReference& taught, Visit&& visit) {
  for (std::size_t light = 0; light < part.lights.size(); ++light) {
    const Expected expected = expected_of(taught, light, part.lights[light].residual);
    for (const double mm : kWindowsMm)
      visit(scores(windows_of(part.lights[light], blocks.span(mm)), expected));
  }
}

// ---- teaching

/// Sums of one part's tiles, per light: of blocks, residuals and their squares.
struct TileSums {
  cv::Mat blocks, sum, squares;  ///< CV_64FC(channels), all of them
};

TileSums tile_sums(const DefectEvidence::Light& light, const cv::Size& window) {
  const Windows w = windows_of(light, window);
  const cv::Size size = tiles_of(w.mean.size());
  const int channels = w.mean.channels();
  TileSums out{cv::Mat::zeros(size, CV_64FC(channels)), cv::Mat::zeros(size, CV_64FC(channels)),
               cv::Mat::zeros(size, CV_64FC(channels))};
  for (int v = 0; v < w.mean.rows; ++v) {
    const int row = v / DefectReference::kTileBlocks;
    for (int i = 0; i < w.mean.cols * channels; ++i) {
      if (w.variance.ptr<float>(v)[i] < 0) continue;
      const double x = w.mean.ptr<float>(v)[i];
      const int at = i / channels / DefectReference::kTileBlocks * channels + i % channels;
      out.blocks.ptr<double>(row)[at] += 1;
      out.sum.ptr<double>(row)[at] += x;
      out.squares.ptr<double>(row)[at] += x * x;
    }
  }
  return out;
}

void add(TileSums& to, const TileSums& part, double sign) {
  if (to.blocks.empty()) {
    to = {part.blocks.clone(), part.sum.clone(), part.squares.clone()};
    return;
  }
  cv::scaleAdd(part.blocks, sign, to.blocks, to.blocks);
  cv::scaleAdd(part.sum, sign, to.sum, to.sum);
  cv::scaleAdd(part.squares, sign, to.squares, to.squares);
}

/// Mean and deviation per tile; the deviation pooled with the neighbours' and floored.
void reference_of(const TileSums& total, int parts, cv::Mat& mean, cv::Mat& deviation) {
  const int channels = total.sum.channels();
  mean = cv::Mat::zeros(total.sum.size(), CV_32FC(channels));
  cv::Mat variance = cv::Mat::zeros(total.sum.size(), CV_32FC(channels));
  cv::Mat weight = variance.clone();
  for (int v = 0; v < mean.rows; ++v) {
    for (int i = 0; i < mean.cols * channels; ++i) {
      const double n = total.blocks.ptr<double>(v)[i];
      if (n < 0.5) continue;
      const double m = total.sum.ptr<double>(v)[i] / n;
      const double spread = std::max(0.0, total.squares.ptr<double>(v)[i] / n - m * m);
      mean.ptr<float>(v)[i] = static_cast<float>(m);
      variance.ptr<float>(v)[i] =
          static_cast<float>(spread * (parts > 1 ? parts / (parts - 1.0) : 1) * (1 + 1.0 / parts));
      weight.ptr<float>(v)[i] = 1;
    }
  }
  cv::Mat pooled, share;
  cv::boxFilter(variance, pooled, CV_32F, {3, 3}, {-1, -1}, true, cv::BORDER_CONSTANT);
  cv::boxFilter(weight, share, CV_32F, {3, 3}, {-1, -1}, true, cv::BORDER_CONSTANT);
  deviation.create(variance.size(), variance.type());
  const float least = parts < kFewParts ? kUntaughtDeviation : kLeastDeviation;
  for (int v = 0; v < mean.rows; ++v) {
    for (int i = 0; i < mean.cols * channels; ++i) {
      const float s = share.ptr<float>(v)[i], own = variance.ptr<float>(v)[i];
      const float spread = s > 1e-4F ? std::max(pooled.ptr<float>(v)[i] / s, own) : 0.0F;
      const bool seen = weight.ptr<float>(v)[i] > 0;
      deviation.ptr<float>(v)[i] = std::max(std::sqrt(spread), seen ? least : kUntaughtDeviation);
    }
  }
}

DefectReference reference_of(const std::vector<TileSums>& total, int parts) {
  DefectReference out;
  out.parts = parts;
  for (const TileSums& light : total) {
    out.mean.emplace_back();
    out.deviation.emplace_back();
    reference_of(light, parts, out.mean.back(), out.deviation.back());
  }
  return out;
}

/// Windows that a part has, all sizes, lights and channels.
double independent_windows(const DefectEvidence& part, const DefectBlocks& blocks) {
  double area_mm2 = 0;
  for (int v = 0; v < part.home.rows; ++v) {
    for (int u = 0; u < part.home.cols; ++u) {
      if (part.home.at<unsigned char>(v, u) < 8) area_mm2 += 1e6 * blocks.area_m2().at<float>(v, u);
    }
  }
  double windows = 0;
  for (const double mm : kWindowsMm)
    windows += area_mm2 / (mm * mm);
  const double images = part.lights.empty()
                            ? 1
                            : double(part.lights.size()) * part.lights.front().residual.channels();
  return std::max(1.0, windows * images);
}

void check_same(const std::vector<DefectEvidence>& parts) {
  if (parts.empty()) throw InputError("teaching defects", "no parts", "at least one");
  for (const DefectEvidence& part : parts) {
    bool same = part.lights.size() == parts.front().lights.size();
    for (std::size_t i = 0; same && i < part.lights.size(); ++i) {
      const cv::Mat &a = part.lights[i].residual, &b = parts.front().lights[i].residual;
      same = a.size() == b.size() && a.type() == b.type();
    }
    if (!same) throw InputError("teaching defects", "parts of different sizes", "one station's");
  }
}

// ---- blobs

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
      const Expected expected = expected_of(taught, light, seen.residual);
      own_.push_back(windows_of(seen, blocks.span(kWindowsMm[0])).mean - expected.mean);
      for (const double mm : kWindowsMm)
        mark(scores(windows_of(seen, blocks.span(mm)), expected), limit);
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

double defect_limit(const std::vector<double>& maxima, double windows, double rate) {
  if (!(rate > 0 && rate < 0.5)) throw InputError("defects", "false-alarm rate", "within (0, 0.5)");
  const double gaussian = normal_quantile_above(rate / (2 * std::max(1.0, windows)));
  if (maxima.size() < kFewMaxima) return kFewMargin * gaussian;
  const Gumbel fit = fit_gumbel(maxima);
  return std::max(gaussian, fit.location + predictive_reach(maxima.size(), rate) * fit.scale);
}

DefectReference teach_defects(const std::vector<DefectEvidence>& parts, const DefectBlocks& blocks,
                              double rate) {
  check_same(parts);
  const cv::Size window = blocks.span(kWindowsMm[kTaughtWindow]);
  std::vector<std::vector<TileSums>> sums;  // per part, per light
  std::vector<TileSums> total(parts.front().lights.size());
  for (const DefectEvidence& part : parts) {
    sums.emplace_back();
    for (std::size_t light = 0; light < total.size(); ++light) {
      sums.back().push_back(tile_sums(part.lights[light], window));
      add(total[light], sums.back().back(), 1);
    }
  }
  const int n = static_cast<int>(parts.size());
  DefectReference out = reference_of(total, n);
  std::vector<double> maxima;
  for (std::size_t i = 0; n >= kFewMaxima && i < parts.size(); ++i) {
    for (std::size_t light = 0; light < total.size(); ++light)
      add(total[light], sums[i][light], -1);
    maxima.push_back(defect_peak(parts[i], blocks, reference_of(total, n - 1)));
    for (std::size_t light = 0; light < total.size(); ++light)
      add(total[light], sums[i][light], 1);
  }
  out.limit = defect_limit(maxima, independent_windows(parts.front(), blocks), rate);
  return out;
}

double defect_peak(const DefectEvidence& part, const DefectBlocks& blocks,
                   const DefectReference& taught) {
  double peak = 0;
  for_each_score(part, blocks, taught, [&peak](const cv::Mat& z) {
    for (int v = 0; v < z.rows; ++v) {
      const auto* row = z.ptr<float>(v);
      for (int i = 0; i < z.cols * z.channels(); ++i)
        peak = std::max(peak, double(std::abs(row[i])));
    }
  });
  return peak;
}

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
