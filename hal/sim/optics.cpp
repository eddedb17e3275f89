#include "hal/sim/optics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace brdfgate {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using std::numbers::pi;

/// Disc rule of degree five (Stroud 1971, S2: 5-1): the centre with weight 1/4, six points at
/// sqrt(2/3) of the radius with 1/8 each.
constexpr int kRing = 6;
constexpr double kCentreWeight = 0.25;
constexpr double kRingWeight = 0.125;
/// The disc's extent matters below this many of its angular radii in theta_h; beyond, a power law
/// of the fourth order in theta_h differs from its mean over the disc by under 0.3 %.
constexpr double kDiscReach = 30;

/// One flat thing in its own frame F, with camera and emitter brought into that frame.
struct PlaneView {
  Eigen::Isometry3d X_FW;
  Vector3d eye;                             ///< camera's centre
  Vector3d axis;                            ///< the emitter's normal
  std::array<Vector3d, 1 + kRing> emitter;  ///< centre, then ring
};

std::array<Vector3d, 1 + kRing> disc_points(const Vector3d& centre_W, const Vector3d& axis,
                                            double radius) {
  const Vector3d u = axis.unitOrthogonal();
  const Vector3d v = axis.cross(u);
  std::array<Vector3d, 1 + kRing> points;
  points[0] = centre_W;
  for (int i = 0; i < kRing; ++i) {
    const double angle = 2 * pi * i / kRing;
    points[1 + static_cast<std::size_t>(i)] =
        centre_W + radius * std::sqrt(2.0 / 3) * (std::cos(angle) * u + std::sin(angle) * v);
  }
  return points;
}

/// One light of the bench.
struct Emitter {
  Vector3d centre_W;
  Vector3d axis_W;  ///< the disc's normal
};

Emitter emitter_of(const SimBenchSettings& settings, std::size_t light) {
  const Vector3d centre = settings.geometry.lights_W[light];
  if (light >= settings.aim_W.size()) return {centre, -centre.normalized()};
  return {centre, (settings.aim_W[light] - centre).normalized()};
}

PlaneView view_of(const Eigen::Isometry3d& X_WF, const SimBenchSettings& settings,
                  const Emitter& light) {
  PlaneView view;
  view.X_FW = X_WF.inverse();
  view.eye = view.X_FW * settings.geometry.camera.position();
  view.axis = view.X_FW.linear() * light.axis_W;
  view.emitter = disc_points(light.centre_W, light.axis_W, settings.led_radius_m);
  for (Vector3d& p : view.emitter)
    p = view.X_FW * p;
  return view;
}

/// Where a ray from the eye meets the plane z = 0 of the view's frame, seen from above.
bool meet_plane(const PlaneView& view, const Vector3d& ray_W, Vector3d& p_F) {
  const Vector3d ray = view.X_FW.linear() * ray_W;
  if (view.eye.z() <= 0 || ray.z() >= 0) return false;
  p_F = view.eye - ray * (view.eye.z() / ray.z());
  p_F.z() = 0;
  return true;
}

/// Light arriving from one point of the emitter.
struct Arrival {
  Vector3d wi;
  double geometry = 0;  ///< cos_e cos_i / d^2, 1/m^2; 0 from behind either surface
};

Arrival arrival(const PlaneView& view, const Vector3d& emitter, const Vector3d& p) {
  const Vector3d to = emitter - p;
  const double d2 = to.squaredNorm();
  Arrival a;
  a.wi = to / std::sqrt(d2);
  a.geometry = std::max(0.0, a.wi.z()) * std::max(0.0, -a.wi.dot(view.axis)) / d2;
  return a;
}

