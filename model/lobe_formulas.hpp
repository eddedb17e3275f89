// The lobes of model/lobes.hpp as templates: on double for rendering, on Ceres' dual numbers for
// fits. Each is affine in the specular parameter: lobe = offset + gain * specular.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "model/directions.hpp"
#include "model/lobes.hpp"

namespace brdfgate::lobe {

inline constexpr double kPi = std::numbers::pi;

/// What the lobes need of a pair of directions above the horizon; computed once per direction.
struct Geometry {
  double cos_i, cos_o;
  double cos_h;
  double sin2_h;  ///< sin(theta_h)^2, with all its digits near the peak
  double cos_d;
  double mirror;   ///< wr . wo = 2 cos_i cos_o - cos(2 theta_d)
  double grazing;  ///< (1 - cos_d)^5 of Schlick 1994 eq. 15
};

/// @pre c = cosines(angles), above the horizon
inline Geometry geometry(const HalfDiff& angles, const Cosines& c) {
  const double sin_h = std::sin(angles.theta_h);
  const double cos_d = std::cos(angles.theta_d);
  const double away = 1 - cos_d;
  return {c.i,
          c.o,
          std::cos(angles.theta_h),
          sin_h * sin_h,
          cos_d,
          2 * c.i * c.o - (2 * cos_d * cos_d - 1),
          away * away * away * away * away};
}

template <typename T>
struct Affine {
  T offset;
  T gain;
};

template <typename T>
Affine<T> proportional(const T& gain) {
  return {T(0.0), gain};
}

/// Schlick's Fresnel, f0 + (1 - f0) grazing, times `rest`.
template <typename T>
Affine<T> schlick(const T& rest, const Geometry& g) {
  return {g.grazing * rest, (1 - g.grazing) * rest};
}

/// Unpolarised reflectance of a dielectric (Cook & Torrance 1982).
template <typename T>
T fresnel(const T& ior, double c) {
  using std::sqrt;
  const T g = sqrt(ior * ior + (c * c - 1));
  const T s = (g - c) / (g + c);
  const T t = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
  return 0.5 * s * s * (1.0 + t * t);
}

struct Phong {
  static constexpr LobeModel kModel = LobeModel::phong;
  static constexpr int kShapes = 1;
  template <typename T>
  static Affine<T> eval(const T* shape, const Geometry& g) {
    using std::pow;
    if (g.mirror <= 0) return {T(0.0), T(0.0)};
    const T& s = shape[0];
    return proportional<T>((s + 2.0) / (2 * kPi) * pow(g.mirror, s));
  }
};

struct BlinnPhong {
  static constexpr LobeModel kModel = LobeModel::blinn_phong;
  static constexpr int kShapes = 1;
  template <typename T>
  static Affine<T> eval(const T* shape, const Geometry& g) {
    using std::pow;
    const T& s = shape[0];
    return proportional<T>((s + 8.0) / (8 * kPi) * pow(g.cos_h, s));
  }
};

struct Blend {
  static constexpr LobeModel kModel = LobeModel::blend;
  static constexpr int kShapes = 3;  ///< exponent, alpha, ior
  template <typename T>
  static Affine<T> eval(const T* shape, const Geometry& g) {
    using std::pow;
    const double half4 = g.cos_h * g.cos_h * g.cos_h * g.cos_h;
    const T base = (1.0 - shape[1]) * g.mirror + shape[1] * half4;
    if (base <= 0.0) return {T(0.0), T(0.0)};
    return proportional<T>(fresnel(shape[2], g.cos_d) * pow(base, shape[0]));
  }
};

struct Ward {
  static constexpr LobeModel kModel = LobeModel::ward;
  static constexpr int kShapes = 1;
  template <typename T>
  static Affine<T> eval(const T* shape, const Geometry& g) {
    using std::exp;
    const T alpha2 = shape[0] * shape[0];
    const double cos2_h = g.cos_h * g.cos_h;
    return proportional<T>(exp(-(g.sin2_h / cos2_h) / alpha2) /
                           (4 * kPi * g.cos_d * g.cos_d * cos2_h * cos2_h * alpha2));
  }
};

struct Ggx {
  static constexpr LobeModel kModel = LobeModel::ggx;
  static constexpr int kShapes = 1;
  template <typename T>
  static Affine<T> eval(const T* shape, const Geometry& g) {
    using std::sqrt;
    const T alpha2 = shape[0] * shape[0];
    // Walter et al. 2007 eq. 33, written so that small alpha keeps its digits at the peak.
    const T base = g.sin2_h + alpha2 * (g.cos_h * g.cos_h);
    const T distribution = alpha2 / (kPi * base * base);
    // Heitz 2014 eq. 99 with the microfacet denominator 4 cos_i cos_o already divided out.
    const T visibility = 0.5 / (g.cos_i * sqrt(alpha2 + (1.0 - alpha2) * (g.cos_o * g.cos_o)) +
                                g.cos_o * sqrt(alpha2 + (1.0 - alpha2) * (g.cos_i * g.cos_i)));
    return schlick<T>(distribution * visibility, g);
  }
};

struct Beckmann {
  static constexpr LobeModel kModel = LobeModel::beckmann;
  static constexpr int kShapes = 1;
  template <typename T>
  static Affine<T> eval(const T* shape, const Geometry& g) {
    using std::exp;
    const T m2 = shape[0] * shape[0];
    const double cos2_h = g.cos_h * g.cos_h;
    const T distribution = exp(-(g.sin2_h / cos2_h) / m2) / (kPi * cos2_h * cos2_h * m2);
    const double masking = std::min(1.0, 2 * g.cos_h * std::min(g.cos_i, g.cos_o) / g.cos_d);
    return schlick<T>(distribution * (masking / (4 * g.cos_i * g.cos_o)), g);
  }
};

/// Calls `f` with the formula of a model that has a lobe, and returns what it returns.
/// @pre model is not lambert
template <typename Function>
decltype(auto) with_formula(LobeModel model, Function&& f) {
  switch (model) {
    case LobeModel::phong:
      return f(Phong{});
    case LobeModel::blinn_phong:
      return f(BlinnPhong{});
    case LobeModel::blend:
      return f(Blend{});
    case LobeModel::ward:
      return f(Ward{});
    case LobeModel::beckmann:
      return f(Beckmann{});
    default:
      return f(Ggx{});
  }
}

}  // namespace brdfgate::lobe
