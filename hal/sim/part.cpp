#include "hal/sim/part.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "hal/sim/random.hpp"
#include "model/colour_chart.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

using std::numbers::pi;

constexpr double kMm = 1e-3;
constexpr double kDeg = pi / 180;
constexpr double kDefectEdgeM = 0.2e-3;
constexpr double kScratchWidthM = 0.3e-3;
constexpr double kScratchRoughness = 2;
constexpr double kDustAlbedo = 0.3;
constexpr double kLeastVariation = 0.05;  // keeps a far tail of the normal law physical
constexpr std::uint64_t kPartStream = 0x70617274;

double with_variation(cv::RNG& rng, double sigma) {
  return std::max(kLeastVariation, 1 + sigma * rng.gaussian(1.0));
}

bool is_rough(DefectKind kind) {
  return kind == DefectKind::dull || kind == DefectKind::scratch;
}

double roughness_of(const SceneDefect& defect) {
  return defect.kind == DefectKind::scratch ? kScratchRoughness : 1 + defect.strength;
}

BrdfChange combined(const BrdfChange& a, const BrdfChange& b) {
  return {a.albedo * b.albedo, a.gloss * b.gloss, a.roughness * b.roughness, a.hue_deg + b.hue_deg};
}

/// The plain model where nothing changes: one indirection per pixel less.
BrdfPtr apply(const BrdfPtr& base, const BrdfChange& change) {
  const bool same =
      change.albedo == 1 && change.gloss == 1 && change.roughness == 1 && change.hue_deg == 0;
  return same ? base : changed(base, change);
}

BrdfPtr lambert(double albedo) {
  return make_brdf(LambertParameters{Rgb::Constant(albedo)});
}

/// Ink of a chart's patch in linear sRGB, out of its gamut too: a camera's own channels may see
/// what those of sRGB cannot.
class ChartInk final : public Brdf {
 public:
  explicit ChartInk(const Rgb& albedo) : diffuse_(albedo / pi) {}
  Rgb diffuse(double /*theta_d*/) const override { return diffuse_; }
  Rgb specular(const HalfDiff& /*angles*/) const override { return Rgb::Zero(); }

 private:
  Rgb diffuse_;
};

void check_change(const std::string& where, const BrdfChange& change) {
  const bool finite = std::isfinite(change.albedo) && std::isfinite(change.gloss) &&
                      std::isfinite(change.roughness) && std::isfinite(change.hue_deg);
  if (!finite || change.albedo < 0 || change.gloss < 0 || change.roughness <= 0) {
    throw InputError(where, "is not a physical change",
                     "finite factors, albedo and gloss at least 0, roughness over 0");
  }
}

/// All changes that name this material, joined.
BrdfChange change_of(const Scene& scene, const std::string& material) {
  BrdfChange joined;
  for (const SceneChange& c : scene.changes) {
    if (c.material == material) joined = combined(joined, c.change);
  }
  return joined;
}

void check_changes(const Scene& scene) {
  for (std::size_t i = 0; i < scene.changes.size(); ++i) {
    const SceneChange& change = scene.changes[i];
    const std::string where = "scene.change[" + std::to_string(i) + "]";
    check_change(where, change.change);
    const bool known =
        std::any_of(scene.materials.begin(), scene.materials.end(),
                    [&](const SceneMaterial& m) { return m.name == change.material; });
    if (!known) {
      throw InputError(where + ".material", "no material is called '" + change.material + "'",
                       "a name from scene.materials");
    }
  }
}

void check_materials(const Scene& scene) {
  if (scene.materials.empty()) {
    throw InputError("scene.materials", "is empty", "at least the body");
  }
  for (const SceneMaterial& m : scene.materials) {
    if (!m.brdf) throw InputError("scene.materials", "'" + m.name + "' has no BRDF");
  }
}

void check_regions(const Scene& scene) {
  if (scene.regions.empty()) return;
  if (scene.regions.type() != CV_8UC1) {
    throw InputError("scene.regions", "is not an 8-bit image of one channel");
  }
  double last = 0;
  cv::minMaxLoc(scene.regions, nullptr, &last);
  if (last >= static_cast<double>(scene.materials.size())) {
    throw InputError("scene.regions", "holds index " + std::to_string(static_cast<int>(last)),
                     "below the number of materials, " + std::to_string(scene.materials.size()));
  }
}