/// Mean over the emitter of f times geometry at one point.
Rgb reflected(const PartSurface& part, const PlaneView& view, const Vector3d& p, double reach) {
  const Vector3d wo = (view.eye - p).normalized();
  const double slope = part.flat() ? 0 : part.slope(p.head<2>());
  const auto from = [&](const Arrival& a, const HalfDiff& angles) -> Rgb {
    Rgb flat = a.geometry * part.f(p.head<2>(), angles);
    if (slope == 0) return flat;
    // The normal is (-slope, 0, 1): cos_i changes, and a Lambertian's f does not.
    const double cos_i = (a.wi.z() - slope * a.wi.x()) / std::hypot(1, slope);
    return flat * (std::max(0.0, cos_i) / a.wi.z());
  };
  const Arrival centre = arrival(view, view.emitter[0], p);
  if (centre.geometry <= 0) return Rgb::Zero();
  const HalfDiff angles = to_half_diff({.wi = centre.wi, .wo = wo});
  Rgb mean = from(centre, angles);
  if (angles.theta_h >= reach) return mean;
  mean *= kCentreWeight;
  for (std::size_t i = 1; i < view.emitter.size(); ++i) {
    const Arrival a = arrival(view, view.emitter[i], p);
    if (a.geometry <= 0) continue;
    mean += kRingWeight * from(a, to_half_diff({.wi = a.wi, .wo = wo}));
  }
  return mean;
}

/// Albedo of what lies around the part, at a point of the plane z = 0.
const Rgb& fixture_albedo(const SimBenchSettings& settings, const Vector3d& p_W) {
  if (!settings.patch) return settings.fixture_albedo;
  const MonitorPatch& patch = *settings.patch;
  const bool on_patch =
      ((p_W.head<2>() - patch.at_m).array().abs() <= patch.size_m.array() / 2).all();
  return on_patch ? patch.albedo : settings.fixture_albedo;
}

/// What the camera's channels make of a colour; no light is negative.
Rgb seen_by_camera(const SimBenchSettings& settings, const Rgb& linear_srgb) {
  return (settings.camera_rgb * linear_srgb.matrix()).array().max(0.0);
}

float pick(const Rgb& value, int channel) {
  return static_cast<float>(channel < 0 ? value.mean() : value[channel]);
}

/// 1 - vignetting (r / r_corner)^2 around the principal point.
class Vignetting {
 public:
  explicit Vignetting(const SimBenchSettings& s) : centre_(s.geometry.camera.centre_px) {
    const Vector2d last(s.sensor.width - 1, s.sensor.height - 1);
    const double corner2 = centre_.cwiseAbs().cwiseMax((last - centre_).cwiseAbs()).squaredNorm();
    per_px2_ = corner2 > 0 ? s.vignetting / corner2 : 0;
  }
  double operator()(const Vector2d& pixel) const {
    return std::max(0.0, 1 - per_px2_ * (pixel - centre_).squaredNorm());
  }

 private:
  Vector2d centre_;
  double per_px2_ = 0;
};

/// Calls shade(ray_W) for every pixel, picks its colour, scales by `gain` and the vignetting.
cv::Mat shade_sensor(const SimBenchSettings& settings, double gain,
                     const std::function<Rgb(const Vector3d&)>& shade) {
  const SensorFormat& sensor = settings.sensor;
  const Vignetting vignetting(settings);
  cv::Mat image(sensor.height, sensor.width, CV_32FC1);
  cv::parallel_for_(cv::Range(0, sensor.height), [&](const cv::Range& rows) {
    for (int r = rows.start; r < rows.end; ++r) {
      float* out = image.ptr<float>(r);
      for (int c = 0; c < sensor.width; ++c) {
        const Vector2d pixel(c, r);
        const Rgb value = gain * vignetting(pixel) * shade(settings.geometry.camera.ray_W(pixel));
        out[c] = pick(value, colour_channel(sensor.mosaic, r, c));
      }
    }
  });
  return image;
}

}  // namespace

