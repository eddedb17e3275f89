// Gloss by integrating a BRDF over the apertures of ISO 2813.
//
// A glossmeter sees, with source directions wi of equal radiance and receptor directions wo,
//   flux = int_source int_receptor f(wi, wo) cos_i cos_o dwo dwi,
// and from the black glass, whose mirror image of the source lies whole inside the receptor,
// R cos_i of the geometry times the source's solid angle. For a given half vector h, dwo = 4 (wi .
// h) dh, so
//   flux = int dh 4 int_source [h mirrors wi into the receptor] f cos_i cos_o (wi . h) dwi.
// Over the small source, f of a diffuse part is constant, and f cos_i cos_o of a specular one (D F
// G / 4 of microfacets): two weights per h that know nothing of the material. Nodes and weights are
// made once per geometry, radially graded toward the mirror direction, so that a lobe of any width
// is resolved, and a reading costs one BRDF value a node.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "model/readings.hpp"

namespace brdfgate {
namespace {

constexpr double kDegree = EIGEN_PI / 180;
constexpr double kBlackGlassIndex = 1.567;  // ISO 2813:2014, 3.3: 100 gloss units

/// ISO 2813:2014 Table 1 (ASTM D523 Table 1): full angles, in the plane of measurement and across.
struct Aperture {
  double in_plane_deg;
  double across_deg;
};
constexpr Aperture kSourceImage{0.75, 2.5};

struct Standard {
  double incidence_deg;
  Aperture receptor;
};
constexpr std::array<Standard, 3> kStandards{
    {{20, {1.80, 3.60}}, {60, {4.40, 11.70}}, {85, {4.00, 6.00}}}};

/// Gauss-Legendre on [-1, 1], four points.
constexpr std::array<double, 4> kGaussAt{-0.8611363115940526, -0.3399810435848563,
                                         0.3399810435848563, 0.8611363115940526};
constexpr std::array<double, 4> kGaussWeight{0.3478548451374538, 0.6521451548625461,
                                             0.6521451548625461, 0.3478548451374538};

/// Calls visit(x, weight) over [from, to].
template <typename Visit>
void gauss(double from, double to, Visit&& visit) {
  const double half = (to - from) / 2;
  for (std::size_t i = 0; i < kGaussAt.size(); ++i)
    visit(from + half * (1 + kGaussAt[i]), half * kGaussWeight[i]);
}

/// A rectangular field stop around an axis in the xz plane: tangents of the angles, in the plane of
/// measurement and across.
class FieldStop {
 public:
  FieldStop(double polar_rad, double side, const Aperture& aperture)
      : axis_(side * std::sin(polar_rad), 0, std::cos(polar_rad)),
        in_plane_(std::cos(polar_rad), 0, -side * std::sin(polar_rad)),
        half_u_(std::tan(aperture.in_plane_deg * kDegree / 2)),
        half_v_(std::tan(aperture.across_deg * kDegree / 2)) {}

  double half_u() const { return half_u_; }
  double half_v() const { return half_v_; }
  Eigen::Vector3d direction(double u, double v) const {
    return (axis_ + u * in_plane_ + v * Eigen::Vector3d::UnitY()).normalized();
  }
  /// dw / (du dv) of the tangents.
  static double solid_angle_density(double u, double v) {
    return std::pow(1 + u * u + v * v, -1.5);
  }

  /// Share of a patch of size du x dv, centred on this direction, that lies within the stop.
  double share(const Eigen::Vector3d& w, double du, double dv) const {
    const double along = w.dot(axis_);
    if (along <= 0) return 0;
    const double u = std::abs(w.dot(in_plane_)) / along, v = std::abs(w.y()) / along;
    return std::clamp((half_u_ - u) / du + 0.5, 0.0, 1.0) *
           std::clamp((half_v_ - v) / dv + 0.5, 0.0, 1.0);
  }

