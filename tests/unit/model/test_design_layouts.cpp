#include <algorithm>
#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "model/design_layouts.hpp"
#include "model/grid_stencil.hpp"
#include "support/input_error.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;

namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr HalfDiffGrid kMerl{90, 90, 180};

const DesignBasis& basis() {
  static const DesignBasis made = make_design_basis(test::small_basis());
  return made;
}

SearchOptions few_starts(int starts = 4) {
  SearchOptions options;
  options.starts = starts;
  options.candidates = 40;
  return options;
}

const DesignLimits kLimits{85 * kDegree, 10 * kDegree};

NearField small_view() {
  NearField view;
  view.fov = 25 * kDegree;
  view.samples = 5;
  return view;
}

PolarDirection at_degrees(double theta, double phi) {
  return {theta * kDegree, phi * kDegree};
}

double angle_of(const CameraLight& image) {
  return std::acos(std::clamp(image.camera.unit().dot(image.light.unit()), -1.0, 1.0));
}

}  // namespace

TEST_CASE("A single point by the row's norm is the longest row of the MERL grid") {
  const DesignGoal goal{DesignCriterion::condition, 0};
  const auto found = design_points(basis(), 1, goal, kLimits, few_starts(12));
  REQUIRE(found.design.size() == 1);
  const double norm = design_rows(basis(), found.design).norm();
  std::vector<HalfDiff> every;  // every third cell along each angle
  for (int h = 0; h < 90; h += 3) {
    for (int d = 0; d < 90; d += 3) {
      for (int p = 0; p < 180; p += 3) {
        const HalfDiff at = kMerl.centre(h, d, p);
        if (cosines(at).above_horizon(std::cos(kLimits.max_theta))) every.push_back(at);
      }
    }
  }
  CHECK(norm >= design_rows(basis(), every).rowwise().norm().maxCoeff() * (1 - 1e-9));
}

TEST_CASE("Points of a search keep the limits, and beat random points") {
  for (const DesignCriterion criterion : {DesignCriterion::error, DesignCriterion::condition}) {
    const auto found = design_points(basis(), 3, {criterion, 0.1}, kLimits, few_starts());
    REQUIRE(found.design.size() == 3);
    for (const HalfDiff& at : found.design)
      CHECK(cosines(at).above_horizon(std::cos(kLimits.max_theta)));
    const DesignScore ours = score_points(basis(), found.design);
    const DesignScore random =
        score_points(basis(), {{0.3, 0.4, 1}, {0.5, 0.9, 2}, {0.1, 0.2, 0.3}});
    if (criterion == DesignCriterion::error) {
      CHECK(ours.error.total(0.1) < random.error.total(0.1));
      CHECK(ours.error.total(0.1) ==
            Approx(*std::min_element(found.costs.begin(), found.costs.end())));
    } else {
      CHECK(ours.condition < random.condition);
    }
  }
}

TEST_CASE("One sphere image found by the search is the best of all ninety") {
  const std::vector<Information> images = sphere_images(basis());
  REQUIRE(images.size() == 90);
  CHECK(images[0].rows > images[80].rows);  // light and camera apart: less of the sphere is both
  for (const DesignCriterion criterion : {DesignCriterion::error, DesignCriterion::condition}) {
    const auto figure = [&](int d) {
      const DesignScore s = score(basis(), images[static_cast<std::size_t>(d)]);
      return criterion == DesignCriterion::error ? s.error.total(0) : s.condition;
    };
    const int found = design_spheres(basis(), images, 1, {criterion, 0}, few_starts(8)).design[0];
    for (int d = 0; d < 90; ++d)
      CHECK(figure(found) <= figure(d) * (1 + 1e-9));
  }
}

TEST_CASE("A near-field image sees a disc of directions around its centre") {
  NearField view = small_view();
  view.samples = 15;
  const CameraLight image{at_degrees(55, 0), at_degrees(55, 180)};
  const std::vector<HalfDiff> seen = seen_directions(view, image);
  CHECK(seen.size() == 149);  // of 15 x 15 points in the disc; 298 directions under two lights
  const HalfDiff centre = to_half_diff({image.light.unit(), image.camera.unit()});
  const auto nearest = std::min_element(seen.begin(), seen.end(), [&](auto& a, auto& b) {
    return std::abs(a.theta_d - centre.theta_d) + a.theta_h <
           std::abs(b.theta_d - centre.theta_d) + b.theta_h;
  });
  CHECK(nearest->theta_h == Approx(0).margin(1e-9));
  CHECK(nearest->theta_d == Approx(55 * kDegree));
  // Under the normal a directional light and half the field of view: theta_h to a quarter of it.
  const std::vector<HalfDiff> above = seen_directions(view, {at_degrees(0, 0), at_degrees(0, 0)});
  double widest = 0;
  for (const HalfDiff& a : above)
    widest = std::max(widest, a.theta_h);
  CHECK(widest == Approx(25 * kDegree / 4).epsilon(1e-6));
}