void check_defect(const SceneDefect& defect, std::size_t index) {
  const std::string where = "scene.defects[" + std::to_string(index) + "]";
  if (!std::isfinite(defect.at_mm[0]) || !std::isfinite(defect.at_mm[1])) {
    throw InputError(where + ".at_mm", "is not finite");
  }
  if (!(defect.size_mm > 0) || !std::isfinite(defect.size_mm)) {
    throw InputError(where + ".size_mm", "is " + std::to_string(defect.size_mm), "over 0");
  }
  if (!(defect.strength >= 0 && defect.strength <= 1)) {
    throw InputError(where + ".strength", "is " + std::to_string(defect.strength), "0 to 1");
  }
}

}  // namespace

PartDraw draw_part(const Scene& scene, std::uint64_t seed, std::uint64_t index) {
  cv::RNG rng(derive_seed(derive_seed(seed, index), kPartStream));
  const auto within = [&](double centre, double half_width) {
    return centre + half_width * rng.uniform(-1.0, 1.0);
  };
  PartDraw draw;
  for (std::size_t i = 0; i < 2; ++i) {
    draw.pose.shift_mm[i] = within(scene.pose.shift_mm[i], scene.jitter.shift_mm[i]);
  }
  draw.pose.rotation_deg = within(scene.pose.rotation_deg, scene.jitter.rotation_deg);
  for (std::size_t i = 0; i < 2; ++i) {
    draw.pose.tilt_deg[i] = within(scene.pose.tilt_deg[i], scene.jitter.tilt_deg[i]);
  }
  draw.pose.height_mm = within(scene.pose.height_mm, scene.jitter.height_mm);
  draw.variation.albedo = with_variation(rng, scene.variation.albedo);
  draw.variation.gloss = with_variation(rng, scene.variation.gloss);
  draw.variation.roughness = with_variation(rng, scene.variation.roughness);
  return draw;
}

Eigen::Isometry3d part_pose(const ScenePose& pose) {
  using Eigen::AngleAxisd;
  using Eigen::Vector3d;
  Eigen::Isometry3d X_WP = Eigen::Isometry3d::Identity();
  X_WP.translation() = kMm * Vector3d(pose.shift_mm[0], pose.shift_mm[1], pose.height_mm);
  X_WP.linear() = (AngleAxisd(pose.tilt_deg[1] * kDeg, Vector3d::UnitY()) *
                   AngleAxisd(pose.tilt_deg[0] * kDeg, Vector3d::UnitX()) *
                   AngleAxisd(pose.rotation_deg * kDeg, Vector3d::UnitZ()))
                      .toRotationMatrix();
  return X_WP;
}

PartSurface::PartSurface(const Scene& scene, const BrdfChange& variation) : target_(scene.target) {
  switch (target_) {
    case SceneTarget::part:
      add_part(scene, variation);
      return;
    case SceneTarget::white:
      add_material(lambert(sim_target::kWhiteReflectance), {});
      add_defects(scene);
      sag_m_ = kMm * scene.sag_mm;
      return;
    case SceneTarget::black:
      add_material(lambert(sim_target::kBlackReflectance), {});
      return;
    case SceneTarget::mirror:
      add_material(make_brdf(GgxParameters{Rgb::Zero(), Rgb::Constant(sim_target::kMirrorF0),
                                           sim_target::kMirrorAlpha}),
                   {});
      return;
    case SceneTarget::chart:
      for (const ChartPatch& patch : classic_chart().patches)
        add_material(std::make_shared<ChartInk>(xyz_to_linear_srgb(patch.xyz)), {});
      add_material(lambert(sim_target::kChartFrame), {});
      return;
    case SceneTarget::board:
      add_material(lambert(sim_target::kBoardBlack), {});
      add_material(lambert(sim_target::kBoardWhite), {});
      board_ = draw_board({.kind = scene.board,
                           .squares_x = sim_target::kBoardSquaresX,
                           .squares_y = sim_target::kBoardSquaresY,
                           .square_m = sim_target::kBoardSquareM},
                          static_cast<int>(sim_target::kBoardSquareM / sim_target::kBoardPitchM));
      return;
  }
}

