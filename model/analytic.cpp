#include "model/analytic.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <type_traits>
#include <utility>

#include "model/colour.hpp"
#include "model/error.hpp"
#include "model/lobe_formulas.hpp"

namespace brdfgate {
namespace {

constexpr double kPi = std::numbers::pi;

template <typename Number>
void check(bool ok, const char* where, const Number& value, const char* expected) {
  if (ok) return;
  std::string seen;
  if constexpr (std::is_same_v<Number, Rgb>) {
    for (const double v : value)
      seen += (seen.empty() ? "[" : ", ") + std::to_string(v);
    seen += "]";
  } else {
    seen = std::to_string(value);
  }
  throw InputError(where, seen, expected);
}

void check_albedo(const Rgb& a, const char* where) {
  check(((a >= 0) && (a <= 1)).all(), where, a, "three values between 0 and 1");
}

/// Finite and not negative, per channel.
void check_level(const Rgb& a, const char* where) {
  check(((a >= 0) && (a < 1e12)).all(), where, a, "three finite values, none negative");
}

void check_finite(const Rgb& a, const char* where) {
  check(a.allFinite(), where, a, "three finite values");
}

void check_positive(const Rgb& a, const char* where) {
  check(((a > 0) && (a < 1e12)).all(), where, a, "three finite values over 0");
}

/// Base of the models: a Lambertian term that does not depend on the angles.
class OverLambert : public Brdf {
 public:
  explicit OverLambert(const Rgb& albedo) : diffuse_(albedo / kPi) {}
  Rgb diffuse(double /*theta_d*/) const final { return diffuse_; }

 private:
  Rgb diffuse_;
};

class Abc final : public OverLambert {
 public:
  explicit Abc(const AbcParameters& p) : OverLambert(p.kd), p_(p) {}

  Rgb specular(const HalfDiff& angles) const override {
    const Cosines c = cosines(angles);
    if (!c.above_horizon()) return Rgb::Zero();
    const double cd = std::cos(angles.theta_d);
    const double ch = std::cos(angles.theta_h);
    // Cook & Torrance 1982 eq. for F and G; both cosines and cd are over 0 here.
    const double masking = std::min({1.0, 2 * ch * c.i / cd, 2 * ch * c.o / cd});
    // 1 - cos without cancellation: lobes are narrower than sqrt(epsilon) would resolve.
    const double one_less_cos = 2 * std::pow(std::sin(angles.theta_h / 2), 2);
    const double facets = std::pow(1 + p_.b * one_less_cos, -p_.c);
    return p_.a * (lobe::fresnel(p_.ior, cd) * masking * facets / (kPi * c.i * c.o));
  }

 private:
  AbcParameters p_;
};

class Sgd final : public OverLambert {
 public:
  explicit Sgd(const SgdParameters& p) : OverLambert(p.rho_d), p_(p) {}

  Rgb specular(const HalfDiff& angles) const override {
    const Cosines c = cosines(angles);
    if (!c.above_horizon()) return Rgb::Zero();
    const double cd = std::cos(angles.theta_d);
    const double ch2 = std::pow(std::cos(angles.theta_h), 2);
    const double tan2 = std::pow(std::tan(angles.theta_h), 2);
    const Rgb fresnel = p_.f0 - cd * p_.f1 + std::pow(1 - cd, 5) * (1 - p_.f0);
    const Rgb shifted = p_.alpha + tan2 / p_.alpha;
    const Rgb distribution = p_.kap * (-shifted).exp() / (kPi * shifted.pow(p_.p) * ch2 * ch2);
    const Rgb f =
        p_.rho_s * fresnel * distribution * shadowing(c.i) * shadowing(c.o) / (kPi * c.i * c.o);
    // The published exponents overflow at grazing angles for some materials: no lobe there.
    return f.isFinite().select(f, 0.0);
  }

 private:
  Rgb shadowing(double cosine) const {
    const Rgb beyond = (std::acos(std::min(cosine, 1.0)) - p_.theta0).max(0.0);
    const Rgb g = 1 + p_.lambda * (1 - (p_.c * beyond.pow(p_.k)).exp());
    return g.max(0.0).min(1.0);
  }

