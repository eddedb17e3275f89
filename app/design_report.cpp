#include "app/design_report.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace brdfgate {
namespace {

using nlohmann::json;

double degrees(double radians) {
  // Rounded to a micro-degree: 0.1 + 0.2 is nothing to print.
  constexpr double kDigits = 1e6;
  return std::round(radians * 180 / std::numbers::pi * kDigits) / kDigits + 0.0;
}

double azimuth_degrees(double radians) {
  return degrees(std::remainder(radians, 2 * std::numbers::pi));
}

struct StartShare {
  int near_best = 0;
  double median = 0;
};

/// How many starts came within 1 % of the best, and the median start.
StartShare share_of(std::vector<double> costs) {
  std::sort(costs.begin(), costs.end());
  const double best = costs.front();
  constexpr double kNear = 0.01;
  StartShare share;
  share.near_best = static_cast<int>(std::count_if(costs.begin(), costs.end(), [&](double cost) {
    return cost - best <= kNear * std::abs(best);
  }));
  share.median = costs[costs.size() / 2];
  return share;
}

json polar_json(const PolarDirection& at) {
  return {{"theta_deg", degrees(at.theta)}, {"phi_deg", azimuth_degrees(at.phi)}};
}

json placed_json(const PolarDirection& at, double distance) {
  json j = polar_json(at);
  if (distance > 0) {
    const Eigen::Vector3d p = 1e3 * distance * at.unit();
    j["distance_mm"] = 1e3 * distance;
    j["at_mm"] = {p.x(), p.y(), p.z()};
  }
  return j;
}

json angles_json(const HalfDiff& a) {
  return {{"theta_h_deg", degrees(a.theta_h)},
          {"theta_d_deg", degrees(a.theta_d)},
          {"phi_d_deg", degrees(a.phi_d)}};
}

}  // namespace

HalfDiff centre_of(const CameraLight& image) {
  return to_half_diff({image.light.unit(), image.camera.unit()});
}

json to_json(const DesignSummary& s) {
  json j{{"schema", "brdfgate.design/1"},
         {"kind", s.kind},
         {"basis", s.basis},
         {"components", s.components},
         {"eta", s.eta},
         {"beta", s.goal.beta},
         {"criterion", s.goal.criterion == DesignCriterion::error ? "error" : "condition"},
         {"rows", s.score.rows},
         {"condition_number", s.score.condition},  // infinity becomes null
         {"row_norm", s.score.row_norm},
         {"expected_error", s.score.error.total(s.goal.beta)},
         {"reconstruction_error", s.score.error.reconstruction},
         {"noise_gain", s.score.error.noise_gain},
         {"unmeasured_error", s.unmeasured}};
  if (!s.costs.empty()) {
    const StartShare share = share_of(s.costs);
    j["search"] = {{"seed", s.seed},
                   {"starts", s.costs.size()},
                   {"within_1_percent", share.near_best},
                   {"median_cost", share.median}};
  }
  return j;
}

void print(const DesignSummary& s) {
  const ExpectedError& e = s.score.error;
  fmt::print("\nrows              {}\n", s.score.rows);
  fmt::print("condition number  {:.5g}\n", s.score.condition);
  fmt::print("row norm          {:.4g}\n", s.score.row_norm);
  fmt::print("expected error    {:.4f} mapped RMS ({:.4f} + {:g} * {:.4f}); unmeasured {:.4f}\n",
             e.total(s.goal.beta), e.reconstruction, s.goal.beta, e.noise_gain, s.unmeasured);
  if (!s.costs.empty()) {
    const StartShare share = share_of(s.costs);
    fmt::print("search            {} of {} starts within 1 % of the best, median {:.5g}\n",
               share.near_best, s.costs.size(), share.median);
  }
}

json to_json(const std::vector<HalfDiff>& points) {
  json list = json::array();
  for (const HalfDiff& at : points) {
    const DirectionPair pair = to_directions(at);
    const PolarDirection light = to_polar(pair.wi);
    const PolarDirection camera = to_polar(pair.wo);
    json j = angles_json(at);
    j["light_theta_deg"] = degrees(light.theta);
    j["camera_theta_deg"] = degrees(camera.theta);
    j["between_azimuths_deg"] = std::abs(azimuth_degrees(camera.phi - light.phi));
    list.push_back(j);
  }
  return list;
}

void print(const std::vector<HalfDiff>& points) {
  fmt::print("  n  theta_h  theta_d    phi_d | light  camera  between their azimuths (deg)\n");
  int n = 0;
  for (const json& p : to_json(points)) {
    fmt::print("{:3}  {:7.1f}  {:7.1f}  {:7.1f} | {:5.1f}  {:6.1f}  {:7.1f}\n", ++n,
               p["theta_h_deg"].get<double>(), p["theta_d_deg"].get<double>(),
               p["phi_d_deg"].get<double>(), p["light_theta_deg"].get<double>(),
               p["camera_theta_deg"].get<double>(), p["between_azimuths_deg"].get<double>());
  }
}

