#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "catch.hpp"
#include "model/analytic.hpp"
#include "model/colour.hpp"
#include "support/directional_albedo.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::directional_albedo;
using brdfgate::test::input_error;

namespace {

constexpr double kPi = std::numbers::pi;

/// The four directions of the reference values below.
const std::array<HalfDiff, 4> kAt{
    {{0.02, 0.3, 0.4}, {0.2, 0.9, 1.5}, {0.6, 1.2, 2.0}, {1.0, 0.5, 2.9}}};

struct Published {
  const char* name;
  BrdfPtr brdf;
  std::array<Rgb, 4> f;  ///< at kAt, by an implementation in numpy of the papers' formulas
};

void check_published(const Published& material) {
  for (std::size_t i = 0; i < kAt.size(); ++i) {
    const Rgb f = material.brdf->eval(kAt[i]);
    INFO(material.name << " at direction " << i);
    for (int channel = 0; channel < 3; ++channel)
      CHECK(f[channel] == Approx(material.f[i][channel]).epsilon(1e-8));
  }
}

BrdfPtr ggx(double alpha, double f0, double diffuse = 0) {
  GgxParameters p;
  p.diffuse = Rgb::Constant(diffuse);
  p.f0 = Rgb::Constant(f0);
  p.alpha = alpha;
  return make_brdf(p);
}

SgdParameters alum_bronze_sgd() {
  SgdParameters p;
  p.rho_d = Rgb(0.0478786, 0.0313514, 0.0200638);
  p.rho_s = Rgb(0.0364976, 0.664975, 0.268836);
  p.alpha = Rgb(0.014832, 0.0300126, 0.0490339);
  p.p = Rgb(0.459076, 0.450056, 0.529272);
  p.f0 = Rgb(6.05524, 0.235756, 0.580647);
  p.f1 = Rgb(5.05524, 0.182842, 0.476088);
  p.kap = Rgb(46.3841, 24.5961, 14.8261);
  p.lambda = Rgb(2.60672, 2.97371, 2.7827);
  p.c = Rgb(1.12717e-07, 1.06401e-07, 5.27952e-08);
  p.k = Rgb(47.783, 36.2767, 31.6066);
  p.theta0 = Rgb(0.205635, 0.066289, -0.0661091);
  return p;
}

}  // namespace

TEST_CASE("ABC gives the values of its published fits") {
  const auto abc = [](const Rgb& kd, const Rgb& a, double b, double c, double ior) {
    return make_brdf(AbcParameters{kd, a, b, c, ior});
  };
  // Parameters: Loew et al. 2012, supplemental table, MERL materials of these names.
  check_published({"alum-bronze",
                   abc({0.024514, 0.022346, 0.01622}, {51.714554, 37.932693, 27.373095},
                       10482.133789, 0.816737, 2.236525),
                   {Rgb(1.05535418, 0.7754930778, 0.5596435807),
                    Rgb(0.1012979644, 0.07569159578, 0.05465089673),
                    Rgb(0.0844693152, 0.06334775958, 0.04574330346),
                    Rgb(0.01118883456, 0.009596431187, 0.006955120967)}});
  check_published({"blue-acrylic",
                   abc({0.011106, 0.035057, 0.104254}, {1191.397339, 1099.257202, 1082.125366},
                       255868.953125, 1.084736, 1.475061),
                   {Rgb(0.2142732968, 0.2055990967, 0.2245948523),
                    Rgb(0.009087577555, 0.01628200467, 0.03822825208),
                    Rgb(0.008093855112, 0.0153651346, 0.03732567136),
                    Rgb(0.00359999687, 0.0112188218, 0.03324397852)}});
  check_published({"chrome",
                   abc({0.002692, 0.00252, 0.003088}, {986.846741, 771.035522, 696.134583},
                       64661.257812, 1.90542, 99.999413),
                   {Rgb(2.187458144, 1.709220651, 1.54344003),
                    Rgb(0.001815136198, 0.001550830312, 0.001658900164),
                    Rgb(0.0009061119562, 0.0008405984674, 0.001017662589),
                    Rgb(0.0008581764461, 0.0008031458625, 0.0009838482538)}});
}