  SgdParameters p_;
};

/// Largest theta_h at which both cosines are at least `least`, for this theta_d and phi_d:
/// the smaller cosine is cos(theta_h) cos(theta_d) - sin(theta_h) sin(theta_d) |cos(phi_d)|.
double horizon(const HalfDiff& angles, double least) {
  const double along = std::cos(angles.theta_d);
  const double across = std::sin(angles.theta_d) * std::abs(std::cos(angles.phi_d));
  const double radius = std::hypot(along, across);
  if (radius <= least) return 0;
  return std::max(0.0, std::acos(least / radius) - std::atan2(across, along));
}

class Changed final : public Brdf {
 public:
  Changed(BrdfPtr base, const BrdfChange& change) : base_(std::move(base)), change_(change) {
    for (std::size_t i = 0; i < diffuse_.size(); ++i) {
      // Colour is of reflectances: pi f against the perfect diffuser.
      const Rgb albedo = kPi * base_->diffuse(static_cast<double>(i) / kPerRadian);
      diffuse_[i] = change.hue_deg == 0 ? albedo : rotate_hue(albedo, change.hue_deg);
      diffuse_[i] *= change.albedo / kPi;
    }
  }

  Rgb diffuse(double theta_d) const override {
    if (change_.hue_deg == 0) return change_.albedo * base_->diffuse(theta_d);
    const double at = std::clamp(theta_d * kPerRadian, 0.0, diffuse_.size() - 1.0);
    const auto i = std::min(static_cast<std::size_t>(at), diffuse_.size() - 2);
    const double share = at - static_cast<double>(i);
    return (1 - share) * diffuse_[i] + share * diffuse_[i + 1];
  }

  Rgb specular(const HalfDiff& angles) const override {
    if (change_.roughness == 1) return change_.gloss * base_->specular(angles);
    HalfDiff moved = angles;
    moved.theta_h = angles.theta_h / change_.roughness;
    if (change_.roughness < 1) {
      // A narrower lobe asks beyond the horizon for directions that are above it: its last value.
      const double last = std::max(angles.theta_h, horizon(angles, kLeastCosine));
      moved.theta_h = std::min(moved.theta_h, last);
    }
    return change_.gloss / (change_.roughness * change_.roughness) * base_->specular(moved);
  }

 private:
  static constexpr double kLeastCosine = 0.01;
  static constexpr int kKnots = 181;  // half degrees: a MERL table's knots and one between each
  static constexpr double kPerRadian = (kKnots - 1) / (kPi / 2);

  BrdfPtr base_;
  BrdfChange change_;
  std::array<Rgb, kKnots> diffuse_;
};

}  // namespace

BrdfPtr make_brdf(const LambertParameters& p) {
  return make_brdf(Lobe{LobeModel::lambert, p.albedo, Rgb::Zero(), {}});
}

BrdfPtr make_brdf(const GgxParameters& p) {
  return make_brdf(Lobe{LobeModel::ggx, p.diffuse, p.f0, {p.alpha}});
}

BrdfPtr make_brdf(const AbcParameters& p) {
  check_albedo(p.kd, "abc.kd");
  check_level(p.a, "abc.a");
  check(p.b >= 0 && p.b < 1e12, "abc.b", p.b, "a finite value, not negative");
  check(p.c >= 0 && p.c < 1e3, "abc.c", p.c, "a value between 0 and 1000");
  check(p.ior >= 1 && p.ior < 1e6, "abc.ior", p.ior, "a refractive index of at least 1");
  return std::make_shared<Abc>(p);
}

BrdfPtr make_brdf(const SgdParameters& p) {
  check_albedo(p.rho_d, "sgd.rho_d");
  check_level(p.rho_s, "sgd.rho_s");
  check_positive(p.alpha, "sgd.alpha");
  check_level(p.p, "sgd.p");
  check_finite(p.f0, "sgd.f0");
  check_finite(p.f1, "sgd.f1");
  check_level(p.kap, "sgd.kap");
  check_level(p.lambda, "sgd.lambda");
  check_finite(p.c, "sgd.c");
  check_finite(p.k, "sgd.k");
  check_finite(p.theta0, "sgd.theta0");
  return std::make_shared<Sgd>(p);
}

BrdfPtr changed(BrdfPtr base, const BrdfChange& change) {
  check(change.albedo >= 0 && std::isfinite(change.albedo), "change.albedo", change.albedo,
        "a factor, not negative");
  check(change.gloss >= 0 && std::isfinite(change.gloss), "change.gloss", change.gloss,
        "a factor, not negative");
  check(change.roughness >= 0.01 && change.roughness <= 100, "change.roughness", change.roughness,
        "a factor between 0.01 and 100");
  check(std::isfinite(change.hue_deg), "change.hue_deg", change.hue_deg, "an angle in degrees");
  return std::make_shared<Changed>(std::move(base), change);
}

}  // namespace brdfgate