 private:
  Eigen::Vector3d axis_, in_plane_;
  double half_u_, half_v_;
};

/// Source directions that one half vector mirrors into the receptor.
struct Overlap {
  double solid_angle = 0;  ///< sr
  Eigen::Vector3d mean_wi = Eigen::Vector3d::Zero();
  double diffuse = 0;  ///< int cos_i cos_o (wi . h) dwi
};

double luminance(const Rgb& f) {
  return 0.2126 * f[0] + 0.7152 * f[1] + 0.0722 * f[2];
}

class GlossTable {
 public:
  explicit GlossTable(const Standard& standard)
      : polar_(standard.incidence_deg * kDegree),
        source_(polar_, -1, kSourceImage),
        receptor_(polar_, 1, standard.receptor) {
    const double cos_i = std::cos(polar_);
    double source_solid_angle = 0;
    for_each_source_patch([&](const Eigen::Vector3d&, double dw) { source_solid_angle += dw; });
    scale_ = 100 / (fresnel_dielectric(cos_i, kBlackGlassIndex) * cos_i * source_solid_angle);
    // Half vectors' reach: half the sum of both half angles; across it, stretched by 1 / cos.
    const double ratio =
        (receptor_.half_v() + source_.half_v()) / cos_i / (receptor_.half_u() + source_.half_u());
    add_quadrants(ratio);
  }

  double read(const Brdf& brdf) const {
    double gloss = 0;
    for (const GlossNode& node : nodes_) {
      gloss += node.diffuse * luminance(brdf.diffuse(node.angles.theta_d)) +
               node.specular * luminance(brdf.specular(node.angles));
    }
    return gloss < 0 ? 0 : gloss;  // NaN stays NaN
  }

  const std::vector<GlossNode>& nodes() const { return nodes_; }

 private:
  /// Source patches a side: overlaps are counted by their clipped areas.
  static constexpr int kPatches = 8;
  static constexpr int kMarks = 9;
  double patch_u() const { return 2 * source_.half_u() / kPatches; }
  double patch_v() const { return 2 * source_.half_v() / kPatches; }

  template <typename Visit>
  void for_each_source_patch(Visit&& visit) const {
    for (int i = 0; i < kPatches; ++i) {
      for (int j = 0; j < kPatches; ++j) {
        const double u = (i + 0.5) * patch_u() - source_.half_u();
        const double v = (j + 0.5) * patch_v() - source_.half_v();
        visit(source_.direction(u, v),
              FieldStop::solid_angle_density(u, v) * patch_u() * patch_v());
      }
    }
  }

