#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "catch.hpp"
#include "model/readings.hpp"

using namespace brdfgate;

namespace {

constexpr double kDegree = EIGEN_PI / 180;

class Lambertian final : public Brdf {
 public:
  explicit Lambertian(const Rgb& albedo) : f_(albedo / EIGEN_PI) {}
  Rgb diffuse(double) const override { return f_; }
  Rgb specular(const HalfDiff&) const override { return Rgb::Zero(); }

 private:
  Rgb f_;
};

/// Microfacets without a diffuse part: GGX distribution, uncorrelated Smith masking, Fresnel of n.
class Microfacets final : public Brdf {
 public:
  Microfacets(double alpha, double n) : alpha2_(alpha * alpha), n_(n) {}
  Rgb diffuse(double) const override { return Rgb::Zero(); }
  Rgb specular(const HalfDiff& angles) const override {
    const Cosines c = cosines(angles);
    if (!c.above_horizon(0)) return Rgb::Zero();
    const double ch = std::cos(angles.theta_h);
    const double q = ch * ch * (alpha2_ - 1) + 1;
    const double d = alpha2_ / (EIGEN_PI * q * q);
    return Rgb::Constant(d * fresnel(std::cos(angles.theta_d)) * masking(c.i) * masking(c.o) /
                         (4 * c.i * c.o));
  }
  double fresnel(double cos_d) const { return fresnel_dielectric(cos_d, n_); }
  double masking(double c) const {
    return 2 * c / (c + std::sqrt(alpha2_ + (1 - alpha2_) * c * c));
  }

 private:
  double alpha2_, n_;
};

struct Geometry {
  GlossGeometry which;
  double degrees, receptor_in_plane_deg, receptor_across_deg;
};
const std::array<Geometry, 3> kGeometries{{{GlossGeometry::deg20, 20, 1.80, 3.60},
                                           {GlossGeometry::deg60, 60, 4.40, 11.70},
                                           {GlossGeometry::deg85, 85, 4.00, 6.00}}};

double black_glass(double degrees) {
  return fresnel_dielectric(std::cos(degrees * kDegree), 1.567);
}

/// int cos dw over a rectangular stop, over the cosine of its axis, by midpoints.
double projected(double in_plane_deg, double across_deg) {
  constexpr int kSteps = 200;
  const double u = std::tan(in_plane_deg * kDegree / 2), v = std::tan(across_deg * kDegree / 2);
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    for (int j = 0; j < kSteps; ++j) {
      const double x = u * (2 * (i + 0.5) / kSteps - 1), y = v * (2 * (j + 0.5) / kSteps - 1);
      sum += std::pow(1 + x * x + y * y, -2);
    }
  }
  return sum * 4 * u * v / (kSteps * kSteps);
}

/// An independent peer: photons from the source, mirrored by half vectors drawn from the GGX
/// distribution (Walter et al. 2007, eq. 35 and 41), counted where they meet the receptor.
struct Counted {
  double gloss = 0;
  double relative_deviation = 1;  ///< of the counting
};
Counted photon_gloss(const Microfacets& m, double alpha, const Geometry& g, int photons) {
  std::mt19937_64 random(20130);
  std::uniform_real_distribution<double> uniform(0, 1);
  const double polar = g.degrees * kDegree;
  const double su = std::tan(0.375 * kDegree), sv = std::tan(1.25 * kDegree);
  const double ru = std::tan(g.receptor_in_plane_deg * kDegree / 2);
  const double rv = std::tan(g.receptor_across_deg * kDegree / 2);
  const Eigen::Vector3d axis_i(-std::sin(polar), 0, std::cos(polar));
  const Eigen::Vector3d plane_i(std::cos(polar), 0, std::sin(polar));
  const Eigen::Vector3d axis_o(std::sin(polar), 0, std::cos(polar));
  const Eigen::Vector3d plane_o(std::cos(polar), 0, -std::sin(polar));
  double flux = 0, sent = 0;
  int received = 0;
  for (int k = 0; k < photons; ++k) {
    const Eigen::Vector3d wi = (axis_i + su * (2 * uniform(random) - 1) * plane_i +
                                sv * (2 * uniform(random) - 1) * Eigen::Vector3d::UnitY())
                                   .normalized();
    const double x = uniform(random), phi = 2 * EIGEN_PI * uniform(random);
    const double theta = std::atan(alpha * std::sqrt(x / (1 - x)));
    const Eigen::Vector3d h(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                            std::cos(theta));
    const double cos_d = wi.dot(h);
    sent += wi.z();
    if (cos_d <= 0) continue;
    const Eigen::Vector3d wo = 2 * cos_d * h - wi;
    const double along = wo.dot(axis_o);
    if (wo.z() <= 0 || along <= 0 || std::abs(wo.dot(plane_o)) > ru * along ||
        std::abs(wo.y()) > rv * along)
      continue;
    ++received;
    flux += m.fresnel(cos_d) * m.masking(wi.z()) * m.masking(wo.z()) * cos_d / h.z();
  }
  return {100 * flux / sent / black_glass(g.degrees), 1 / std::sqrt(std::max(1, received))};
}

}  // namespace