json to_json(const std::vector<CameraLight>& images, const NearField& view) {
  json list = json::array();
  for (const CameraLight& image : images) {
    json j = angles_json(centre_of(image));
    j["camera"] = placed_json(image.camera, view.distance);
    j["light"] = placed_json(image.light, view.light_distance);
    list.push_back(j);
  }
  return list;
}

void print(const std::vector<CameraLight>& images, const NearField& view) {
  fmt::print(
      "image  camera theta  light theta    phi   | theta_h  theta_d  phi_d at the centre (deg)\n");
  int n = 0;
  for (const CameraLight& image : images) {
    const HalfDiff c = centre_of(image);
    fmt::print("{:5}  {:12.1f}  {:11.1f}  {:6.1f}  | {:7.1f}  {:7.1f}  {:5.1f}\n", ++n,
               degrees(image.camera.theta), degrees(image.light.theta),
               azimuth_degrees(image.light.phi), degrees(c.theta_h), degrees(c.theta_d),
               degrees(c.phi_d));
  }
  fmt::print("camera {:.0f} mm from the centre, field of view {:.1f} deg, {}\n",
             1e3 * view.distance, degrees(view.fov),
             view.light_distance > 0
                 ? fmt::format("lights {:.0f} mm from the centre", 1e3 * view.light_distance)
                 : "directional lights");
}

json to_json(const GoniometerPath& path) {
  json stops = json::array();
  for (const PathStop& s : path.stops) {
    json j{{"camera_theta_deg", degrees(s.theta)},
           {"camera_phi_deg", azimuth_degrees(s.phi)},
           {"at_mm", {1e3 * s.p_R.x(), 1e3 * s.p_R.y(), 1e3 * s.p_R.z()}},
           {"pitch_deg", degrees(s.pitch)},
           {"yaw_deg", azimuth_degrees(s.yaw)},
           {"quaternion_wxyz", {s.q_R.w(), s.q_R.x(), s.q_R.y(), s.q_R.z()}}};
    if (s.direction >= 0) {
      j["direction"] = s.direction + 1;
      j["lamp"] = s.lamp;
      j["measured"] = angles_json(s.angles);
    }
    stops.push_back(j);
  }
  json missed = json::array();
  for (const auto& m : path.missed)
    missed.push_back({{"direction", m.direction + 1}, {"reason", m.reason}});
  return {{"schema", "brdfgate.design/1"},
          {"kind", "path"},
          {"length_deg", degrees(path.length)},
          {"stops", stops},
          {"missed", missed}};
}

std::string path_csv(const GoniometerPath& path) {
  std::string csv =
      "stop,direction,lamp,theta_h_deg,theta_d_deg,phi_d_deg,camera_theta_deg,camera_phi_deg,x_mm,"
      "y_mm,z_mm,pitch_deg,yaw_deg,qw,qx,qy,qz\n";
  int n = 0;
  for (const PathStop& s : path.stops) {
    const std::string measured =
        s.direction < 0 ? ",,,,"
                        : fmt::format("{},{},{:.3f},{:.3f},{:.3f}", s.direction + 1, s.lamp,
                                      degrees(s.angles.theta_h), degrees(s.angles.theta_d),
                                      degrees(s.angles.phi_d));
    csv += fmt::format(
        "{},{},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},{:.6f},{:.6f},{:.6f},{:.6f}\n", ++n,
        measured, degrees(s.theta), azimuth_degrees(s.phi), 1e3 * s.p_R.x(), 1e3 * s.p_R.y(),
        1e3 * s.p_R.z(), degrees(s.pitch), azimuth_degrees(s.yaw), s.q_R.w(), s.q_R.x(), s.q_R.y(),
        s.q_R.z());
  }
  return csv;
}

void print(const GoniometerPath& path) {
  fmt::print(
      "stop  direction  lamp  camera theta    phi |     x       y       z mm  pitch    yaw | "
      "theta_h theta_d phi_d measured\n");
  int n = 0;
  for (const PathStop& s : path.stops) {
    const bool measures = s.direction >= 0;
    fmt::print("{:4}  {:>9}  {:>4}  {:12.1f} {:6.1f} | {:7.1f} {:7.1f} {:7.1f}  {:6.1f} {:6.1f}",
               ++n, measures ? std::to_string(s.direction + 1) : "on the way",
               measures ? std::to_string(s.lamp) : "", degrees(s.theta), azimuth_degrees(s.phi),
               1e3 * s.p_R.x(), 1e3 * s.p_R.y(), 1e3 * s.p_R.z(), degrees(s.pitch),
               azimuth_degrees(s.yaw));
    if (measures) {
      fmt::print(" | {:7.1f} {:7.1f} {:5.1f}", degrees(s.angles.theta_h), degrees(s.angles.theta_d),
                 degrees(s.angles.phi_d));
    }
    fmt::print("\n");
  }
  fmt::print("the camera's way from the zenith: {:.0f} deg on its sphere\n", degrees(path.length));
  for (const auto& m : path.missed)
    fmt::print("direction {} is not measured: {}\n", m.direction + 1, m.reason);
}

}  // namespace brdfgate