TEST_CASE("the shifted gamma distribution gives the values of its published fits") {
  // Parameters: Bagher et al. 2012, supplemental table.
  check_published(
      {"alum-bronze",
       make_brdf(alum_bronze_sgd()),
       {Rgb(0.9653206561, 0.4466277345, 0.245750348), Rgb(0.07076354479, 0.1414894964, 0.155468047),
        Rgb(0.01524023172, 0.009980360317, 0.006546618218),
        Rgb(0.01524023172, 0.009979460566, 0.006386505894)}});
  SgdParameters chrome_steel;
  chrome_steel.rho_d = Rgb(0.0206718, 0.0240818, 0.024351);
  chrome_steel.rho_s = Rgb(0.129782, 0.109032, 0.0524555);
  chrome_steel.alpha = Rgb(5.51292e-05, 3.13288e-05, 4.51944e-05);
  chrome_steel.p = Rgb(0.207979, 0.152758, 0.325431);
  chrome_steel.f0 = Rgb(1.18818e-12, 2.06813e-11, 0.580895);
  chrome_steel.f1 = Rgb(-0.316807, -0.265326, -0.419105);
  chrome_steel.kap = Rgb(15466.8, 28628.9, 16531.2);
  chrome_steel.lambda = Rgb(12.8988, 68.7898, 4.68237);
  chrome_steel.c = Rgb(1e10, 1e10, 44.7025);
  chrome_steel.k = Rgb(510.0, 665.0, 618.155);
  chrome_steel.theta0 = Rgb(1.20035, 1.2003, 0.579562);
  check_published({"chrome-steel",
                   make_brdf(chrome_steel),
                   {Rgb(0.03809333437, 0.007834812167, 0.01440026822),
                    Rgb(0.006580038305, 0.007665475017, 0.007751164038),
                    Rgb(0.006580038305, 0.007665475017, 0.007751164038),
                    Rgb(0.006580038305, 0.007665475017, 0.007751164038)}});
}

TEST_CASE("Lambert is albedo over pi in every direction") {
  const BrdfPtr f = make_brdf(LambertParameters{Rgb(0.2, 0.5, 0.9)});
  for (const HalfDiff& at : kAt) {
    CHECK(f->eval(at)[1] == Approx(0.5 / kPi));
    CHECK(f->specular(at).isZero());
  }
}

TEST_CASE("GGX at normal incidence is f0 / (4 pi alpha^2) plus its diffuse term") {
  // D(0) = 1 / (pi alpha^2), G = 1, F = f0, over 4 cos cos = 4.
  for (const double alpha : {0.001, 0.02, 0.3, 1.0}) {
    CHECK(ggx(alpha, 0.04, 0.5)->eval({0, 0, 0})[0] ==
          Approx(0.04 / (4 * kPi * alpha * alpha) + 0.5 / kPi));
  }
}

TEST_CASE("GGX is reciprocal and its parts are never negative") {
  const BrdfPtr f = ggx(0.2, 0.04, 0.1);
  for (double ti = 0.1; ti < 1.5; ti += 0.3) {
    for (double to = 0.05; to < 1.5; to += 0.3) {
      const Eigen::Vector3d a(std::sin(ti), 0, std::cos(ti));
      const Eigen::Vector3d b(std::sin(to) * std::cos(2.5), std::sin(to) * std::sin(2.5),
                              std::cos(to));
      const Rgb there = f->specular(to_half_diff({a, b}));
      CHECK(there[0] == Approx(f->specular(to_half_diff({b, a}))[0]));
      CHECK(there[0] >= 0);
    }
  }
}

TEST_CASE("GGX reflects no more light than it receives, and nearly all of it when polished") {
  for (const double alpha : {0.02, 0.1, 0.3, 0.6, 1.0}) {
    const BrdfPtr mirror = ggx(alpha, 1.0);
    for (const double theta_i : {0.0, 0.5, 1.0, 1.4}) {
      const double albedo = directional_albedo(*mirror, theta_i);
      INFO("alpha " << alpha << ", incidence " << theta_i);
      CHECK(albedo <= 1.001);
      // Single scattering loses little on smooth surfaces (Heitz 2014, section 6).
      if (alpha <= 0.1 && theta_i <= 1.0) CHECK(albedo > 0.97);
    }
  }
}

TEST_CASE("nothing is reflected from below the horizon") {
  const HalfDiff below{1.4, 1.2, 0.0};
  REQUIRE_FALSE(cosines(below).above_horizon());
  CHECK(ggx(0.3, 0.5)->specular(below).isZero());
  CHECK(make_brdf(AbcParameters{Rgb::Zero(), Rgb::Ones(), 100, 1, 1.5})->specular(below).isZero());
  CHECK(make_brdf(alum_bronze_sgd())->specular(below).isZero());
}

