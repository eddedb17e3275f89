#include "model/tone_curve.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <tuple>

#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr int kPasses = 4;             // weights, then the curve, in turn
constexpr double kCauchy = 3;          // sigmas: what moved between exposures weighs little
constexpr double kLeastSigmaDn = 0.5;  // of one count; rounding alone gives 0.29
constexpr std::size_t kLeastPixels = 100;
constexpr std::size_t kPixelsPerCount = 500;  // of every image
constexpr double kLeastSlope = 1e-6;          // of ln X per count

int count_at(const cv::Mat& image, int row, int column) {
  return image.depth() == CV_8U ? image.at<std::uint8_t>(row, column)
                                : image.at<std::uint16_t>(row, column);
}

void check(const std::vector<cv::Mat>& images, const std::vector<double>& times_s, int levels,
           std::size_t least_images) {
  if (images.size() < least_images || images.size() != times_s.size()) {
    throw InputError("bracket",
                     std::to_string(images.size()) + " images with " +
                         std::to_string(times_s.size()) + " exposure times",
                     "at least " + std::to_string(least_images) + " images, each with its time");
  }
  for (std::size_t j = 0; j < images.size(); ++j) {
    const std::string where = "bracket[" + std::to_string(j) + "]";
    const cv::Mat& image = images[j];
    if (image.type() != CV_8UC1 && image.type() != CV_16UC1) {
      throw InputError(where, "is no image of 8- or 16-bit counts of one channel");
    }
    if (image.size() != images[0].size() || image.type() != images[0].type() || image.empty()) {
      throw InputError(where, "differs in size or type from the first", "one camera, one mode");
    }
    double top = 0;
    cv::minMaxLoc(image, nullptr, &top);
    if (top >= levels) {
      throw InputError(where, "holds count " + std::to_string(static_cast<int>(top)),
                       "under " + std::to_string(levels));
    }
    if (!(times_s[j] > 0) || !std::isfinite(times_s[j])) {
      throw InputError(where, "exposure " + std::to_string(times_s[j]) + " s", "over 0");
    }
  }
}

void check_times_differ(const std::vector<double>& times_s) {
  const auto [least, most] = std::minmax_element(times_s.begin(), times_s.end());
  if (!(*most > *least)) {
    throw InputError("bracket", "every exposure has the same time", "times that differ");
  }
}

/// One pixel's samples that are not clipped.
struct Samples {
  std::vector<int> count;
  std::vector<double> log_t;

  void gather(const std::vector<cv::Mat>& images, const std::vector<double>& log_times,
              const ToneCurve& curve, const cv::Point& at) {
    count.clear();
    log_t.clear();
    for (std::size_t j = 0; j < images.size(); ++j) {
      const int z = count_at(images[j], at.y, at.x);
      if (z < curve.least || z > curve.most) continue;
      count.push_back(z);
      log_t.push_back(log_times[j]);
    }
  }
  std::size_t size() const { return count.size(); }
};

/// The normal equations of g with every ln E eliminated, and each count's scatter.
struct Equations {
  explicit Equations(int levels)
      : A(Eigen::MatrixXd::Zero(levels, levels)), b(Eigen::VectorXd::Zero(levels)) {}

  void add(const Samples& s, const std::vector<double>& weight) {
    double total = 0, mean_t = 0;
    for (std::size_t j = 0; j < s.size(); ++j) {
      total += weight[j];
      mean_t += weight[j] * s.log_t[j];
    }
    mean_t /= total;
    for (std::size_t j = 0; j < s.size(); ++j) {
      A(s.count[j], s.count[j]) += weight[j];
      b(s.count[j]) += weight[j] * (s.log_t[j] - mean_t);
      for (std::size_t i = 0; i < s.size(); ++i)
        A(s.count[i], s.count[j]) -= weight[i] * weight[j] / total;
    }
  }
  Eigen::MatrixXd A;
  Eigen::VectorXd b;
};

/// Range of the counts around a pixel in one image.
int local_range(const cv::Mat& image, const cv::Point& at) {
  int least = count_at(image, at.y, at.x);
  int most = least;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      const int z = count_at(image, at.y + dy, at.x + dx);
      least = std::min(least, z);
      most = std::max(most, z);
    }
  }
  return most - least;
}

struct Candidate {
  int range;
  cv::Point at;
};

/// For every image and count the pixels whose surroundings are flattest: what moved a little
/// between exposures does no harm there, and no count outvotes the others by its area.
std::vector<cv::Point> choose_pixels(const std::vector<cv::Mat>& images, const ToneCurve& curve) {
  std::vector<cv::Point> chosen;
  for (const cv::Mat& image : images) {
    std::vector<std::vector<Candidate>> by_count(static_cast<std::size_t>(curve.levels()));
    for (int y = 1; y + 1 < image.rows; ++y) {
      for (int x = 1; x + 1 < image.cols; ++x) {
        const int z = count_at(image, y, x);
        if (z < curve.least || z > curve.most) continue;
        by_count[static_cast<std::size_t>(z)].push_back({local_range(image, {x, y}), {x, y}});
      }
    }
    for (auto& pixels : by_count) {
      const std::size_t n = std::min(pixels.size(), kPixelsPerCount);
      std::partial_sort(pixels.begin(), pixels.begin() + static_cast<std::ptrdiff_t>(n),
                        pixels.end(), [](const Candidate& a, const Candidate& b) {
                          return std::tie(a.range, a.at.y, a.at.x) <
                                 std::tie(b.range, b.at.y, b.at.x);
                        });
      for (std::size_t i = 0; i < n; ++i)
        chosen.push_back(pixels[i].at);
    }
  }
  return chosen;
}

