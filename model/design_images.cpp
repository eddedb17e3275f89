#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string>

#include "model/design_cost.hpp"
#include "model/design_layouts.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

using namespace design_detail;
using Eigen::Vector3d;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kDegree = std::numbers::pi / 180;

double angle_between(const Vector3d& a, const Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

/// Camera and light high enough and far enough from each other.
bool within(const DesignLimits& limits, const CameraLight& image) {
  constexpr double kRounding = 1e-9;
  return image.camera.theta <= limits.max_theta + kRounding &&
         image.light.theta <= limits.max_theta + kRounding &&
         angle_between(image.camera.unit(), image.light.unit()) >= limits.clearance - kRounding;
}

/// Figure of several images, keeping what each told.
class ImageCost {
 public:
  ImageCost(const DesignBasis& basis, const NearField& view, const DesignGoal& goal)
      : basis_(basis), view_(view), goal_(goal) {}

  /// @param keys  one per image, what it is known by
  double operator()(const std::vector<CameraLight>& images,
                    const std::vector<std::vector<int>>& keys) {
    cache_.make_room();
    Information all = Information::none(basis_.components());
    for (std::size_t i = 0; i < images.size(); ++i) {
      const Information& seen = cache_.get(keys[i], [&] {
        return Information::of(design_rows(basis_, seen_directions(view_, images[i])));
      });
      if (seen.rows == 0) return kInfinity;
      all += seen;
    }
    return cost_of(basis_, all, goal_);
  }

 private:
  const DesignBasis& basis_;
  NearField view_;
  DesignGoal goal_;
  SiteCache<Information> cache_;
};

/// Camera toward +x, light where these angles of the centre put it. phi_d from the full circle:
/// beyond pi camera and light have changed places.
CameraLight image_at(const HalfDiff& centre) {
  const DirectionPair pair = to_directions(centre);
  CameraLight image{to_polar(pair.wo), to_polar(pair.wi)};
  image.light.phi = std::remainder(image.light.phi - image.camera.phi, 2 * std::numbers::pi);
  image.camera.phi = 0;
  return image;
}

HalfDiff free_centre(const std::vector<int>& place, std::size_t first) {
  return kMerlGrid.centre(place[first], place[first + 1], place[first + 2]);
}

void check_direction(const std::string& what, const PolarDirection& direction) {
  if (!(std::abs(direction.theta) < std::numbers::pi / 2 && std::isfinite(direction.phi))) {
    throw InputError(what,
                     "stands " + std::to_string(direction.theta / kDegree) +
                         " deg from the normal, not above the sample",
                     "under 90 deg");
  }
}

}  // namespace

Vector3d PolarDirection::unit() const {
  return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
}

PolarDirection to_polar(const Vector3d& direction) {
  return {std::atan2(std::hypot(direction.x(), direction.y()), direction.z()),
          std::atan2(direction.y(), direction.x())};
}

double NearField::disc_radius() const {
  return distance * std::tan(fov / 2);
}

void check(const NearField& view) {
  if (!(view.distance > 0 && std::isfinite(view.distance))) {
    throw InputError("camera distance", std::to_string(view.distance * 1e3) + " mm", "over 0");
  }
  if (!(view.fov > 0 && view.fov < std::numbers::pi)) {
    throw InputError("field of view", std::to_string(view.fov / kDegree) + " deg",
                     "between 0 and 180");
  }
  if (view.samples < 1) {
    throw InputError("samples", std::to_string(view.samples), "at least 1 across the disc");
  }
  const bool placed = view.light_distance > view.disc_radius();
  if (!(view.light_distance == 0 || (placed && std::isfinite(view.light_distance)))) {
    throw InputError("light distance", std::to_string(view.light_distance * 1e3) + " mm",
                     "0 for a directional light, or more than the disc's radius of " +
                         std::to_string(view.disc_radius() * 1e3) + " mm");
  }
}

std::vector<HalfDiff> seen_directions(const NearField& view, const CameraLight& image) {
  const Vector3d camera = view.distance * image.camera.unit();
  const Vector3d to_light = image.light.unit();
  const double radius = view.disc_radius();
  std::vector<HalfDiff> seen;
  const auto offset = [&](int i) {
    return view.samples > 1 ? radius * (2.0 * i / (view.samples - 1) - 1) : 0.0;
  };
  for (int v = 0; v < view.samples; ++v) {
    for (int u = 0; u < view.samples; ++u) {
      const Vector3d p(offset(u), offset(v), 0);
      constexpr double kEdge = 1 + 1e-9;  // points on the disc's edge count
      if (p.norm() > radius * kEdge) continue;
      const Vector3d wo = (camera - p).normalized();
      const Vector3d wi = view.light_distance > 0
                              ? Vector3d((view.light_distance * to_light - p).normalized())
                              : to_light;
      if (wi.z() > kLeastCosine && wo.z() > kLeastCosine) seen.push_back(to_half_diff({wi, wo}));
    }
  }
  return seen;
}

