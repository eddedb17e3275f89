#include "app/pictures.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "app/html_page.hpp"
#include "model/error.hpp"
#include "model/reconstruction.hpp"

namespace brdfgate {
namespace {

constexpr double kTonedDecades = 3.0;
constexpr double kResidualSpan = 0.5;  ///< |ln| shown in full colour

/// IEC 61966-2-1 transfer curve.
double srgb_encode(double linear) {
  const double v = std::clamp(linear, 0.0, 1.0);
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
}

unsigned char to_byte(double v) {
  return static_cast<unsigned char>(std::lround(255 * std::clamp(v, 0.0, 1.0)));
}

cv::Vec3b to_bgr(const Rgb& linear) {
  return {to_byte(srgb_encode(linear[2])), to_byte(srgb_encode(linear[1])),
          to_byte(srgb_encode(linear[0]))};
}

float quantile(const cv::Mat& values, double q) {
  std::vector<float> sorted;
  sorted.reserve(values.total());
  for (int y = 0; y < values.rows; ++y) {
    const float* row = values.ptr<float>(y);
    sorted.insert(sorted.end(), row, row + values.cols);
  }
  const auto at = sorted.begin() + static_cast<long>(q * double(sorted.size() - 1));
  std::nth_element(sorted.begin(), at, sorted.end());
  return *at;
}

cv::Mat brightest_channel(const cv::Mat& value) {
  if (value.channels() == 1) return value;
  std::vector<cv::Mat> planes;
  cv::split(value, planes);
  return cv::max(cv::max(planes[0], planes[1]), planes[2]);
}

const std::array<cv::Vec3b, 8> kClusterColours{{{180, 119, 31},
                                                {14, 127, 255},
                                                {44, 160, 44},
                                                {189, 103, 148},
                                                {75, 86, 140},
                                                {194, 119, 227},
                                                {34, 189, 188},
                                                {207, 190, 23}}};

/// Mean luminance-like reflectance of each bin of one cluster, indexed by bin; 0 where it has none.
std::vector<float> bin_levels(const BinnedSamples& samples, int bins) {
  std::vector<float> level(static_cast<std::size_t>(bins), 0.0F);
  for (const Bin& bin : samples.bins) {
    level[static_cast<std::size_t>(bin.id)] =
        static_cast<float>(samples.channels == 1 ? bin.f[0] : bin.f.mean());
  }
  return level;
}

cv::Vec3b residual_colour(float f, float expected) {
  if (!(expected > 0)) return {0, 0, 0};
  const double r = std::log(std::max(f, 1e-6F) / expected) / kResidualSpan;
  const double s = 1 - std::min(1.0, std::abs(r));
  return r < 0 ? cv::Vec3b(255, to_byte(s), to_byte(s)) : cv::Vec3b(to_byte(s), to_byte(s), 255);
}

cv::Mat draw_residual(const Inspection& part, const StationMap& map, int light) {
  const Reflectance& r = part.reflectance[static_cast<std::size_t>(light)];
  const cv::Mat& bins = map.bins.id[static_cast<std::size_t>(light)];
  std::vector<std::vector<float>> levels;
  for (const BinnedSamples& s : part.samples)
    levels.push_back(bin_levels(s, map.bins.bins()));
  cv::Mat mean;
  cv::transform(r.value, mean,
                cv::Mat(1, r.value.channels(), CV_32F, cv::Scalar(1.0 / r.value.channels())));
  cv::Mat picture(mean.size(), CV_8UC3, cv::Scalar(0, 0, 0));
  for (int y = 0; y < mean.rows; ++y) {
    for (int x = 0; x < mean.cols; ++x) {
      const std::size_t label = part.result.regions.label.at<unsigned char>(y, x);
      const int bin = bins.at<int>(y, x);
      if (label >= levels.size() || bin < 0) continue;
      picture.at<cv::Vec3b>(y, x) =
          residual_colour(mean.at<float>(y, x), levels[label][static_cast<std::size_t>(bin)]);
    }
  }
  return picture;
}

constexpr double kRingGap = 5;  ///< px between a defect and the ring around it

/// The block whose centre is nearest, as a point among them.
cv::Point2d block_at(const DefectBlocks& blocks, const std::array<double, 2>& at_mm) {
  const cv::Vec2f wanted(float(at_mm[0] * 1e-3), float(at_mm[1] * 1e-3));
  cv::Point best;
  double least = std::numeric_limits<double>::infinity();
  for (int v = 0; v < blocks.size().height; ++v) {
    for (int u = 0; u < blocks.size().width; ++u) {
      const double d = cv::norm(blocks.position_m().at<cv::Vec2f>(v, u) - wanted, cv::NORM_L2SQR);
      if (d < least) {
        least = d;
        best = {u, v};
      }
    }
  }
  return {best.x + 0.5, best.y + 0.5};
}

cv::Mat side_by_side(const std::vector<cv::Mat>& pictures) {
  cv::Mat row;
  cv::hconcat(pictures, row);
  return row;
}

}  // namespace

cv::Mat tone_map(const Reflectance& reflectance) {
  const float white = std::max(1e-6F, quantile(brightest_channel(reflectance.value), 0.99));
  cv::Mat picture(reflectance.value.size(), CV_8UC3);
  const int channels = reflectance.value.channels();
  for (int y = 0; y < picture.rows; ++y) {
    const float* row = reflectance.value.ptr<float>(y);
    for (int x = 0; x < picture.cols; ++x) {
      for (int ch = 0; ch < 3; ++ch) {
        const float f = row[x * channels + (channels == 1 ? 0 : 2 - ch)];
        const double decades = std::log10(std::max(f, 1e-9F) / white) / kTonedDecades;
        picture.at<cv::Vec3b>(y, x)[ch] = to_byte(1 + decades);
      }
    }
  }
  return picture;
}

cv::Mat draw_regions(const Regions& regions, unsigned char background) {
  cv::Mat picture(regions.label.size(), CV_8UC3, cv::Scalar::all(background));
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      const unsigned char label = regions.label.at<unsigned char>(y, x);
      if (label == kUnknown) picture.at<cv::Vec3b>(y, x) = {40, 39, 214};
      if (label < kClusterColours.size()) picture.at<cv::Vec3b>(y, x) = kClusterColours[label];
    }
  }
  return picture;
}

