// Analytic BRDFs of scene files: Lambert, Cook-Torrance with GGX (model/lobes.hpp has the rest of
// the family that can be fitted), ABC, shifted gamma distribution.
#pragma once

#include "model/brdf.hpp"

namespace brdfgate {

/// f = albedo / pi.
struct LambertParameters {
  Rgb albedo = Rgb::Zero();  ///< in [0, 1]
};

/// Cook-Torrance with GGX distribution, Smith height-correlated masking and Schlick's Fresnel
/// (Walter et al. 2007; Heitz 2014; Schlick 1994), over a Lambertian term diffuse / pi.
struct GgxParameters {
  Rgb diffuse = Rgb::Zero();  ///< albedo in [0, 1]
  Rgb f0 = Rgb::Zero();       ///< reflectance at normal incidence, [0, 1]
  double alpha = 0.1;         ///< GGX roughness (alpha, not its square root), (0, 1]
};

/// ABC microfacet model (Loew, Kronander, Ynnerman, Unger 2012, "BRDF models for accurate and
/// efficient rendering of glossy surfaces"): kd/pi + F G S / (pi cos_i cos_o),
/// S = A / (1 + B (1 - cos theta_h))^C, unpolarised Fresnel of `ior`, Cook-Torrance masking.
struct AbcParameters {
  Rgb kd = Rgb::Zero();
  Rgb a = Rgb::Zero();
  double b = 0;
  double c = 0;
  double ior = 1.5;
};

/// Shifted gamma distribution (Bagher, Soler, Holzschuch 2012, "Accurate fitting of measured
/// reflectances using a shifted gamma micro-facet distribution"); every parameter per channel.
struct SgdParameters {
  Rgb rho_d, rho_s, alpha, p, f0, f1, kap, lambda, c, k, theta0;
};

BrdfPtr make_brdf(const LambertParameters& p);
BrdfPtr make_brdf(const GgxParameters& p);
BrdfPtr make_brdf(const AbcParameters& p);
BrdfPtr make_brdf(const SgdParameters& p);

/// Relative change of a material as scene files define it: albedo scales the diffuse part, gloss
/// the specular part, roughness r turns it into specular(theta_h / r) / r^2, hue_deg rotates the
/// a*b* of the diffuse part (linear sRGB, D65, 2 degrees).
struct BrdfChange {
  double albedo = 1;
  double gloss = 1;
  double roughness = 1;
  double hue_deg = 0;
};
BrdfPtr changed(BrdfPtr base, const BrdfChange& change);

}  // namespace brdfgate