void PartSurface::add_part(const Scene& scene, const BrdfChange& variation) {
  check_changes(scene);
  present_ = scene.present;
  if (!present_) return;
  size_m_ = kMm * Eigen::Vector2d(scene.part_size_mm[0], scene.part_size_mm[1]);
  if (!(size_m_.array() > 0).all() || !size_m_.allFinite()) {
    throw InputError("scene.part.size_mm", "is not a size", "two lengths over 0");
  }
  if (!scene.face_front) {
    add_material(make_brdf(LambertParameters{scene.back_albedo}), {});
    return;
  }
  check_materials(scene);
  check_regions(scene);
  regions_ = scene.regions.clone();
  for (const SceneMaterial& m : scene.materials) {
    add_material(m.brdf, combined(variation, change_of(scene, m.name)));
  }
  add_defects(scene);
}

void PartSurface::add_material(const BrdfPtr& base, const BrdfChange& change) {
  Material material;
  material.brdf = apply(base, change);
  materials_.push_back(std::move(material));
}

void PartSurface::add_defects(const Scene& scene) {
  for (std::size_t i = 0; i < scene.defects.size(); ++i) {
    const SceneDefect& d = scene.defects[i];
    check_defect(d, i);
    const bool line = d.kind == DefectKind::scratch;
    defects_.push_back({.kind = d.kind,
                        .at_m = kMm * Eigen::Vector2d(d.at_mm[0], d.at_mm[1]),
                        .radius_m = line ? kScratchWidthM / 2 : kMm * d.size_mm / 2,
                        .half_length_m = line ? kMm * d.size_mm / 2 : 0,
                        .strength = d.strength});
    for (Material& m : materials_) {
      BrdfPtr rough;
      if (is_rough(d.kind)) rough = apply(m.brdf, {1, 1, roughness_of(d), 0});
      m.by_defect.push_back(rough);
    }
  }
}

bool PartSurface::covers(const Eigen::Vector2d& p_P) const {
  if (target_ != SceneTarget::part) return true;
  return present_ && (p_P.array().abs() <= size_m_.array() / 2).all();
}

std::size_t PartSurface::material_at(const Eigen::Vector2d& p_P) const {
  if (regions_.empty()) return 0;
  const Eigen::Array2d unit = p_P.array() / size_m_.array() + 0.5;
  const int column = static_cast<int>(unit.x() * regions_.cols);
  const int row = static_cast<int>((1 - unit.y()) * regions_.rows);
  return regions_.at<std::uint8_t>(std::clamp(row, 0, regions_.rows - 1),
                                   std::clamp(column, 0, regions_.cols - 1));
}

const PartSurface::Material& PartSurface::chart_material(const Eigen::Vector2d& p_P) const {
  return materials_[classic_chart().patch_at(p_P)];
}

double PartSurface::board_whiteness(const Eigen::Vector2d& p_P) const {
  const double x = p_P.x() / sim_target::kBoardPitchM + (board_.cols - 1) / 2.0;
  const double y = (board_.rows - 1) / 2.0 - p_P.y() / sim_target::kBoardPitchM;
  const auto dot = [&](int column, int row) {
    const bool inside = column >= 0 && row >= 0 && column < board_.cols && row < board_.rows;
    return inside ? board_.at<std::uint8_t>(row, column) / 255.0 : 1.0;
  };
  const double left = std::clamp(std::floor(x), -2.0, board_.cols + 1.0);
  const double top = std::clamp(std::floor(y), -2.0, board_.rows + 1.0);
  const int i = static_cast<int>(left);
  const int j = static_cast<int>(top);
  const double a = std::clamp(x - left, 0.0, 1.0);
  const double b = std::clamp(y - top, 0.0, 1.0);
  return (1 - b) * ((1 - a) * dot(i, j) + a * dot(i + 1, j)) +
         b * ((1 - a) * dot(i, j + 1) + a * dot(i + 1, j + 1));
}

double PartSurface::coverage(const Defect& defect, const Eigen::Vector2d& p_P) {
  const Eigen::Vector2d from = p_P - defect.at_m;
  const double reach = defect.radius_m + kDefectEdgeM;
  if (std::abs(from.y()) > reach) return 0;
  const double dx = std::max(0.0, std::abs(from.x()) - defect.half_length_m);
  if (dx > reach) return 0;
  const double distance = std::hypot(dx, from.y());
  return std::clamp(0.5 + (defect.radius_m - distance) / kDefectEdgeM, 0.0, 1.0);
}