Found<std::vector<CameraLight>> design_free_camera(const DesignBasis& basis, const NearField& view,
                                                   int n, const DesignGoal& goal,
                                                   const DesignLimits& limits,
                                                   const SearchOptions& options) {
  check(view);
  check(goal);
  check(limits);
  SearchProblem problem;
  problem.name = "images";
  problem.site = {{kMerlGrid.theta_h}, {kMerlGrid.theta_d}, {2 * kMerlGrid.phi_d, true}};
  problem.sites = n;
  problem.make_cost = [&] {
    auto cost = std::make_shared<ImageCost>(basis, view, goal);
    return [&limits, cost](const std::vector<int>& place) {
      std::vector<CameraLight> images;
      std::vector<std::vector<int>> keys;
      for (std::size_t i = 0; i < place.size(); i += 3) {
        images.push_back(image_at(free_centre(place, i)));
        if (!within(limits, images.back())) return kInfinity;
        keys.push_back({place[i], place[i + 1], place[i + 2]});
      }
      return (*cost)(images, keys);
    };
  };
  const SearchResult found = search_design(problem, options);
  std::vector<CameraLight> images;
  for (std::size_t i = 0; i < found.place.size(); i += 3)
    images.push_back(image_at(free_centre(found.place, i)));
  return {images, found.costs};
}

namespace {

/// Whole degrees to a rig; the camera is the first coordinate unless it is given.
FixedRig rig_at(const std::vector<int>& place, const std::optional<double>& camera_theta) {
  FixedRig rig;
  std::size_t next = 0;
  rig.camera_theta = camera_theta ? *camera_theta : place[next++] * kDegree;
  for (; next < place.size(); next += 2)
    rig.lights.push_back({place[next] * kDegree, place[next + 1] * kDegree});
  return rig;
}

std::vector<std::vector<int>> keys_of(const std::vector<int>& place, bool camera_given) {
  std::vector<std::vector<int>> keys;
  for (std::size_t i = camera_given ? 0 : 1; i < place.size(); i += 2)
    keys.push_back({camera_given ? 0 : place[0], place[i], place[i + 1]});
  return keys;
}

}  // namespace

std::vector<CameraLight> images_of(const FixedRig& rig) {
  std::vector<CameraLight> images;
  images.reserve(rig.lights.size());
  for (const PolarDirection& light : rig.lights)
    images.push_back({{rig.camera_theta, 0}, light});
  return images;
}

Found<FixedRig> design_fixed_rig(const DesignBasis& basis, const NearField& view,
                                 const RigRequest& request, const DesignGoal& goal,
                                 const DesignLimits& limits, const SearchOptions& options) {
  check(view);
  check(goal);
  check(limits);
  const std::optional<double>& camera_theta = request.camera_theta;
  if (camera_theta) check_direction("camera", {*camera_theta, 0});
  const int thetas = static_cast<int>(limits.max_theta / kDegree + 1e-9) + 1;
  constexpr int kPhis = 181;  // the other side is its mirror image: the material is isotropic
  SearchProblem problem;
  problem.name = "lights";
  if (!camera_theta) problem.shared = {{thetas}};
  problem.site = {{thetas}, {kPhis}};
  problem.sites = request.lights;
  problem.make_cost = [&] {
    auto cost = std::make_shared<ImageCost>(basis, view, goal);
    return [&limits, &camera_theta, cost](const std::vector<int>& place) {
      const std::vector<CameraLight> images = images_of(rig_at(place, camera_theta));
      for (const CameraLight& image : images) {
        if (!within(limits, image)) return kInfinity;
      }
      return (*cost)(images, keys_of(place, camera_theta.has_value()));
    };
  };
  const SearchResult found = search_design(problem, options);
  return {rig_at(found.place, camera_theta), found.costs};
}

DesignScore score_images(const DesignBasis& basis, const NearField& view,
                         const std::vector<CameraLight>& images) {
  check(view);
  if (images.empty()) throw InputError("rig", "no light given", "at least 1");
  Information all = Information::none(basis.components());
  for (std::size_t i = 0; i < images.size(); ++i) {
    const std::string number = std::to_string(i + 1);
    check_direction("camera of image " + number, images[i].camera);
    check_direction("light of image " + number, images[i].light);
    const std::vector<HalfDiff> seen = seen_directions(view, images[i]);
    if (seen.empty()) {
      throw InputError("image " + number, "sees nothing of the sample",
                       "camera and light above the horizon of its disc");
    }
    all += Information::of(design_rows(basis, seen));
  }
  return score(basis, all);
}

}  // namespace brdfgate
