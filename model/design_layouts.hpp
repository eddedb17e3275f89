// The ways to look at a sample that a design chooses among: single directions, images of a sphere,
// near-field images of a flat sample with a free or a fixed camera.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "model/design.hpp"
#include "model/design_search.hpp"

namespace brdfgate {

/// Which figure a search minimises. For a single point `condition` has no meaning and the row's
/// 2-norm is maximised instead (C.IV section 4).
enum class DesignCriterion { error, condition };

struct DesignGoal {
  DesignCriterion criterion = DesignCriterion::error;
  double beta = 0;  ///< of C.VI eq. 15: error common to all directions, mapped units
};

/// Where things may stand, radians.
struct DesignLimits {
  double max_theta = 0;  ///< of camera and light from the normal, under pi/2
  double clearance = 0;  ///< least angle between camera and light, seen from the sample
};

/// Both figures of a set of measurements.
struct DesignScore {
  int rows = 0;          ///< directions, all images together
  double condition = 0;  ///< kappa(Q~), infinity where rank-deficient
  double row_norm = 0;   ///< 2-norm of the rows (Frobenius): C.IV's figure for a single point
  ExpectedError error;
};
DesignScore score(const DesignBasis& basis, const Information& information);

/// What a search found, and the lowest cost of each of its starts.
template <typename Design>
struct Found {
  Design design;
  std::vector<double> costs;
};

/// A direction by its polar angle from the normal and its azimuth from +x, radians.
struct PolarDirection {
  double theta = 0;
  double phi = 0;
  Eigen::Vector3d unit() const;
};
PolarDirection to_polar(const Eigen::Vector3d& direction);

// ---- points (C.IV section 4, C.VI section 5.1)

/// n directions on MERL's grid of 90 x 90 x 180 cells. Throws InputError for n < 1.
Found<std::vector<HalfDiff>> design_points(const DesignBasis& basis, int n, const DesignGoal& goal,
                                           const DesignLimits& limits,
                                           const SearchOptions& options);
/// Throws InputError for no directions, a non-finite one, or one below the horizon.
DesignScore score_points(const DesignBasis& basis, const std::vector<HalfDiff>& directions);

// ---- spheres (C.IV section 9)

/// What an image of a sphere under each of MERL's 90 theta_d tells: all its (theta_h, phi_d) cells
/// above the horizon. Computed on all cores; `done` (may be empty) is called after each.
std::vector<Information> sphere_images(const DesignBasis& basis,
                                       const std::function<void()>& done = {});
/// Cells of theta_d (theta_d = cell + 0.5 degrees) of n images. Throws InputError for n < 1.
Found<std::vector<int>> design_spheres(const DesignBasis& basis,
                                       const std::vector<Information>& images, int n,
                                       const DesignGoal& goal, const SearchOptions& options);

// ---- near-field images of a flat sample (C.VI section 5.2 and 8)

/// The camera looks at the sample's centre from `distance`; what counts is the disc around the
/// centre that it would see under `fov` from straight above (C.VI: alpha = 2 atan(r / R)).
struct NearField {
  double distance = 0.18;      ///< camera to centre, metres
  double fov = 0;              ///< full angle, radians
  double light_distance = 0;   ///< light to centre, metres; 0: directional light
  int samples = 15;            ///< points across the disc
  double disc_radius() const;  ///< metres
};
/// Throws InputError for a distance, field of view or number of samples that makes no disc, and a
/// light nearer than the disc's edge.
void check(const NearField& view);

struct CameraLight {
  PolarDirection camera;
  PolarDirection light;
};
/// Directions that one image sees; those within 0.6 degrees of the horizon are left out.
std::vector<HalfDiff> seen_directions(const NearField& view, const CameraLight& image);

/// Free camera: n pairs, camera and light anew for each image; half/difference angles of the centre
/// run over MERL's grid, phi_d over the full circle because camera and light are not alike.
Found<std::vector<CameraLight>> design_free_camera(const DesignBasis& basis, const NearField& view,
                                                   int n, const DesignGoal& goal,
                                                   const DesignLimits& limits,
                                                   const SearchOptions& options);

/// Fixed camera: one camera toward +x and n lights, each alone on in its image; whole degrees. A
/// given camera stays where it is.
struct FixedRig {
  double camera_theta = 0;
  std::vector<PolarDirection> lights;
};
/// What is to be placed: n lights, and the camera unless its angle is given.
struct RigRequest {
  int lights = 2;
  std::optional<double> camera_theta;
};
Found<FixedRig> design_fixed_rig(const DesignBasis& basis, const NearField& view,
                                 const RigRequest& request, const DesignGoal& goal,
                                 const DesignLimits& limits, const SearchOptions& options);

/// Throws InputError for no image, a camera or light below the horizon, and an image that sees
/// nothing, naming it.
DesignScore score_images(const DesignBasis& basis, const NearField& view,
                         const std::vector<CameraLight>& images);
std::vector<CameraLight> images_of(const FixedRig& rig);

}  // namespace brdfgate
