// How well a real camera's bracket agrees with itself, beside OpenCV's Debevec pair.
//
//   bracket --bracket DIR
//
// DIR holds 8-bit images and image_list.txt (file, exposure in seconds per line; '#' comments). The
// even and the odd exposures are two disjoint brackets of one scene: where both see a pixel
// unclipped their radiance should be the same. Prints |log2 ratio| per channel and for all.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/photo.hpp>
#include <random>
#include <sstream>

#include "model/error.hpp"
#include "model/tone_curve.hpp"

namespace {

using namespace brdfgate;

struct Bracket {
  std::vector<cv::Mat> images;  ///< CV_8UC3
  std::vector<double> times_s;
};

Bracket read_bracket(const std::string& folder) {
  std::ifstream list(folder + "/image_list.txt");
  if (!list) throw InputError(folder + "/image_list.txt", "cannot be read", "a list of exposures");
  Bracket bracket;
  for (std::string line; std::getline(list, line);) {
    std::istringstream fields(line);
    std::string name;
    double time_s = 0;
    if (!(fields >> name) || name[0] == '#') continue;
    if (!(fields >> time_s) || !(time_s > 0)) throw InputError(line, "no exposure", "file seconds");
    bracket.images.push_back(cv::imread(folder + "/" + name, cv::IMREAD_COLOR));
    if (bracket.images.back().empty()) throw InputError(name, "is no image");
    bracket.times_s.push_back(time_s);
  }
  return bracket;
}

Bracket half(const Bracket& whole, std::size_t first) {
  Bracket out;
  for (std::size_t j = first; j < whole.images.size(); j += 2) {
    out.images.push_back(whole.images[j]);
    out.times_s.push_back(whole.times_s[j]);
  }
  return out;
}

std::vector<cv::Mat> channel(const Bracket& bracket, int c) {
  std::vector<cv::Mat> out(bracket.images.size());
  for (std::size_t j = 0; j < out.size(); ++j)
    cv::extractChannel(bracket.images[j], out[j], c);
  return out;
}

using Halves = std::array<cv::Mat, 2>;  // CV_32FC3 each

/// What the merge claims: unmasked, and a relative standard deviation.
using Claims = std::array<std::array<cv::Mat, 3>, 2>;  // CV_32FC1 by half and channel, -1 masked

/// Response from `from`, both halves merged with it.
Halves ours(const std::array<Bracket, 2>& halves, const std::array<const Bracket*, 2>& from,
            Claims* claims = nullptr) {
  Halves out;
  for (std::size_t h = 0; h < 2; ++h) {
    std::vector<cv::Mat> planes(3);
    for (int c = 0; c < 3; ++c) {
      const auto i = static_cast<std::size_t>(c);
      const ToneCurve curve = recover_tone_curve(channel(*from[h], c), from[h]->times_s);
      const Radiance merged = merge_toned(channel(halves[h], c), halves[h].times_s, curve);
      planes[i] = merged.value;
      if (claims == nullptr) continue;
      cv::Mat& relative = (*claims)[h][i];
      cv::sqrt(merged.variance, relative);
      relative /= merged.value;
      relative.setTo(-1, merged.mask != 0);
    }
    cv::merge(planes, out[h]);
  }
  return out;
}

/// Pixels, per channel, of which both halves claim to know the radiance within `sigma`.
std::array<cv::Mat, 3> known_within(const Claims& claims, double sigma) {
  std::array<cv::Mat, 3> out;
  for (std::size_t c = 0; c < 3; ++c)
    out[c] =
        (claims[0][c] >= 0) & (claims[0][c] < sigma) & (claims[1][c] >= 0) & (claims[1][c] < sigma);
  return out;
}

Halves opencv(const std::array<Bracket, 2>& halves, const std::array<const Bracket*, 2>& from) {
  Halves out;
  for (std::size_t h = 0; h < 2; ++h) {
    cv::Mat response;
    const std::vector<float> times(from[h]->times_s.begin(), from[h]->times_s.end());
    cv::createCalibrateDebevec()->process(from[h]->images, response, times);
    const std::vector<float> own(halves[h].times_s.begin(), halves[h].times_s.end());
    cv::createMergeDebevec()->process(halves[h].images, out[h], own, response);
  }
  return out;
}

/// Pixels that have a count at least `margin` from either end in each half, per channel.
cv::Mat seen_by_both(const std::array<Bracket, 2>& halves, int c, int margin) {
  cv::Mat both;
  for (const Bracket& h : halves) {
    cv::Mat any = cv::Mat::zeros(h.images[0].size(), CV_8UC1);
    for (const cv::Mat& plane : channel(h, c)) {
      cv::Mat good;
      cv::inRange(plane, margin, 255 - margin, good);
      any |= good;
    }
    both = both.empty() ? any : cv::Mat(both & any);
  }
  return both;
}

/// Pixels whose surroundings vary by under a tenth in every image that exposes them well: nothing
/// that moved by part of a pixel, and no compression of texture, shows there.
cv::Mat flat_surroundings(const Bracket& bracket, int c) {
  cv::Mat rough = cv::Mat::zeros(bracket.images[0].size(), CV_8UC1);
  for (const cv::Mat& plane : channel(bracket, c)) {
    cv::Mat most, least, level, good;
    cv::dilate(plane, most, {});
    cv::erode(plane, least, {});
    plane.convertTo(level, CV_8U, 0.1);
    cv::inRange(plane, 40, 215, good);
    rough |= good & ((most - least) > level);
  }
  return ~rough;
}

struct Agreement {
  std::vector<double> log2_ratio;
  double at(double share) {
    const auto place =
        log2_ratio.begin() + static_cast<std::ptrdiff_t>(share * double(log2_ratio.size() - 1));
    std::nth_element(log2_ratio.begin(), place, log2_ratio.end());
    return *place;
  }
};

Agreement agreement(const Halves& radiance, const std::array<Bracket, 2>& halves, int margin,
                    const std::array<cv::Mat, 3>& where) {
  Agreement out;
  for (int c = 0; c < 3; ++c) {
    cv::Mat both = seen_by_both(halves, c, margin);
    if (!where[0].empty()) both &= where[static_cast<std::size_t>(c)];
    for (int y = 0; y < both.rows; ++y) {
      for (int x = 0; x < both.cols; ++x) {
        if (both.at<std::uint8_t>(y, x) == 0) continue;
        const double a = radiance[0].at<cv::Vec3f>(y, x)[c];
        const double b = radiance[1].at<cv::Vec3f>(y, x)[c];
        out.log2_ratio.push_back(a > 0 && b > 0 ? std::abs(std::log2(a / b)) : HUGE_VAL);
      }
    }
  }
  return out;
}

/// What two halves that differ by nothing but the noise they claim would show: one draw per value.
Agreement of_claimed_noise(const Claims& claims, const std::array<Bracket, 2>& halves, int margin,
                           double below) {
  Agreement out;
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (int c = 0; c < 3; ++c) {
    const auto i = static_cast<std::size_t>(c);
    const cv::Mat both = seen_by_both(halves, c, margin);
    for (int y = 0; y < both.rows; ++y) {
      for (int x = 0; x < both.cols; ++x) {
        const double a = claims[0][i].at<float>(y, x), b = claims[1][i].at<float>(y, x);
        if (both.at<std::uint8_t>(y, x) == 0 || a < 0 || b < 0 || std::max(a, b) >= below) continue;
        out.log2_ratio.push_back(std::abs(normal(random)) * std::hypot(a, b) / std::numbers::ln2);
      }
    }
  }
  return out;
}

void print(const char* name, Agreement found) {
  if (found.log2_ratio.empty()) {
    std::printf("  %-42s %8d\n", name, 0);
    return;
  }
  std::printf("  %-42s %8zu %8.4f %8.4f\n", name, found.log2_ratio.size(), found.at(0.5),
              found.at(0.95));
}

int run(const std::string& folder) {
  const Bracket whole = read_bracket(folder);
  const std::array<Bracket, 2> halves{half(whole, 0), half(whole, 1)};
  const std::array<const Bracket*, 2> one{&whole, &whole};
  const std::array<const Bracket*, 2> own{&halves[0], &halves[1]};
  Claims claims;
  const std::array<std::pair<const char*, Halves>, 4> methods{{
      {"brdfgate, response of the whole bracket", ours(halves, one, &claims)},
      {"brdfgate, each half its own response", ours(halves, own)},
      {"OpenCV Debevec, response of the whole", opencv(halves, one)},
      {"OpenCV Debevec, each half its own", opencv(halves, own)},
  }};
  std::printf("|log2 ratio| between the halves' radiance\n");
  const std::array<cv::Mat, 3> flat{flat_surroundings(whole, 0), flat_surroundings(whole, 1),
                                    flat_surroundings(whole, 2)};
  for (const bool only_flat : {false, true}) {
    for (const int margin : {13, 26, 56}) {
      std::printf("where both halves have a count of %d to %d%s:\n", margin, 255 - margin,
                  only_flat ? ", flat surroundings" : "");
      std::printf("  %-42s %8s %8s %8s\n", "", "values", "median", "95 %");
      for (const auto& [name, radiance] : methods)
        print(name,
              agreement(radiance, halves, margin, only_flat ? flat : std::array<cv::Mat, 3>{}));
      if (!only_flat) print("the claimed noise alone", of_claimed_noise(claims, halves, margin, 9));
    }
  }
  for (const double sigma : {0.2, 0.1, 0.07, 0.05}) {
    std::printf("where both halves are unclipped and claim a sigma under %g:\n", sigma);
    for (const auto& [name, radiance] : methods)
      print(name, agreement(radiance, halves, 1, known_within(claims, sigma)));
    print("the claimed noise alone", of_claimed_noise(claims, halves, 1, sigma));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("how well a real camera's bracket agrees with itself");
  std::string folder;
  app.add_option("--bracket", folder, "folder with images and image_list.txt")->required();
  CLI11_PARSE(app, argc, argv);
  try {
    return run(folder);
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 2;
  }
}
