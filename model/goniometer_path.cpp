#include "model/goniometer_path.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "model/error.hpp"

namespace brdfgate {
namespace {

using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;
constexpr double kRounding = 1e-9;

Vector3d unit(double theta, double phi) {
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

double polar_angle(const Vector3d& v) {
  return std::atan2(std::hypot(v.x(), v.y()), v.z());
}

double angle_between(const Vector3d& a, const Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

void check(const char* what, double value, double least, double most, const char* unit_name) {
  if (!(value >= least && value <= most)) {
    const double scale = std::string(unit_name) == "deg" ? 1 / kDegree : 1e3;
    throw InputError(what, std::to_string(value * scale) + " " + unit_name,
                     std::to_string(least * scale) + " to " + std::to_string(most * scale));
  }
}

void check(const Goniometer& g) {
  constexpr double kMillimetre = 1e-3;
  check("camera radius", g.camera_radius, kMillimetre, 10, "mm");
  check("lamp step", g.lamp_step, 0.1 * kDegree, 45 * kDegree, "deg");
  check("max theta", g.max_theta, kDegree, 89 * kDegree, "deg");
  check("clearance", g.clearance, 0, 90 * kDegree, "deg");
  check("longest move", g.longest_move, kDegree, kPi, "deg");
  if (!(g.centre.allFinite() && std::isfinite(g.arc_azimuth))) {
    throw InputError("goniometer", "centre or arc azimuth is not finite");
  }
}

/// A way to measure a direction: which lamp, where the camera, what it really measures.
struct Setting {
  int lamp = 0;
  Vector3d camera;  ///< unit vector, lamps' azimuth 0
  HalfDiff angles;
  double deviation = 0;  ///< of the difference direction from the one asked for
  std::string trouble;   ///< empty: possible
};

/// The pair with its first direction at the nearest lamp, turned about the normal so that the half
/// vector keeps its angle to it: the camera is the lamp mirrored at the half vector.
Setting setting_for(const Goniometer& g, const Vector3d& to_lamp, const Vector3d& to_camera) {
  Setting s;
  s.lamp = static_cast<int>(std::lround(polar_angle(to_lamp) / g.lamp_step));
  while (s.lamp * g.lamp_step > g.max_theta + kRounding)
    --s.lamp;
  const Vector3d lamp = unit(s.lamp * g.lamp_step, std::atan2(to_lamp.y(), to_lamp.x()));
  const Vector3d half = (to_lamp + to_camera).normalized();
  const Vector3d camera = 2 * half.dot(lamp) * half - lamp;
  s.angles = to_half_diff({lamp, camera});
  s.deviation = angle_between(lamp, to_lamp);
  if (polar_angle(camera) > g.max_theta + kRounding) {
    s.trouble = "the camera would stand " + std::to_string(polar_angle(camera) / kDegree) +
                " deg from the normal";
  } else if (angle_between(camera, lamp) < g.clearance - kRounding) {
    s.trouble = "the camera would stand in the lamp's light";
  }
  // The lamp on its arc at azimuth 0; the camera on the arc's positive side.
  const double turn = std::atan2(lamp.y(), lamp.x());
  s.camera = Eigen::AngleAxisd(-turn, Vector3d::UnitZ()) * camera;
  s.camera.y() = std::abs(s.camera.y());
  return s;
}

Setting best_setting(const Goniometer& g, const HalfDiff& direction) {
  const DirectionPair pair = to_directions(direction);
  const Setting one = setting_for(g, pair.wi, pair.wo);
  const Setting other = setting_for(g, pair.wo, pair.wi);
  if (one.trouble.empty() != other.trouble.empty()) return one.trouble.empty() ? one : other;
  return other.deviation < one.deviation ? other : one;
}

/// Order of points on the sphere: always the nearest next, from the zenith on.
std::vector<int> nearest_order(const std::vector<Vector3d>& at) {
  const int n = static_cast<int>(at.size());
  std::vector<int> order;
  std::vector<bool> visited(at.size(), false);
  Vector3d here = Vector3d::UnitZ();
  while (static_cast<int>(order.size()) < n) {
    int nearest = -1;
    for (int i = 0; i < n; ++i) {
      if (visited[i]) continue;
      if (nearest < 0 || angle_between(here, at[i]) < angle_between(here, at[nearest])) nearest = i;
    }
    visited[nearest] = true;
    order.push_back(nearest);
    here = at[nearest];
  }
  return order;
}

/// The nearest order, shortened by 2-opt on the open way.
std::vector<int> short_order(const std::vector<Vector3d>& at) {
  const int n = static_cast<int>(at.size());
  std::vector<int> order = nearest_order(at);
  const auto point = [&](int i) { return i < 0 ? Vector3d(Vector3d::UnitZ()) : at[order[i]]; };
  for (bool gained = true; gained;) {
    gained = false;
    for (int i = 0; i < n; ++i) {
      for (int j = i + 1; j < n; ++j) {
        double change =
            angle_between(point(i - 1), point(j)) - angle_between(point(i - 1), point(i));
        if (j + 1 < n) {
          change += angle_between(point(i), point(j + 1)) - angle_between(point(j), point(j + 1));
        }
        if (change >= -kRounding) continue;
        std::reverse(order.begin() + i, order.begin() + j + 1);
        gained = true;
      }
    }
  }
  return order;
}

PathStop stop_at(const Goniometer& g, const Vector3d& camera) {
  const double phi = std::atan2(camera.y(), camera.x());
  return camera_stop(g, polar_angle(camera), g.arc_azimuth + phi);
}

/// Stops between two directions so that no move is longer than allowed; returns the angle between.
double add_moves(const Goniometer& g, const Vector3d& from, const Vector3d& to,
                 std::vector<PathStop>& stops) {
  const double angle = angle_between(from, to);
  const int parts = static_cast<int>(std::ceil(angle / g.longest_move - kRounding));
  for (int i = 1; i < parts; ++i) {
    const double share = static_cast<double>(i) / parts;
    stops.push_back(stop_at(
        g, (std::sin((1 - share) * angle) * from + std::sin(share * angle) * to).normalized()));
  }
  return angle;
}

}  // namespace

PathStop camera_stop(const Goniometer& goniometer, double theta, double phi) {
  PathStop stop;
  stop.theta = theta;
  stop.phi = phi;
  stop.p_R = goniometer.centre + goniometer.camera_radius * unit(theta, phi);
  stop.pitch = kPi / 2 + theta;
  stop.yaw = phi;
  stop.q_R = Eigen::AngleAxisd(stop.yaw, Vector3d::UnitZ()) *
             Eigen::AngleAxisd(stop.pitch, Vector3d::UnitY());
  return stop;
}

GoniometerPath plan_path(const Goniometer& goniometer, const std::vector<HalfDiff>& directions) {
  check(goniometer);
  if (directions.empty()) throw InputError("directions", "none given", "at least 1");
  GoniometerPath path;
  std::vector<int> number;
  std::vector<Setting> settings;
  std::vector<Vector3d> cameras;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    if (!cosines(directions[i]).above_horizon()) {
      throw InputError("direction " + std::to_string(i + 1), "lies below the horizon",
                       "lamp and camera above the sample");
    }
    const Setting setting = best_setting(goniometer, directions[i]);
    if (!setting.trouble.empty()) {
      path.missed.push_back({static_cast<int>(i), setting.trouble});
      continue;
    }
    number.push_back(static_cast<int>(i));
    settings.push_back(setting);
    cameras.push_back(setting.camera);
  }
  if (settings.empty()) {
    throw InputError("path", "none of the directions can be measured: " + path.missed[0].reason,
                     "directions within the goniometer's limits");
  }
  Vector3d here = Vector3d::UnitZ();
  for (const int i : short_order(cameras)) {
    path.length += add_moves(goniometer, here, cameras[i], path.stops);
    PathStop stop = stop_at(goniometer, cameras[i]);
    stop.direction = number[i];
    stop.lamp = settings[i].lamp;
    stop.angles = settings[i].angles;
    path.stops.push_back(stop);
    here = cameras[i];
  }
  return path;
}

}  // namespace brdfgate