Rgb PartSurface::f(const Eigen::Vector2d& p_P, const HalfDiff& angles) const {
  if (target_ == SceneTarget::board) {
    const double white = board_whiteness(p_P);
    return (1 - white) * materials_[0].brdf->eval(angles) +
           white * materials_[1].brdf->eval(angles);
  }
  if (target_ == SceneTarget::chart) return chart_material(p_P).brdf->diffuse(angles.theta_d);
  const Material& material = materials_[material_at(p_P)];
  if (defects_.empty()) return material.brdf->eval(angles);
  Rgb diffuse = material.brdf->diffuse(angles.theta_d);
  Rgb specular = material.brdf->specular(angles);
  for (std::size_t i = 0; i < defects_.size(); ++i) {
    const double share = coverage(defects_[i], p_P);
    if (share <= 0) continue;
    switch (defects_[i].kind) {
      case DefectKind::stain:
        diffuse *= 1 - share * defects_[i].strength;
        break;
      case DefectKind::dull:
      case DefectKind::scratch:
        specular = (1 - share) * specular + share * material.by_defect[i]->specular(angles);
        break;
      case DefectKind::dust:
        diffuse = (1 - share) * diffuse + share * kDustAlbedo / pi;
        specular *= 1 - share;
        break;
    }
  }
  return (diffuse + specular).max(0.0);
}

Rgb PartSurface::ambient_reflectance(const Eigen::Vector2d& p_P) const {
  if (target_ == SceneTarget::board) {
    const double white = board_whiteness(p_P);
    return (1 - white) * materials_[0].ambient_diffuse + white * materials_[1].ambient_diffuse;
  }
  if (target_ == SceneTarget::chart) return chart_material(p_P).ambient_diffuse;
  const Material& material = materials_[material_at(p_P)];
  Rgb diffuse = material.ambient_diffuse;
  Rgb specular = material.ambient_specular;
  for (const Defect& defect : defects_) {
    const double share = coverage(defect, p_P);
    if (defect.kind == DefectKind::stain) diffuse *= 1 - share * defect.strength;
    if (defect.kind == DefectKind::dust) {
      diffuse = (1 - share) * diffuse + share * kDustAlbedo;
      specular *= 1 - share;
    }
  }
  return diffuse + specular;
}

void PartSurface::prepare_ambient(double theta_o) {
  for (Material& m : materials_) {
    const HemisphericalReflectance r = hemispherical_reflectance(*m.brdf, theta_o);
    m.ambient_diffuse = r.diffuse;
    m.ambient_specular = r.specular.max(0.0);
  }
}

HemisphericalReflectance hemispherical_reflectance(const Brdf& brdf, double theta_o) {
  // dw_i = 4 (wo . h) dw_h; theta_h = (pi / 2) u^2 with u on a regular grid.
  constexpr int kTheta = 180;
  constexpr int kPhi = 90;
  const Eigen::Vector3d wo(std::sin(theta_o), 0, std::cos(theta_o));
  HemisphericalReflectance sum;
  for (int i = 0; i < kTheta; ++i) {
    const double u = (i + 0.5) / kTheta;
    const double theta_h = pi / 2 * u * u;
    const double solid_angle = std::sin(theta_h) * (pi * u / kTheta) * (2 * pi / kPhi);
    for (int j = 0; j < kPhi; ++j) {
      const double phi = 2 * pi * (j + 0.5) / kPhi;
      const Eigen::Vector3d h(std::sin(theta_h) * std::cos(phi), std::sin(theta_h) * std::sin(phi),
                              std::cos(theta_h));
      const double oh = wo.dot(h);
      const Eigen::Vector3d wi = 2 * oh * h - wo;
      if (oh <= 0 || wi.z() <= 0) continue;
      const HalfDiff angles = to_half_diff({.wi = wi, .wo = wo});
      const double weight = 4 * oh * wi.z() * solid_angle;
      sum.diffuse += weight * brdf.diffuse(angles.theta_d);
      sum.specular += weight * brdf.specular(angles);
    }
  }
  return sum;
}

}  // namespace brdfgate