TEST_CASE("a change scales the diffuse and the specular part by themselves") {
  const BrdfPtr base = ggx(0.1, 0.04, 0.3);
  for (const HalfDiff& at : kAt) {
    const BrdfPtr darker = changed(base, {.albedo = 0.5});
    CHECK(darker->diffuse(at.theta_d)[0] == Approx(0.5 * base->diffuse(at.theta_d)[0]));
    CHECK(darker->specular(at)[0] == Approx(base->specular(at)[0]));
    const BrdfPtr duller = changed(base, {.gloss = 0.7});
    CHECK(duller->diffuse(at.theta_d)[0] == Approx(base->diffuse(at.theta_d)[0]));
    CHECK(duller->specular(at)[0] == Approx(0.7 * base->specular(at)[0]));
  }
}

TEST_CASE("roughness r is the specular part at theta_h / r, over r squared") {
  const BrdfPtr base = ggx(0.1, 0.04, 0.3);
  for (const double r : {0.8, 1.3, 2.0}) {
    const BrdfPtr f = changed(base, {.roughness = r});
    for (const double theta_h : {0.0, 0.05, 0.2}) {
      const HalfDiff at{theta_h, 0.6, 1.0};
      CHECK(f->specular(at)[0] ==
            Approx(base->specular({theta_h / r, 0.6, 1.0})[0] / (r * r)).epsilon(1e-12));
    }
  }
}

TEST_CASE("a changed material is finite and not negative wherever the original is") {
  const std::vector<BrdfPtr> bases{
      ggx(0.3, 0.9, 0.1), make_brdf(alum_bronze_sgd()),
      make_brdf(AbcParameters{Rgb::Constant(0.1), Rgb::Constant(500), 1e5, 1.2, 1.5})};
  for (const BrdfPtr& base : bases) {
    for (const double r : {0.01, 0.3, 0.9, 3.0}) {
      const BrdfPtr f = changed(base, {.roughness = r});
      for (double th = 0; th < 1.571; th += 0.078) {
        for (double td = 0; td < 1.571; td += 0.078) {
          for (double pd = 0; pd < kPi; pd += 0.39) {
            const HalfDiff at{th, td, pd};
            if (!cosines(at).above_horizon()) continue;
            const Rgb v = f->eval(at);
            if (v.isFinite().all() && (v >= 0).all()) continue;
            FAIL("r " << r << " at " << th << ", " << td << ", " << pd << ": " << v.transpose());
          }
        }
      }
    }
  }
}

TEST_CASE("hue turns the diffuse colour as a reflectance and leaves the highlight alone") {
  const Rgb albedo(0.5, 0.2, 0.1);
  GgxParameters p;
  p.diffuse = albedo;
  p.f0 = Rgb::Constant(0.04);
  const BrdfPtr base = make_brdf(p);
  const BrdfPtr f = changed(base, {.albedo = 0.8, .hue_deg = 40});
  const Rgb expected = 0.8 * rotate_hue(albedo, 40) / kPi;
  for (const double theta_d : {0.0, 0.01, 0.7, kPi / 2}) {
    for (int channel = 0; channel < 3; ++channel)
      CHECK(f->diffuse(theta_d)[channel] == Approx(expected[channel]));
  }
  CHECK(f->specular(kAt[0])[1] == Approx(base->specular(kAt[0])[1]));
}

TEST_CASE("parameters out of range are refused by name") {
  GgxParameters rough;
  rough.alpha = 1.5;
  GgxParameters nan_alpha;
  nan_alpha.alpha = std::nan("");
  SgdParameters sgd = alum_bronze_sgd();
  sgd.alpha[1] = 0;
  const std::vector<std::pair<const char*, std::function<void()>>> wrong{
      {"lambert", [] { make_brdf(LambertParameters{Rgb(0.2, 1.2, 0.1)}); }},
      {"ggx.alpha", [&] { make_brdf(rough); }},
      {"ggx.alpha", [&] { make_brdf(nan_alpha); }},
      {"abc.ior", [] { make_brdf(AbcParameters{Rgb::Zero(), Rgb::Ones(), 1, 1, 0.5}); }},
      {"abc.a", [] { make_brdf(AbcParameters{Rgb::Zero(), -Rgb::Ones(), 1, 1, 1.5}); }},
      {"sgd.alpha", [&] { make_brdf(sgd); }},
      {"change.roughness", [] { changed(ggx(0.1, 0.04), {.roughness = 0}); }},
      {"change.albedo", [] { changed(ggx(0.1, 0.04), {.albedo = -1}); }},
      {"change.hue_deg", [] { changed(ggx(0.1, 0.04), {.hue_deg = std::nan("")}); }},
  };
  for (const auto& [field, call] : wrong) {
    INFO(field);
    CHECK(contains(input_error(call), field));
  }
}