TEST_CASE("Fresnel's reflectance has its known values", "[readings]") {
  CHECK(fresnel_dielectric(1, 1.5) == Approx(0.04).epsilon(1e-12));
  CHECK(fresnel_dielectric(0, 1.5) == Approx(1).epsilon(1e-12));
  CHECK(fresnel_dielectric(0.3, 1.0) == Approx(0).margin(1e-15));
  // At Brewster's angle only the light across the plane comes back: ((n^2 - 1) / (n^2 + 1))^2 / 2.
  const double n = 1.567, s = (n * n - 1) / (n * n + 1);
  CHECK(fresnel_dielectric(std::cos(std::atan(n)), n) == Approx(s * s / 2).epsilon(1e-12));
  // ISO 2813's primary standard, in percent: 4.91, 10.01, 61.91.
  CHECK(black_glass(20) == Approx(0.04908).epsilon(5e-4));
  CHECK(black_glass(60) == Approx(0.10006).epsilon(5e-4));
  CHECK(black_glass(85) == Approx(0.61914).epsilon(5e-4));
}

TEST_CASE("Polished glass of n = 1.50 reads its Fresnel ratio to the black glass", "[readings]") {
  const std::array<double, 3> published{82.05, 89.14, 98.97};
  for (std::size_t i = 0; i < 3; ++i) {
    const double degrees = kGeometries[i].degrees;
    const double ratio =
        100 * fresnel_dielectric(std::cos(degrees * kDegree), 1.5) / black_glass(degrees);
    CHECK(ratio == Approx(published[i]).margin(0.01));
    // All but the far tails of so narrow a lobe fall into the receptor.
    CHECK(gloss_gu(Microfacets(2e-4, 1.5), kGeometries[i].which) == Approx(ratio).epsilon(2e-3));
  }
}

TEST_CASE("A perfect white diffuser reads what its receptor's solid angle collects", "[readings]") {
  const std::array<double, 3> published{1.20, 2.49, 0.033};
  for (std::size_t i = 0; i < 3; ++i) {
    const Geometry& g = kGeometries[i];
    const double expected = 100 * std::cos(g.degrees * kDegree) / EIGEN_PI *
                            projected(g.receptor_in_plane_deg, g.receptor_across_deg) /
                            black_glass(g.degrees);
    const double gloss = gloss_gu(Lambertian(Rgb::Ones()), g.which);
    CHECK(gloss == Approx(expected).epsilon(1e-3));
    CHECK(gloss == Approx(published[i]).margin(i == 2 ? 0.0006 : 0.006));
  }
}

TEST_CASE("Gloss agrees with photons counted one by one, from mirror to matt", "[readings]") {
  for (const double alpha : {0.001, 0.005, 0.02, 0.1, 0.4}) {
    const Microfacets m(alpha, 1.5);
    for (const Geometry& g : kGeometries) {
      CAPTURE(alpha, g.degrees);
      const Counted counted = photon_gloss(m, alpha, g, 100000);
      CHECK(gloss_gu(m, g.which) ==
            Approx(counted.gloss).epsilon(0.003 + 3 * counted.relative_deviation));
    }
  }
}

TEST_CASE("Gloss is linear in the BRDF and weighs colours by luminance", "[readings]") {
  const double white = gloss_gu(Lambertian(Rgb::Ones()), GlossGeometry::deg60);
  CHECK(gloss_gu(Lambertian(Rgb::Constant(0.25)), GlossGeometry::deg60) ==
        Approx(0.25 * white).epsilon(1e-12));
  CHECK(gloss_gu(Lambertian(Rgb(0, 1, 0)), GlossGeometry::deg60) ==
        Approx(0.7152 * white).epsilon(1e-12));
  const auto all = gloss_gu(Lambertian(Rgb::Ones()));
  for (std::size_t i = 0; i < 3; ++i)
    CHECK(all[i] == gloss_gu(Lambertian(Rgb::Ones()), kGeometries[i].which));
}

TEST_CASE("A BRDF that is not a number has no gloss", "[readings]") {
  const Lambertian broken(Rgb::Constant(std::numeric_limits<double>::quiet_NaN()));
  for (const double gloss : gloss_gu(broken))
    CHECK(std::isnan(gloss));
}

TEST_CASE("Rougher surfaces of the same kind are less glossy at every angle", "[readings]") {
  for (const Geometry& g : kGeometries) {
    double last = 200;
    for (const double alpha : {0.002, 0.01, 0.05, 0.1, 0.2, 0.4, 0.8}) {
      const double gloss = gloss_gu(Microfacets(alpha, 1.5), g.which);
      CHECK(gloss < last);
      last = gloss;
    }
  }
}

TEST_CASE("The colour of a Lambertian surface at 45:0 is its albedo's", "[readings]") {
  const Rgb albedo(0.2, 0.5, 0.1);
  CHECK((lab_45_0(Lambertian(albedo)) - linear_srgb_to_lab(albedo)).abs().maxCoeff() < 1e-10);
  CHECK(lab_45_0(Lambertian(Rgb::Ones()))[0] == Approx(100));
}
