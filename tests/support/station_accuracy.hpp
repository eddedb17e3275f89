// How right the reflectance of a station is that knows itself only from its calibration recordings.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "hal/sim/part.hpp"
#include "model/reflectance.hpp"
#include "support/sim_calibration.hpp"

namespace brdfgate::test {

/// A bench that nobody built quite as drawn: docs/calibration.md's simulator.deviation.
inline SimDeviation crooked() {
  using Eigen::Vector3d;
  SimDeviation d;
  d.camera_m = Vector3d(0.003, -0.002, 0.004);
  d.camera_deg = Vector3d(0.4, -0.3, 0.5);
  d.focal = 0.01;
  d.centre_px = Eigen::Vector2d(6, -5);
  d.distortion = {.k1 = -0.08, .k2 = 0.1, .p1 = 0.0005, .p2 = -0.0004};
  d.lights_m = {Vector3d(0.008, -0.006, 0.010), Vector3d(-0.007, 0.009, -0.008)};
  d.aim_m = {Vector3d(0.004, 0.003, 0), Vector3d(-0.003, 0.005, 0)};
  return d;
}

inline std::vector<NamedCapture> board_views(SimStation& station, BoardKind kind) {
  std::vector<NamedCapture> out;
  Scene scene = target_scene(SceneTarget::board);
  scene.board = kind;
  for (int i = 0; i < 7; ++i) {
    out.push_back(
        {"board " + std::to_string(i), record(station, scene, 5, static_cast<std::uint64_t>(i))});
    scene.jitter = {.shift_mm = {12, 12}, .rotation_deg = 10, .tilt_deg = {20, 20}, .height_mm = 3};
  }
  return out;
}

inline Calibration levelled(const SimBenchSettings& s, SimStation& station, int whites) {
  Scene dark = target_scene(SceneTarget::black);
  dark.lights_on = false;
  CalibrationInput input;
  input.darks = {record(station, dark, 1, 0), record(station, dark, 1, 1)};
  for (int i = 0; i < whites; ++i) {
    input.whites.push_back(
        record(station, target_scene(SceneTarget::white), 2, static_cast<std::uint64_t>(i)));
  }
  input.geometry = drawn_geometry(s);
  input.nominal = s.noise;
  return calibrate(input);
}

/// A bench calibrated from its recordings alone: dark, white, board, mirror, white on a spacer.
struct CalibratedBench {
  SimBenchSettings settings;
  SimStation station;
  Calibration calibration;
  GeometryResult found;

  /// @param scale  of the shipped sensor's sides
  CalibratedBench(double scale, int whites)
      : settings(shipped_bench(scale, crooked())), station(settings) {
    calibration = levelled(settings, station, whites);
    GeometryInput input;
    input.boards = board_views(station, BoardKind::checker);
    input.mirrors = {{"mirror", record(station, target_scene(SceneTarget::mirror), 3, 0)}};
    input.plate_m = {0.09, 0.09};
    Scene raised = target_scene(SceneTarget::white);
    raised.pose.height_mm = 10;
    input.raised = {{0.010, {"raised white", record(station, raised, 4, 0)}}};
    found = calibrate_geometry(input, calibration);
  }
};

struct KnownMaterial {
  std::string name;
  BrdfPtr brdf;
};
inline std::vector<KnownMaterial> known_materials() {
  return {
      {"matt white", make_brdf(LambertParameters{Rgb(0.85, 0.84, 0.80)})},
      {"matt dark", make_brdf(LambertParameters{Rgb(0.05, 0.04, 0.06)})},
      {"satin", make_brdf(GgxParameters{Rgb(0.3, 0.2, 0.1), Rgb::Constant(0.04), 0.3})},
      {"gloss", make_brdf(GgxParameters{Rgb(0.1, 0.3, 0.4), Rgb::Constant(0.05), 0.12})},
      {"metal", make_brdf(GgxParameters{Rgb::Constant(0.02), Rgb(0.7, 0.55, 0.35), 0.25})},
  };
}

struct KnownPose {
  std::string name;
  ScenePose pose;
};
inline std::vector<KnownPose> known_poses() {
  ScenePose raised, tilted;
  raised.height_mm = 2;
  tilted.tilt_deg = {0.5, -0.5};
  return {{"flat", {}}, {"+2 mm", raised}, {"0.5 deg", tilted}};
}

/// |measured / true - 1| of one light: of single cells of one capture, of the same averaged over
/// all repeats, and of blocks of 8 x 8 cells of one capture.
struct Accuracy {
  struct Errors {
    double median = 0, p95 = 0;
    std::size_t count = 0;
  };
  Errors one, averaged, blocks;
  double masked = 0;  ///< share of the inspected cells that one capture masks
  /// RMS over cells of the observed deviation over the predicted one, part's and white's noise
  /// both drawn anew for every repeat; 0 with fewer than two repeats.
  double sigma_ratio = 0;
};

inline Accuracy::Errors summary(std::vector<double> errors) {
  if (errors.empty()) return {};
  std::sort(errors.begin(), errors.end());
  return {errors[errors.size() / 2], errors[errors.size() * 95 / 100], errors.size()};
}

/// True f of every cell under every light, NaN outside of 80 x 80 mm of the part.
inline std::vector<cv::Mat> true_reflectance(const SimBenchSettings& s, const Brdf& brdf,
                                             const ScenePose& pose) {
  const Eigen::Isometry3d X_PW = part_pose(pose).inverse();
  const Eigen::Vector3d eye = X_PW * s.geometry.camera.position();
  const cv::Size size = s.sensor.cells();
  std::vector<cv::Mat> out;
  for (const Eigen::Vector3d& light_W : s.geometry.lights_W) {
    const Eigen::Vector3d light = X_PW * light_W;
    cv::Mat f(size, CV_32FC3, cv::Scalar::all(std::nan("")));
    for (int v = 0; v < size.height; ++v) {
      for (int u = 0; u < size.width; ++u) {
        const Eigen::Vector3d ray =
            X_PW.linear() * s.geometry.camera.ray_W(cell_centre_px(s.sensor, u, v));
        const Eigen::Vector3d p = eye - eye.z() / ray.z() * ray;
        if (std::abs(p.x()) >= 0.04 || std::abs(p.y()) >= 0.04) continue;
        const Rgb truth =
            brdf.eval(to_half_diff({(light - p).normalized(), (eye - p).normalized()}));
        f.at<cv::Vec3f>(v, u) = {static_cast<float>(truth[0]), static_cast<float>(truth[1]),
                                 static_cast<float>(truth[2])};
      }
    }
    out.push_back(f);
  }
  return out;
}

/// Compares repeats with the truth as they come.
class AccuracyCheck {
 public:
  explicit AccuracyCheck(cv::Mat truth)
      : truth_(std::move(truth)),
        good_(truth_.size(), CV_8UC1, cv::Scalar(255)),
        sum_(cv::Mat::zeros(truth_.size(), CV_64FC3)),
        repeat_sum_(sum_.clone()),
        square_(sum_.clone()),
        predicted_(sum_.clone()) {}

