// Readings people know, computed from a BRDF: gloss (ISO 2813 / ASTM D523) and colour at 45:0.
#pragma once

#include <array>
#include <vector>

#include "model/brdf.hpp"
#include "model/colour.hpp"

namespace brdfgate {

/// The standard's three geometries.
enum class GlossGeometry { deg20, deg60, deg85 };

/// Gloss units: flux into the receptor aperture over that from black glass of n = 1.567 (= 100 GU;
/// its Fresnel reflectance at the geometry's angle, mirror flux fully collected), averaged over
/// source and receptor apertures of ISO 2813 Table 1; photopic weight taken as the luminance of
/// linear sRGB. Right for lobes from a near-mirror (GGX alpha 0.001) to a diffuser: within 0.3 % of
/// counted photons. Some 1,200 BRDF values a geometry; the nodes are made on first use.
double gloss_gu(const Brdf& brdf, GlossGeometry geometry);
std::array<double, 3> gloss_gu(const Brdf& brdf);  ///< 20, 60, 85 degrees

/// A direction that gloss_gu() looks at, with what it multiplies there. Both weights differ by
/// under 0.2 % (the apertures' second order).
struct GlossNode {
  HalfDiff angles;
  double diffuse = 0;   ///< of the diffuse part's luminance; the sum is in gloss units
  double specular = 0;  ///< of the rest's
};
const std::vector<GlossNode>& gloss_nodes(GlossGeometry geometry);

/// Fresnel reflectance of an unpolarised beam at a dielectric (n to vacuum), incidence in radians.
double fresnel_dielectric(double cos_i, double n);

/// Colour at 45:0: pi f against the perfect diffuser.
Lab lab_45_0(const Brdf& brdf);

}  // namespace brdfgate
