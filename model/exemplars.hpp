// Exemplars: plausible materials beyond the measured ones, made from them or from an analytic lobe.
//
// A training set is small and no two of its members share a lobe under another diffuse colour.
// Exemplars fill the space between its members, for an estimator that learns from examples:
//   recombined   s max(f(q theta_h, theta_d, phi_d) - o, 0) + albedo / pi: a training observation f
//                with its base o taken off, its lobe stretched by q and scaled by s, on a new base
//   microfacet   one or two lobes of a generalised Trowbridge-Reitz distribution (Burley 2012,
//                "GTR": long tails) or of Beckmann's (short ones), with Smith masking of GGX and
//                Schlick's Fresnel, over albedo / pi
// They are values of one colour channel, 1/sr.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "model/directions.hpp"

namespace brdfgate {

class Basis;

/// A generalised Trowbridge-Reitz lobe (exponent 2 is GGX), or Beckmann's.
struct MicrofacetLobe {
  double alpha = 0.1;   ///< roughness, (0, 1)
  double exponent = 2;  ///< (1, 3]; 0: Beckmann's distribution
  double f0 = 0.04;     ///< reflectance at normal incidence, [0, 1]
  double scale = 0;     ///< 0: no lobe
};

struct Exemplar {
  int source = -1;     ///< training observation; -1: a microfacet exemplar
  double albedo = 0;   ///< of the base
  double offset = 0;   ///< o, 1/sr
  double scale = 1;    ///< s
  double stretch = 1;  ///< q
  std::array<MicrofacetLobe, 2> lobes;
};

/// As the basis file stores one.
using ExemplarRecord = std::array<float, 13>;
ExemplarRecord to_record(const Exemplar& exemplar);
Exemplar from_record(const ExemplarRecord& record);
/// Whether every number is finite and in its range, the source one of `observations`.
bool is_valid(const Exemplar& exemplar, int observations);

/// How many of each kind are drawn.
struct ExemplarCounts {
  int recombined = 400;
  int microfacet = 200;
  int total() const { return recombined + microfacet; }
};

/// Draws exemplars with a fixed seed from a basis' own training observations; the same basis gives
/// the same exemplars.
std::vector<Exemplar> draw_exemplars(const Basis& basis, const ExemplarCounts& counts);

/// Their values at directions above the horizon, directions x exemplars, 1/sr. Training
/// observations are taken as the basis reconstructs them.
Eigen::MatrixXd exemplar_reflectance(const Basis& basis, const std::vector<Exemplar>& exemplars,
                                     const std::vector<HalfDiff>& directions);

/// Their weights in the basis by least squares over its cells, exemplars x k.
Eigen::MatrixXd project_exemplars(const Basis& basis, const std::vector<Exemplar>& exemplars);

/// Mapped values less the basis' mean at directions, directions x (observations + exemplars): the
/// exemplars of the file first, then the training observations.
Eigen::MatrixXd example_rows(const Basis& basis, const std::vector<HalfDiff>& directions);

}  // namespace brdfgate
