// Parts drawn straight as reflectance, without camera or merge: the product's rig, analytic
// materials, a region map over the plane, and the photon noise that the bracket leaves.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <opencv2/core.hpp>
#include <random>
#include <vector>

#include "model/analytic.hpp"
#include "model/geometry.hpp"
#include "model/pose.hpp"
#include "model/reflectance.hpp"
#include "model/regions.hpp"

namespace brdfgate::test {

/// The default rig; `width` x `height` cells (each a 2x2 mosaic cell, or a pixel of a mono sensor).
struct SyntheticStation {
  SensorFormat sensor;
  StationGeometry geometry;
  StationMap map;

  explicit SyntheticStation(int width = 364, int height = 272, Mosaic mosaic = Mosaic::rggb) {
    const int side = mosaic == Mosaic::mono ? 1 : 2;
    sensor.width = width * side;
    sensor.height = height * side;
    sensor.bits = 10;
    sensor.mosaic = mosaic;
    NominalRig rig;
    rig.lights = {{55, 180, 0.3}, {20, 0, 0.3}};
    geometry = make_geometry(rig, sensor);
    map.cells = cell_geometry(geometry, sensor, {0.09, 0.09});
    map.bins = make_bin_map(map.cells);
  }
};

/// Index of the material at a point of the plane (metres), or kNotPart for the fixture.
using RegionAt = std::function<int(double x_m, double y_m)>;

/// A square part of 80 mm in one material.
inline int plain_part(double x_m, double y_m) {
  return std::max(std::abs(x_m), std::abs(y_m)) <= 0.04 ? 0 : kNotPart;
}

struct SyntheticPart {
  RegionAt region = plain_part;
  std::vector<BrdfPtr> materials;
  Rgb fixture{0.01, 0.25, 0.40};
  unsigned seed = 1;
  bool noise = true;
  /// Multiplies f at a point; empty: nothing.
  std::function<Rgb(double x_m, double y_m)> change;
  /// How it lies. Regions stay where they are in the image; values are what the taught pose would
  /// make of the light.
  PartPose pose;
};

/// Noise of a 60 ms bracket on a 10,000 e- sensor: 1 % where an exposure is well filled, a few per
/// cent on black.
inline double synthetic_variance(double f) {
  return f * f / 8000 + std::abs(f) * 0.3 / 50000 + 9e-10;
}

inline cv::Mat true_labels(const SyntheticStation& station, const RegionAt& region) {
  cv::Mat label(station.map.cells.inside.size(), CV_8UC1, cv::Scalar(kNotPart));
  for (int v = 0; v < label.rows; ++v) {
    for (int u = 0; u < label.cols; ++u) {
      if (!station.map.cells.inside.at<unsigned char>(v, u)) continue;
      const auto p = station.map.cells.position_m.at<cv::Vec2f>(v, u);
      label.at<unsigned char>(v, u) = static_cast<unsigned char>(region(p[0], p[1]));
    }
  }
  return label;
}

/// f of one inspected cell without noise.
inline Rgb true_reflectance(const SyntheticStation& station, const SyntheticPart& part,
                            std::size_t light, const cv::Point& at, unsigned char material) {
  if (material == kNotPart) return part.fixture / std::numbers::pi;
  const auto a = station.map.cells.angles[light].at<cv::Vec3f>(at);
  const auto p = station.map.cells.position_m.at<cv::Vec2f>(at);
  Rgb f;
  if (part.pose.none()) {
    f = part.materials[material]->eval({a[0], a[1], a[2]});
  } else {
    Eigen::Vector4d light_W;
    light_W << station.geometry.lights_W[light], 1;
    const Sightline line{station.geometry.camera.position(), {p[0], p[1], 0}, light_W};
    f = part.materials[material]->eval(line.angles(part.pose)) *
        (line.irradiance(part.pose) / line.irradiance({}));
  }
  if (part.change) f *= part.change(p[0], p[1]);
  return f;
}

inline std::vector<Reflectance> render(const SyntheticStation& station, const SyntheticPart& part) {
  const cv::Mat label = true_labels(station, part.region);
  const int channels = station.sensor.channels();
  std::mt19937 random(part.seed);
  std::normal_distribution<double> normal;
  std::vector<cv::Point> inspected;
  cv::findNonZero(station.map.cells.inside, inspected);
  std::vector<Reflectance> out;
  for (std::size_t light = 0; light < station.map.cells.angles.size(); ++light) {
    Reflectance r{cv::Mat::zeros(label.size(), CV_32FC(channels)),
                  cv::Mat::zeros(label.size(), CV_32FC(channels)),
                  cv::Mat::zeros(label.size(), CV_8UC1)};
    r.mask.setTo(kInvalid, station.map.cells.inside == 0);
    for (const cv::Point& at : inspected) {
      const Rgb f = true_reflectance(station, part, light, at, label.at<unsigned char>(at));
      for (int c = 0; c < channels; ++c) {
        const double variance = synthetic_variance(f[c]);
        const double error = part.noise ? std::sqrt(variance) * normal(random) : 0;
        const int i = at.x * channels + c;
        r.value.ptr<float>(at.y)[i] = static_cast<float>(f[c] + error);
        r.variance.ptr<float>(at.y)[i] = static_cast<float>(variance);
      }
    }
    out.push_back(r);
  }
  return out;
}

/// 255 where the part is not: the ideal fixture mask.
inline cv::Mat true_not_part(const SyntheticStation& station, const RegionAt& region) {
  return true_labels(station, region) == kNotPart;
}

inline BrdfPtr matte(const Rgb& albedo) {
  return make_brdf(LambertParameters{albedo});
}
inline BrdfPtr shiny(const Rgb& diffuse, const Rgb& f0, double alpha) {
  return make_brdf(GgxParameters{diffuse, f0, alpha});
}

/// Expected ln f in light 2's bins, from a noiseless part of one material over the whole region.
inline TaughtAppearance taught_from(const SyntheticStation& station, const BrdfPtr& material) {
  SyntheticPart all;
  all.materials = {material};
  all.noise = false;
  all.region = [](double, double) { return 0; };
  const std::vector<Reflectance> r = render(station, all);
  const Regions whole{true_labels(station, all.region), 1, 1.0};
  const BinnedSamples samples = bin_samples(r, station.map, whole, 0, {0, 1});
  TaughtAppearance taught;
  taught.log_f = Eigen::ArrayXXd::Constant(station.map.bins.bins(), samples.channels, NAN);
  for (const Bin& b : samples.bins) {
    if (b.light != 2) continue;
    for (int c = 0; c < samples.channels; ++c)
      taught.log_f(b.id, c) = std::log(b.f[c]);
  }
  return taught;
}

}  // namespace brdfgate::test