int colour_channel(Mosaic mosaic, int row, int column) {
  static constexpr std::array<std::array<int, 4>, 5> kChannel{
      {{-1, -1, -1, -1}, {0, 1, 1, 2}, {2, 1, 1, 0}, {1, 0, 2, 1}, {1, 2, 0, 1}}};
  const auto cell = static_cast<std::size_t>(2 * (row % 2) + column % 2);
  return kChannel[static_cast<std::size_t>(mosaic)][cell];
}

cv::Mat SimOptics::render_light(const PartSurface& part, const Eigen::Isometry3d& X_WP,
                                LightIndex light) const {
  const Emitter emitter = emitter_of(settings_, static_cast<std::size_t>(light - 1));
  const PlaneView on_part = view_of(X_WP, settings_, emitter);
  const PlaneView on_fixture = view_of(Eigen::Isometry3d::Identity(), settings_, emitter);
  const double distance = emitter.centre_W.norm();
  const double reach = kDiscReach * settings_.led_radius_m / distance;
  // At the origin cos_i = z / d; cos_e = 1 where the light is aimed there.
  const double cos_e =
      settings_.aim_W.empty() ? 1 : emitter.axis_W.dot(-emitter.centre_W) / distance;
  const double centre_geometry = cos_e * emitter.centre_W.z() / std::pow(distance, 3);
  const double gain = white_rate_e_s() / (sim_target::kWhiteReflectance / pi * centre_geometry);
  return shade_sensor(settings_, gain, [&](const Vector3d& ray_W) -> Rgb {
    Vector3d p;
    if (meet_plane(on_part, ray_W, p) && part.covers(p.head<2>())) {
      return seen_by_camera(settings_, reflected(part, on_part, p, reach));
    }
    if (!meet_plane(on_fixture, ray_W, p)) return Rgb::Zero();
    return arrival(on_fixture, on_fixture.emitter[0], p).geometry * fixture_albedo(settings_, p) /
           pi;
  });
}

cv::Mat SimOptics::render_ambient(const PartSurface& part, const Eigen::Isometry3d& X_WP,
                                  double share) const {
  const Emitter any_light = emitter_of(settings_, 0);
  const PlaneView on_part = view_of(X_WP, settings_, any_light);
  const PlaneView on_fixture = view_of(Eigen::Isometry3d::Identity(), settings_, any_light);
  const double gain = share * white_rate_e_s() / sim_target::kWhiteReflectance;
  return shade_sensor(settings_, gain, [&](const Vector3d& ray_W) -> Rgb {
    Vector3d p;
    if (meet_plane(on_part, ray_W, p) && part.covers(p.head<2>())) {
      return seen_by_camera(settings_, part.ambient_reflectance(p.head<2>()));
    }
    if (!meet_plane(on_fixture, ray_W, p)) return Rgb::Zero();
    return fixture_albedo(settings_, p);
  });
}

void defocus(cv::Mat& image, Mosaic mosaic, double sigma_px) {
  if (sigma_px <= 0) return;
  const int step = mosaic == Mosaic::mono ? 1 : 2;
  const double sigma = sigma_px / step;
  for (int r0 = 0; r0 < step; ++r0) {
    for (int c0 = 0; c0 < step; ++c0) {
      cv::Mat plane((image.rows - r0 + step - 1) / step, (image.cols - c0 + step - 1) / step,
                    CV_32FC1);
      for (int r = 0; r < plane.rows; ++r) {
        for (int c = 0; c < plane.cols; ++c) {
          plane.at<float>(r, c) = image.at<float>(r0 + step * r, c0 + step * c);
        }
      }
      cv::GaussianBlur(plane, plane, {}, sigma, sigma, cv::BORDER_REFLECT);
      for (int r = 0; r < plane.rows; ++r) {
        for (int c = 0; c < plane.cols; ++c) {
          image.at<float>(r0 + step * r, c0 + step * c) = plane.at<float>(r, c);
        }
      }
    }
  }
}

}  // namespace brdfgate