  /// @param f           with the station's own white reference
  /// @param with_fresh  the same capture with a white reference of its own, for the scatter
  void add(const Reflectance& f, const Reflectance& with_fresh) {
    if (repeats_++ == 0) first_ = f;
    good_ &= f.mask == 0;
    good_ &= with_fresh.mask == 0;
    cv::Mat value, fresh, variance;
    f.value.convertTo(value, CV_64F);
    with_fresh.value.convertTo(fresh, CV_64F);
    with_fresh.variance.convertTo(variance, CV_64F);
    sum_ += value;
    repeat_sum_ += fresh;
    square_ += fresh.mul(fresh);
    predicted_ += variance;
  }

  Accuracy result() const {
    Accuracy a;
    a.one = errors(first_.value, first_.mask == 0);
    cv::Mat mean;
    cv::Mat(sum_ / repeats_).convertTo(mean, CV_32F);
    a.averaged = errors(mean, good_);
    a.blocks = block_errors();
    const cv::Mat inside = inspected();
    a.masked = cv::countNonZero(inside & (first_.mask != 0)) /
               static_cast<double>(std::max(1, cv::countNonZero(inside)));
    if (repeats_ > 1) a.sigma_ratio = scatter();
    return a;
  }

 private:
  cv::Mat inspected() const {
    cv::Mat inside(truth_.size(), CV_8UC1);
    for (int v = 0; v < truth_.rows; ++v) {
      for (int u = 0; u < truth_.cols; ++u)
        inside.at<unsigned char>(v, u) = std::isnan(truth_.at<cv::Vec3f>(v, u)[0]) ? 0 : 255;
    }
    return inside;
  }

  Accuracy::Errors errors(const cv::Mat& f, const cv::Mat& good) const {
    std::vector<double> out;
    for (int v = 0; v < f.rows; ++v) {
      for (int u = 0; u < f.cols; ++u) {
        if (good.at<unsigned char>(v, u) == 0 || std::isnan(truth_.at<cv::Vec3f>(v, u)[0]))
          continue;
        for (int c = 0; c < 3; ++c)
          out.push_back(std::abs(f.at<cv::Vec3f>(v, u)[c] / truth_.at<cv::Vec3f>(v, u)[c] - 1));
      }
    }
    return summary(std::move(out));
  }