  static Eigen::Vector3d half_vector(double theta, double phi) {
    return {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
  }
  static Eigen::Vector3d mirrored(const Eigen::Vector3d& wi, const Eigen::Vector3d& h) {
    return 2 * wi.dot(h) * h - wi;
  }

  Overlap overlap(const Eigen::Vector3d& h) const {
    Overlap sum;
    for_each_source_patch([&](const Eigen::Vector3d& wi, double dw) {
      const Eigen::Vector3d wo = mirrored(wi, h);
      const double part = dw * receptor_.share(wo, patch_u(), patch_v());
      sum.solid_angle += part;
      sum.mean_wi += part * wi;
      sum.diffuse += part * std::max(0.0, wi.z() * wo.z() * wi.dot(h));
    });
    if (sum.solid_angle > 0) sum.mean_wi.normalize();
    return sum;
  }

  /// Corners, sides' middles and centre of the source: how many of these nine h mirrors into the
  /// receptor.
  int marks_received(const Eigen::Vector3d& h) const {
    int received = 0;
    for (int mark = 0; mark < kMarks; ++mark) {
      const int u = mark % 3 - 1, v = mark / 3 - 1;
      const Eigen::Vector3d wi = source_.direction(u * source_.half_u(), v * source_.half_v());
      received += receptor_.share(mirrored(wi, h), 1e-9, 1e-9) > 0.5 ? 1 : 0;
    }
    return received;
  }

  /// Last theta along phi (within reach) at which at least `marks` of the source are received.
  double last_theta(double phi, int marks) const {
    constexpr int kSteps = 96;
    constexpr double kReach = 0.6;  // rad; beyond the 85 degree geometry's 0.43
    double theta = 0;
    for (int i = kSteps; i > 0 && theta == 0; --i) {
      const double at = kReach * i * i / (kSteps * kSteps);
      if (marks_received(half_vector(at, phi)) >= marks) theta = at;
    }
    double beyond = theta + kReach * 2 / kSteps;
    for (int i = 0; i < 20; ++i) {
      const double middle = (theta + beyond) / 2;
      (marks_received(half_vector(middle, phi)) >= marks ? theta : beyond) = middle;
    }
    return theta;
  }

  /// Azimuths 0..pi (the plane of measurement is a plane of symmetry) in four pieces. In each the
  /// reach goes as 1 / cos from the nearer side's middle: tan(phi) = sinh(s) evens out both that
  /// and a lobe that does not depend on phi.
  void add_quadrants(double ratio) {
    gauss_pieces(std::asinh(ratio), 3, [&](double s, double ds) {
      const double phi = std::atan(std::sinh(s)), dphi = ds / std::cosh(s);
      add_ray(phi, dphi);
      add_ray(EIGEN_PI - phi, dphi);
    });
    gauss_pieces(std::asinh(1 / ratio), 1, [&](double s, double ds) {
      const double from_side = std::atan(std::sinh(s)), dphi = ds / std::cosh(s);
      add_ray(EIGEN_PI / 2 - from_side, dphi);
      add_ray(EIGEN_PI / 2 + from_side, dphi);
    });
  }

  template <typename Visit>
  static void gauss_pieces(double to, int pieces, Visit&& visit) {
    for (int i = 0; i < pieces; ++i)
      gauss(to * i / pieces, to * (i + 1) / pieces, visit);
  }

  /// Graded panels where the whole source is received, even ones over the ramp beyond.
  void add_ray(double phi, double dphi) {
    constexpr double kFirstPanel = 2.5e-4;  // rad: a lobe of GGX alpha 0.001 is resolved
    constexpr double kGrowth = 2.5;
    constexpr int kRampPanels = 3;
    const double whole = last_theta(phi, kMarks), last = last_theta(phi, 1);
    double from = 0;
    for (double to = kFirstPanel; from < whole; to *= kGrowth) {
      // A panel that would leave a sliver behind takes it along.
      const double end = to * 1.3 > whole ? whole : to;
      add_panel(from, end, phi, dphi);
      from = end;
    }
    for (int i = 0; i < kRampPanels; ++i) {
      const double step = (last - whole) / kRampPanels;
      add_panel(whole + i * step, whole + (i + 1) * step, phi, dphi);
    }
  }

  void add_panel(double from, double to, double phi, double dphi) {
    gauss(from, to, [&](double theta, double dtheta) {
      const Eigen::Vector3d h = half_vector(theta, phi);
      const Overlap o = overlap(h);
      if (o.solid_angle <= 0) return;
      const Eigen::Vector3d wo = mirrored(o.mean_wi, h);
      const double cos_i = o.mean_wi.z(), cos_o = wo.z();
      if (cos_i <= 0 || cos_o <= 0) return;
      constexpr double kBothSides = 2;
      const double dh = kBothSides * std::sin(theta) * dtheta * dphi;
      const double specular = cos_i * cos_o * wo.dot(h) * o.solid_angle;
      nodes_.push_back(
          {to_half_diff({o.mean_wi, wo}), scale_ * 4 * o.diffuse * dh, scale_ * 4 * specular * dh});
    });
  }

  double polar_;
  FieldStop source_, receptor_;
  double scale_ = 0;
  std::vector<GlossNode> nodes_;
};

const GlossTable& table(GlossGeometry geometry) {
  static const std::array<GlossTable, 3> tables{
      GlossTable(kStandards[0]), GlossTable(kStandards[1]), GlossTable(kStandards[2])};
  return tables[static_cast<std::size_t>(geometry)];
}

}  // namespace

double gloss_gu(const Brdf& brdf, GlossGeometry geometry) {
  return table(geometry).read(brdf);
}

const std::vector<GlossNode>& gloss_nodes(GlossGeometry geometry) {
  return table(geometry).nodes();
}

std::array<double, 3> gloss_gu(const Brdf& brdf) {
  return {gloss_gu(brdf, GlossGeometry::deg20), gloss_gu(brdf, GlossGeometry::deg60),
          gloss_gu(brdf, GlossGeometry::deg85)};
}

}  // namespace brdfgate