std::vector<double> logs(const std::vector<double>& times_s) {
  std::vector<double> out;
  for (const double t : times_s)
    out.push_back(std::log(t));
  return out;
}

/// ln E of one pixel by the curve, and its samples' weights, those far off weighing little.
double log_radiance(const Samples& s, const ToneCurve& curve, std::vector<double>& weight) {
  weight.resize(s.size());
  double value = 0;
  for (int pass = 0; pass < 2; ++pass) {
    double total = 0, sum = 0;
    for (std::size_t j = 0; j < s.size(); ++j) {
      const auto z = static_cast<std::size_t>(s.count[j]);
      const double one = curve.log_x[z] - s.log_t[j];
      const double off = pass == 0 ? 0 : (one - value) / (kCauchy * curve.sigma[z]);
      weight[j] = 1 / (curve.sigma[z] * curve.sigma[z] * (1 + off * off));
      total += weight[j];
      sum += weight[j] * one;
    }
    value = sum / total;
  }
  return value;
}

/// Rising from count to count: pool adjacent violators, then at least a trace of slope.
void make_monotonic(std::vector<double>& g) {
  std::vector<std::pair<double, int>> pools;
  for (const double value : g) {
    pools.emplace_back(value, 1);
    while (pools.size() > 1 && pools[pools.size() - 2].first > pools.back().first) {
      const auto last = pools.back();
      pools.pop_back();
      auto& into = pools.back();
      into.first =
          (into.first * into.second + last.first * last.second) / (into.second + last.second);
      into.second += last.second;
    }
  }
  std::size_t at = 0;
  for (const auto& [value, n] : pools) {
    for (int i = 0; i < n; ++i)
      g[at++] = value;
  }
  for (std::size_t z = 1; z < g.size(); ++z)
    g[z] = std::max(g[z], g[z - 1] + kLeastSlope);
}

double slope_at(const std::vector<double>& g, int z) {
  const int last = static_cast<int>(g.size()) - 1;
  const int a = std::clamp(z - 2, 0, last);
  const int b = std::clamp(z + 2, 0, last);
  return (g[static_cast<std::size_t>(b)] - g[static_cast<std::size_t>(a)]) / (b - a);
}

/// Solves for g with its second differences held small, weighed by how well a count is known.
void solve(Equations& eq, const ToneCurveSettings& settings, ToneCurve& curve) {
  const int n = curve.levels();
  const int middle = n / 2;
  const double typical = eq.A.diagonal().sum() / n;
  for (int z = 1; z + 1 < n; ++z) {
    const double hat = 0.02 + 1 - std::abs(2.0 * z / (n - 1) - 1);
    const double w = settings.smoothness * typical * hat * hat;
    const Eigen::Vector3d d(1, -2, 1);
    eq.A.block<3, 3>(z - 1, z - 1) += w * d * d.transpose();
  }
  eq.A(middle, middle) += typical * n;  // the scale: g(middle) = 0
  const Eigen::VectorXd g = eq.A.ldlt().solve(eq.b);
  for (int z = 0; z < n; ++z)
    curve.log_x[static_cast<std::size_t>(z)] = g[z] - g[middle];
  make_monotonic(curve.log_x);
}

/// The first guess tells nothing of who is far off: its weights are plain.
void plain_weights(const Samples& s, const ToneCurve& curve, std::vector<double>& weight) {
  for (std::size_t j = 0; j < s.size(); ++j)
    weight[j] = std::pow(curve.sigma[static_cast<std::size_t>(s.count[j])], -2);
}

/// Squares of each count's distance from its pixel's ln E.
struct Scatter {
  explicit Scatter(int levels)
      : squares(Eigen::VectorXd::Zero(levels)), n(Eigen::VectorXd::Zero(levels)) {}

  void add(const Samples& s, const ToneCurve& curve, const std::vector<double>& weight,
           double log_e) {
    double total = 0;
    for (const double w : weight)
      total += w;
    for (std::size_t j = 0; j < s.size(); ++j) {
      const auto z = static_cast<std::size_t>(s.count[j]);
      const double off = curve.log_x[z] - s.log_t[j] - log_e;
      // Robust: weight times sigma^2 is 1 for a good sample and falls off beyond kCauchy. A
      // sample that dominates its pixel's mean shows less of its scatter: by 1 - weight / total.
      const double trust = weight[j] * curve.sigma[z] * curve.sigma[z];
      squares[s.count[j]] += off * off * trust;
      n[s.count[j]] += trust * (1 - weight[j] / total);
    }
  }
  Eigen::VectorXd squares, n;
};