  Accuracy::Errors block_errors() const {
    std::vector<double> out;
    for (int v = 0; v + 8 <= truth_.rows; v += 8) {
      for (int u = 0; u + 8 <= truth_.cols; u += 8) {
        const cv::Rect block(u, v, 8, 8);
        const cv::Scalar truth = cv::mean(truth_(block));
        if (std::isnan(truth[0]) || cv::countNonZero(first_.mask(block)) != 0) continue;
        const cv::Scalar seen = cv::mean(first_.value(block));
        for (int c = 0; c < 3; ++c)
          out.push_back(std::abs(seen[c] / truth[c] - 1));
      }
    }
    return summary(std::move(out));
  }

  double scatter() const {
    double sum = 0;
    double count = 0;
    for (int v = 0; v < truth_.rows; ++v) {
      for (int u = 0; u < truth_.cols; ++u) {
        if (good_.at<unsigned char>(v, u) == 0 || std::isnan(truth_.at<cv::Vec3f>(v, u)[0]))
          continue;
        for (int c = 0; c < 3; ++c) {
          const double mean = repeat_sum_.at<cv::Vec3d>(v, u)[c] / repeats_;
          const double observed =
              (square_.at<cv::Vec3d>(v, u)[c] - repeats_ * mean * mean) / (repeats_ - 1);
          sum += observed / (predicted_.at<cv::Vec3d>(v, u)[c] / repeats_);
          count += 1;
        }
      }
    }
    return count > 0 ? std::sqrt(sum / count) : 0;
  }

  cv::Mat truth_, good_, sum_, repeat_sum_, square_, predicted_;
  Reflectance first_;
  int repeats_ = 0;
};

/// One exposure after another of what is in place: fresh noise, no new rendering.
inline Capture capture_again(SimStation& station) {
  Capture capture{station.camera().format(), {}};
  for (LightIndex light = 0; light <= station.lights().count(); ++light) {
    if (light == kNoLight) {
      station.lights().all_off();
    } else {
      station.lights().on(light);
    }
    for (const double t : bracket_s()) {
      station.camera().arm({{.exposure_s = t}});
      capture.frames.push_back(station.camera().next_frame(std::chrono::seconds(10)));
      capture.frames.back().light = light;
    }
  }
  station.lights().all_off();
  return capture;
}

/// Repeats of one white reference: what the station would have if it were calibrated anew each
/// time, from `whites` recordings.
inline std::vector<std::vector<Radiance>> fresh_whites(CalibratedBench& bench, int repeats,
                                                       int whites) {
  bench.station.place(target_scene(SceneTarget::white), 77, 0);
  std::vector<std::vector<Radiance>> out;
  for (int k = 0; k < repeats; ++k) {
    std::vector<Radiance> mean;
    for (int i = 0; i < whites; ++i) {
      Capture capture = capture_again(bench.station);
      capture.sensor = bench.calibration.sensor;
      const RadianceSet set = to_radiance(capture, bench.calibration.noise, 2);
      for (std::size_t l = 0; l < set.lights.size(); ++l) {
        if (i == 0) {
          mean.push_back(set.lights[l]);
          continue;
        }
        mean[l].value += set.lights[l].value;
        mean[l].variance += set.lights[l].variance;
        mean[l].mask |= set.lights[l].mask;
      }
    }
    for (Radiance& white : mean) {
      white.value /= whites;
      white.variance /= whites * whites;
    }
    out.push_back(std::move(mean));
  }
  return out;
}

/// Per light. The plane is handed over: it is known. `whites` as many as there are to be repeats.
inline std::vector<Accuracy> accuracy_of(CalibratedBench& bench, const BrdfPtr& brdf,
                                         const ScenePose& pose,
                                         const std::vector<std::vector<Radiance>>& whites) {
  Scene scene = target_scene(SceneTarget::part);
  scene.part_size_mm = {200, 200};
  scene.materials = {{"body", brdf}};
  scene.pose = pose;
  bench.station.place(scene, 6, 0);
  constexpr double kDeg = std::numbers::pi / 180;
  const PartPlane plane{pose.height_mm / 1e3, {pose.tilt_deg[0] * kDeg, pose.tilt_deg[1] * kDeg}};
  std::vector<AccuracyCheck> checks;
  for (cv::Mat& truth : true_reflectance(bench.settings, *brdf, pose))
    checks.emplace_back(truth);
  Calibration fresh = bench.calibration;
  for (const std::vector<Radiance>& white : whites) {
    Capture capture = capture_again(bench.station);
    capture.sensor = bench.calibration.sensor;
    const RadianceSet set = to_radiance(capture, bench.calibration.noise, 2);
    fresh.white = white;
    const auto f = to_reflectance(set, bench.calibration, plane);
    const auto again = to_reflectance(set, fresh, plane);
    for (std::size_t l = 0; l < checks.size(); ++l)
      checks[l].add(f[l], again[l]);
  }
  std::vector<Accuracy> out;
  for (const AccuracyCheck& check : checks)
    out.push_back(check.result());
  return out;
}

}  // namespace brdfgate::test
