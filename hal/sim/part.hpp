// What lies under the simulated camera, made definite: one part with its drawn pose, its varied
// materials and its defects, or one of the calibration targets.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "hal/sim/scene.hpp"
#include "model/brdf.hpp"

namespace brdfgate {

/// The calibration targets. All are plates larger than the field of view, in the part's plane.
namespace sim_target {
inline constexpr double kWhiteReflectance = 0.99;  ///< Lambertian, as Spectralon's nominal
inline constexpr double kSagLengthM = 0.09;        ///< over which a bent white plate sags
inline constexpr double kBlackReflectance = 0.005;
/// Polished black glass, n = 1.567 (the gloss standard of ISO 2813): f0 = ((n - 1) / (n + 1))^2.
/// With this roughness its highlight stays under full well in the shortest default exposure.
inline constexpr double kMirrorF0 = 0.0488;
inline constexpr double kMirrorAlpha = 0.015;
/// Board centred on the part's origin (model/board.hpp): squares along x and y, so one inner corner
/// fewer each way. Its edges fade over kBoardPitchM, as a pixel's own width would make them.
inline constexpr int kBoardSquaresX = 10;
inline constexpr int kBoardSquaresY = 7;
inline constexpr double kBoardSquareM = 0.008;
inline constexpr double kBoardPitchM = 0.0001;  ///< of the printed pattern's dots
inline constexpr double kBoardWhite = 0.9;
inline constexpr double kBoardBlack = 0.03;
/// Between and around the patches of the colour chart (model/colour_chart.hpp's classic one).
inline constexpr double kChartFrame = 0.03;
}  // namespace sim_target

/// What a part got by chance. The relative factors of `variation` hold for all its materials.
struct PartDraw {
  ScenePose pose;
  BrdfChange variation;
};
/// Draws from (seed, index): pose uniform within the jitter's half-widths around the scene's pose,
/// variation normal, held at or above 0.05. Each figure has its own place in the sequence: a jitter
/// switched on does not change the others.
PartDraw draw_part(const Scene& scene, std::uint64_t seed, std::uint64_t index);

/// Pose of the part's frame P (origin at its centre, z its normal) in W: turned by rotation_deg
/// about z, then tilted by R = Ry Rx, then moved to (shift, height).
Eigen::Isometry3d part_pose(const ScenePose& pose);

/// The surface of what lies there, in its own frame P: metres, z the normal.
///
/// Defects are in the part's coordinates and their edge fades over 0.2 mm:
/// stain scales the diffuse part by 1 - strength; dull scales the roughness by 1 + strength (the
/// lobe keeps its energy: see BrdfChange); scratch doubles the roughness along a line parallel to
/// the part's x, 0.3 mm wide and size_mm long, whatever its strength; dust is a Lambertian speck
/// of reflectance 0.3, whatever its strength. Later ones lie on top of earlier ones. A part's back
/// has one material and no defects. The white plate takes defects too: dirt and shadow are stains.
class PartSurface {
 public:
  /// Throws InputError: a part without materials, mask of a foreign type or beyond the materials, a
  /// change of an unknown material, a size, change or defect that is not physical.
  PartSurface(const Scene& scene, const BrdfChange& variation);

  /// Whether the surface reaches to this point of its plane; beyond it one sees the fixture.
  bool covers(const Eigen::Vector2d& p_P) const;
  /// Slope of the surface along its x (dz/dx) at a point: of a bent white plate, else 0. The
  /// plate's points stay in its plane: at these slopes only the normal matters.
  double slope(const Eigen::Vector2d& p_P) const {
    return -8 * sag_m_ * p_P.x() / (sim_target::kSagLengthM * sim_target::kSagLengthM);
  }
  bool flat() const { return sag_m_ == 0; }
  /// f in 1/sr at a point.
  Rgb f(const Eigen::Vector2d& p_P, const HalfDiff& angles) const;
  /// Share of a uniform environment's light that leaves toward the camera: the reflectance of
  /// prepare_ambient with the defects' effect on it. A blurred lobe reflects as much as a sharp
  /// one. Precondition: prepare_ambient was called.
  Rgb ambient_reflectance(const Eigen::Vector2d& p_P) const;
  /// Integrates every material's directional-hemispherical reflectance for one direction of
  /// observation (radians from the normal).
  void prepare_ambient(double theta_o);

 private:
  struct Material {
    BrdfPtr brdf;
    std::vector<BrdfPtr> by_defect;  ///< with the roughness of the n-th defect, null if unchanged
    Rgb ambient_diffuse = Rgb::Zero();
    Rgb ambient_specular = Rgb::Zero();
  };
  struct Defect {
    DefectKind kind;
    Eigen::Vector2d at_m;
    double radius_m;       ///< of a disc; half the width of a scratch
    double half_length_m;  ///< of a scratch, else 0
    double strength;
  };

  void add_part(const Scene& scene, const BrdfChange& variation);
  void add_defects(const Scene& scene);
  void add_material(const BrdfPtr& base, const BrdfChange& change);
  std::size_t material_at(const Eigen::Vector2d& p_P) const;
  /// 0 on a black square of the board, 1 on a white one and around.
  double board_whiteness(const Eigen::Vector2d& p_P) const;
  const Material& chart_material(const Eigen::Vector2d& p_P) const;
  static double coverage(const Defect& defect, const Eigen::Vector2d& p_P);

  SceneTarget target_;
  bool present_ = true;
  double sag_m_ = 0;
  Eigen::Vector2d size_m_ = Eigen::Vector2d::Zero();  ///< of a part
  cv::Mat regions_;
  cv::Mat board_;  ///< CV_8UC1 of the board's pattern, row 0 at its highest y
  std::vector<Material> materials_;
  std::vector<Defect> defects_;
};

/// Directional-hemispherical reflectance of the two parts of a BRDF for observation at theta_o
/// (radians): the integral of f cos_i over the incident hemisphere, on a grid of half vectors dense
/// at the highlight (the theta_h axis of MERL files).
struct HemisphericalReflectance {
  Rgb diffuse = Rgb::Zero();
  Rgb specular = Rgb::Zero();
};
HemisphericalReflectance hemispherical_reflectance(const Brdf& brdf, double theta_o);

}  // namespace brdfgate