/// Each count's scatter about its pixel's ln E, averaged over neighbouring counts, never under what
/// half a count makes.
void set_sigma(const Scatter& found, ToneCurve& curve) {
  const int levels = curve.levels();
  const int reach = std::max(2, levels / 64);
  for (int z = 0; z < levels; ++z) {
    const int a = std::max(0, z - reach);
    const int width = std::min(levels - 1, z + reach) - a + 1;
    const double samples = found.n.segment(a, width).sum();
    const double scatter =
        samples > 0 ? std::sqrt(found.squares.segment(a, width).sum() / samples) : 0;
    const double floor = kLeastSigmaDn * slope_at(curve.log_x, z);
    curve.sigma[static_cast<std::size_t>(z)] = std::max({scatter, floor, 1e-4});
  }
}

/// What the first pass starts from: a line through the origin, trusted in the middle of the range.
ToneCurve first_guess(const ToneCurveSettings& settings) {
  const int n = settings.levels;
  ToneCurve curve;
  const double top = settings.top > 0 ? settings.top : n - 1;
  const double margin = std::max(1.0, settings.margin * (top - settings.black));
  curve.least = static_cast<int>(std::ceil(settings.black + margin));
  curve.most = static_cast<int>(std::floor(top - margin));
  const double middle = (settings.black + top + 1) / 2;
  for (int z = 0; z < n; ++z) {
    const double hat = std::max(0.0, std::min(z - settings.black, top - z)) + 1.0;
    curve.log_x.push_back(std::log(std::max(z - settings.black, 0.0) + 0.5) -
                          std::log(middle - settings.black));
    curve.sigma.push_back(0.02 * n / hat);
  }
  return curve;
}

}  // namespace

ToneCurve recover_tone_curve(const std::vector<cv::Mat>& images, const std::vector<double>& times_s,
                             const ToneCurveSettings& settings) {
  check(images, times_s, settings.levels, 2);
  check_times_differ(times_s);
  const std::vector<double> log_times = logs(times_s);
  ToneCurve curve = first_guess(settings);
  const std::vector<cv::Point> chosen = choose_pixels(images, curve);
  Samples samples;
  std::vector<double> weight;
  for (int pass = 0; pass < kPasses; ++pass) {
    Equations equations(settings.levels);
    Scatter scatter(settings.levels);
    std::size_t pixels = 0;
    for (const cv::Point& at : chosen) {
      samples.gather(images, log_times, curve, at);
      if (samples.size() < 2) continue;
      ++pixels;
      const double log_e = log_radiance(samples, curve, weight);
      if (pass == 0) {
        plain_weights(samples, curve, weight);
      } else {
        scatter.add(samples, curve, weight, log_e);
      }
      equations.add(samples, weight);
    }
    if (pixels < kLeastPixels) {
      throw InputError("bracket", std::to_string(pixels) + " pixels are well exposed twice",
                       "at least " + std::to_string(kLeastPixels) +
                           ": exposures that overlap, a scene of many levels");
    }
    if (pass > 0) set_sigma(scatter, curve);
    solve(equations, settings, curve);
  }
  return curve;
}

Radiance merge_toned(const std::vector<cv::Mat>& images, const std::vector<double>& times_s,
                     const ToneCurve& curve) {
  check(images, times_s, curve.levels(), 1);
  const std::vector<double> log_times = logs(times_s);
  Radiance out;
  out.value.create(images[0].size(), CV_32FC1);
  out.variance.create(images[0].size(), CV_32FC1);
  out.mask = cv::Mat::zeros(images[0].size(), CV_8UC1);
  const auto [shortest, longest] = std::minmax_element(times_s.begin(), times_s.end());
  const double most = std::exp(curve.log_x[static_cast<std::size_t>(curve.most)]) / *shortest;
  const double least = std::exp(curve.log_x[static_cast<std::size_t>(curve.least)]) / *longest;
  cv::parallel_for_(cv::Range(0, out.value.rows), [&](const cv::Range& rows) {
    Samples samples;
    std::vector<double> weight;
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < out.value.cols; ++x) {
        samples.gather(images, log_times, curve, {x, y});
        double value = 0, variance = 0;
        if (samples.size() == 0) {
          const bool bright =
              count_at(images[0], y, x) > curve.most || count_at(images.back(), y, x) > curve.most;
          value = bright ? most : least;
          variance = value * value;
          out.mask.at<std::uint8_t>(y, x) = bright ? kClipped : kNoiseFloor;
        } else {
          value = std::exp(log_radiance(samples, curve, weight));
          variance = value * value / std::accumulate(weight.begin(), weight.end(), 0.0);
        }
        out.value.at<float>(y, x) = static_cast<float>(value);
        out.variance.at<float>(y, x) = static_cast<float>(variance);
      }
    }
  });
  return out;
}

}  // namespace brdfgate