TEST_CASE("A light placed far away is a directional light, a near one is not") {
  const CameraLight image{at_degrees(40, 0), at_degrees(30, 120)};
  NearField far = small_view();
  far.light_distance = 1e5;
  NearField near = small_view();
  near.light_distance = 0.3;
  const auto parallel = seen_directions(small_view(), image);
  const auto from_far = seen_directions(far, image);
  const auto from_near = seen_directions(near, image);
  double far_apart = 0;
  double near_apart = 0;
  for (std::size_t i = 0; i < parallel.size(); ++i) {
    far_apart = std::max(far_apart, std::abs(parallel[i].theta_h - from_far[i].theta_h));
    near_apart = std::max(near_apart, std::abs(parallel[i].theta_h - from_near[i].theta_h));
  }
  CHECK(far_apart < 1e-5);
  CHECK(near_apart > 1 * kDegree);
}

TEST_CASE("A free camera stands toward +x, within its limits, and keeps clear of the light") {
  const auto found = design_free_camera(basis(), small_view(), 2, {}, kLimits, few_starts(2));
  REQUIRE(found.design.size() == 2);
  for (const CameraLight& image : found.design) {
    CHECK(image.camera.phi == 0);
    CHECK(image.camera.theta <= kLimits.max_theta);
    CHECK(image.light.theta <= kLimits.max_theta);
    CHECK(angle_of(image) >= kLimits.clearance - 1e-9);
  }
  const DesignScore ours = score_images(basis(), small_view(), found.design);
  CHECK(ours.error.total(0) == Approx(*std::min_element(found.costs.begin(), found.costs.end())));
}

TEST_CASE("A fixed rig is better than the one it starts from, and a given camera stays") {
  const DesignLimits limits{70 * kDegree, 20 * kDegree};
  const auto score_of = [&](const FixedRig& rig) {
    return score_images(basis(), small_view(), images_of(rig)).error.total(0);
  };
  const auto given =
      design_fixed_rig(basis(), small_view(), {2, 52.5 * kDegree}, {}, limits, few_starts(2));
  CHECK(given.design.camera_theta == 52.5 * kDegree);
  CHECK(given.design.lights.size() == 2);
  CHECK(score_of(given.design) <
        score_of({52.5 * kDegree, {at_degrees(0, 0), at_degrees(70, 90)}}));
  const auto free = design_fixed_rig(basis(), small_view(), {2, {}}, {}, limits, few_starts(3));
  CHECK(score_of(free.design) <= score_of(given.design) * 1.02);
  CHECK(free.design.camera_theta <= limits.max_theta + 1e-9);
  for (const CameraLight& image : images_of(free.design)) {
    CHECK(image.light.theta <= limits.max_theta + 1e-9);
    CHECK(angle_of(image) >= limits.clearance - 1e-6);
  }
}

TEST_CASE("A rig that sees nothing, or stands below the sample, is named") {
  const auto error_of = [&](const std::vector<CameraLight>& images) {
    return input_error([&] { return score_images(basis(), small_view(), images); });
  };
  const CameraLight good{at_degrees(50, 0), at_degrees(50, 180)};
  CHECK(error_of({good}) == "(no error)");
  CHECK(contains(error_of({}), "no light given"));
  CHECK(contains(error_of({good, {at_degrees(50, 0), at_degrees(89.9, 0)}}),
                 "image 2: sees nothing"));
  CHECK(contains(error_of({{at_degrees(100, 0), at_degrees(20, 0)}}),
                 "camera of image 1: stands 100"));
  CHECK(contains(error_of({{at_degrees(20, 0), at_degrees(-95, 0)}}), "light of image 1"));
  CHECK(contains(error_of({{at_degrees(20, 0), at_degrees(std::nan(""), 0)}}), "light of image 1"));
  const auto crowded = [&] {
    return design_fixed_rig(basis(), small_view(), {1, {}}, {}, {5 * kDegree, 170 * kDegree},
                            few_starts(1));
  };
  CHECK(contains(input_error(crowded), "sees anything"));
}

TEST_CASE("Unusable numbers of a design are refused by their name") {
  const auto view_error = [&](auto change) {
    NearField view = small_view();
    change(view);
    return input_error([&] {
      check(view);
      return 0;
    });
  };
  CHECK(contains(view_error([](auto& v) { v.distance = 0; }), "camera distance"));
  CHECK(contains(view_error([](auto& v) { v.distance = std::nan(""); }), "camera distance"));
  CHECK(contains(view_error([](auto& v) { v.fov = std::numbers::pi; }), "field of view"));
  CHECK(contains(view_error([](auto& v) { v.samples = 0; }), "samples"));
  CHECK(contains(view_error([](auto& v) { v.light_distance = 0.01; }), "light distance"));
  const auto points_error = [&](int n, DesignGoal goal, DesignLimits limits) {
    return input_error([&] { return design_points(basis(), n, goal, limits, few_starts(1)); });
  };
  CHECK(contains(points_error(0, {}, kLimits), "points: 0; expected at least 1"));
  CHECK(contains(points_error(1, {DesignCriterion::error, -1}, kLimits), "beta"));
  CHECK(contains(points_error(1, {}, {90 * kDegree, 0}), "max theta"));
  CHECK(contains(points_error(1, {}, {80 * kDegree, -0.1}), "clearance"));
  const auto rig_error = [&] {
    return design_fixed_rig(basis(), small_view(), {0, {}}, {}, kLimits, few_starts(1));
  };
  CHECK(contains(input_error(rig_error), "lights: 0"));
}