cv::Vec3b cluster_colour(std::size_t index) {
  return kClusterColours[index % kClusterColours.size()];
}

cv::Mat draw_defect_scores(const cv::Mat1f& scores, double limit, const DefectBlocks& blocks,
                           const std::vector<Defect>& defects, int width_px) {
  const double scale = double(width_px) / scores.cols;
  cv::Mat picture;
  cv::Mat colours = diverging(scores, limit);
  for (int v = 0; v < scores.rows; ++v) {
    for (int u = 0; u < scores.cols; ++u)
      if (std::isnan(scores(v, u))) colours.at<cv::Vec3b>(v, u) = cv::Vec3b::all(kNothingGrey);
  }
  cv::resize(colours, picture, {}, scale, scale, cv::INTER_NEAREST);
  for (std::size_t i = 0; i < defects.size(); ++i) {
    const cv::Point2d at = scale * block_at(blocks, defects[i].at_mm);
    const cv::Size span = blocks.span(defects[i].size_mm);
    const double radius = scale * std::max(span.width, span.height) / 2 + kRingGap;
    cv::circle(picture, at, static_cast<int>(radius), cv::Scalar(0, 0, 0), 2, cv::LINE_AA);
    const cv::Point label(static_cast<int>(at.x + radius) + 3, static_cast<int>(at.y) + 5);
    cv::putText(picture, std::to_string(i + 1), label, cv::FONT_HERSHEY_SIMPLEX, 0.6,
                cv::Scalar(0, 0, 0), 2, cv::LINE_AA);
  }
  return picture;
}

cv::Mat render_sphere(const Brdf& brdf, int side_px) {
  struct PointLight {
    Eigen::Vector3d direction;
    double intensity;
  };
  const std::array<PointLight, 2> lights{{{Eigen::Vector3d(-0.4, 0.5, 0.77).normalized(), 2.2},
                                          {Eigen::Vector3d(0.9, 0.1, -0.35).normalized(), 1.6}}};
  cv::Mat picture(side_px, side_px, CV_8UC3, cv::Scalar(24, 24, 24));
  const Eigen::Vector3d wo_W(0, 0, 1);
  for (int y = 0; y < side_px; ++y) {
    for (int x = 0; x < side_px; ++x) {
      const double u = 2.1 * ((x + 0.5) / side_px - 0.5);
      const double v = 2.1 * (0.5 - (y + 0.5) / side_px);
      const double r2 = u * u + v * v;
      if (r2 >= 1) continue;
      const Eigen::Vector3d n(u, v, std::sqrt(1 - r2));
      const Eigen::Quaterniond to_surface =
          Eigen::Quaterniond::FromTwoVectors(n, Eigen::Vector3d::UnitZ());
      Rgb radiance = Rgb::Zero();
      for (const PointLight& light : lights) {
        const double cos_i = n.dot(light.direction);
        if (cos_i <= 0) continue;
        const HalfDiff angles = to_half_diff({to_surface * light.direction, to_surface * wo_W});
        radiance += light.intensity * cos_i * brdf.eval(angles);
      }
      picture.at<cv::Vec3b>(y, x) = to_bgr(radiance);
    }
  }
  return picture;
}

PartPictures draw(const Inspection& inspection, const Inspector& inspector) {
  PartPictures pictures;
  pictures.light1 = tone_map(inspection.reflectance[0]);
  pictures.light2 = tone_map(inspection.reflectance[1]);
  pictures.regions = draw_regions(inspection.result.regions);
  pictures.residual = side_by_side({draw_residual(inspection, inspector.map(), 0),
                                    draw_residual(inspection, inspector.map(), 1)});
  std::vector<cv::Mat> spheres;
  for (const ClusterResult& cluster : inspection.result.clusters) {
    if (cluster.valid.weights) {
      spheres.push_back(render_sphere(*make_brdf(inspector.shared_basis(), cluster.raw), 256));
    }
  }
  if (spheres.empty()) spheres.emplace_back(256, 256, CV_8UC3, cv::Scalar(24, 24, 24));
  pictures.spheres = side_by_side(spheres);
  return pictures;
}

std::vector<std::filesystem::path> write_pictures(const std::filesystem::path& dir,
                                                  const PartPictures& pictures) {
  std::error_code failed;
  std::filesystem::create_directories(dir, failed);
  if (failed) throw InputError(dir.string(), "cannot be created: " + failed.message());
  const std::vector<std::pair<const char*, const cv::Mat*>> named = {
      {"light1.png", &pictures.light1},
      {"light2.png", &pictures.light2},
      {"regions.png", &pictures.regions},
      {"residual.png", &pictures.residual},
      {"spheres.png", &pictures.spheres}};
  std::vector<std::filesystem::path> written;
  for (const auto& [name, picture] : named) {
    const auto file = dir / name;
    if (!cv::imwrite(file.string(), *picture)) throw InputError(file.string(), "cannot be written");
    written.push_back(file);
  }
  return written;
}

}  // namespace brdfgate
