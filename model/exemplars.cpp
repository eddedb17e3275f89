#include "model/exemplars.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "model/basis.hpp"
#include "model/grid_stencil.hpp"
#include "model/mapping.hpp"
#include "model/parallel.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;

/// In place of an exponent, here and in the file: the distribution is Beckmann's.
constexpr double kBeckmann = 0;

/// A material's base is what is left between these half angles, clear of lobe and horizon.
constexpr double kBaseFrom = 15 * kDegree;
constexpr double kBaseTo = 70 * kDegree;
constexpr double kBaseLeastWeight = 0.15;
constexpr double kBaseQuantile = 0.05;

/// Uniform and normal numbers that are the same with every standard library.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : engine_(seed) {}
  double uniform() { return static_cast<double>(engine_() >> 11U) * 0x1.0p-53; }
  double uniform(double least, double most) { return least + (most - least) * uniform(); }
  double log_uniform(double least, double most) {
    return std::exp(uniform(std::log(least), std::log(most)));
  }
  /// Box and Muller 1958; the second value of the pair is not used.
  double normal() {
    const double radius = std::sqrt(-2 * std::log(1 - uniform()));
    return radius * std::cos(2 * kPi * uniform());
  }
  int below(int n) { return std::min(n - 1, static_cast<int>(uniform() * n)); }

 private:
  std::mt19937_64 engine_;
};

/// Albedos of real surfaces, from black paint to white tile.
double draw_albedo(Dice& dice) {
  return dice.log_uniform(0.003, 0.95);
}

/// A lobe q times narrower is brighter by up to q squared, as a microfacet distribution that keeps
/// its energy is; surfaces between both laws are drawn too.
Exemplar draw_recombined(Dice& dice, int observations) {
  Exemplar e;
  e.source = dice.below(observations);
  e.stretch = std::exp(0.4 * dice.normal());
  e.scale = std::exp(0.8 * dice.normal()) * std::pow(e.stretch, dice.uniform(0, 2));
  e.albedo = draw_albedo(dice);
  return e;
}

MicrofacetLobe draw_lobe(Dice& dice) {
  MicrofacetLobe lobe;
  lobe.alpha = dice.log_uniform(0.02, 0.7);
  lobe.exponent = dice.uniform() < 0.5 ? kBeckmann : dice.uniform(1.6, 2.6);
  lobe.f0 = dice.log_uniform(0.02, 0.95);
  lobe.scale = dice.uniform(0.3, 1);
  return lobe;
}

Exemplar draw_microfacet(Dice& dice) {
  Exemplar e;
  e.lobes[0] = draw_lobe(dice);
  if (dice.uniform() < 0.3) e.lobes[1] = draw_lobe(dice);
  e.albedo = draw_albedo(dice);
  return e;
}

/// Smith's lambda-free denominator of GGX for one direction (Heitz 2014).
double smith_term(double cos_theta, double alpha2) {
  return std::sqrt(alpha2 + (1 - alpha2) * cos_theta * cos_theta);
}

/// Directions with what lobes need of them.
struct LobeGeometry {
  Cosines cosine;
  double cos2_h;
  double schlick;  ///< (1 - cos theta_d)^5
};

/// Density of facet normals, 1/sr, so that its integral times cos theta_h is 1.
double distribution_of(const MicrofacetLobe& lobe, double cos2_h) {
  const double a2 = lobe.alpha * lobe.alpha;
  const double g = lobe.exponent;
  if (g == kBeckmann) {
    constexpr double kGrazing2 = 1e-6;  // of cos^2 theta_h
    const double c2 = std::max(cos2_h, kGrazing2);
    return std::exp((1 - 1 / c2) / a2) / (kPi * a2 * c2 * c2);
  }
  const double base = 1 + (a2 - 1) * cos2_h;
  const double norm = g == 2 ? a2 / kPi : (g - 1) * (a2 - 1) / (kPi * (1 - std::pow(a2, 1 - g)));
  return norm / (g == 2 ? base * base : std::pow(base, g));
}

double evaluate(const MicrofacetLobe& lobe, const LobeGeometry& at) {
  const double a2 = lobe.alpha * lobe.alpha;
  const double i = at.cosine.i;
  const double o = at.cosine.o;
  const double visibility = 0.5 / (o * smith_term(i, a2) + i * smith_term(o, a2));
  return lobe.scale * distribution_of(lobe, at.cos2_h) * visibility *
         (lobe.f0 + (1 - lobe.f0) * at.schlick);
}

std::vector<LobeGeometry> lobe_geometry(const std::vector<HalfDiff>& directions) {
  constexpr double kGrazing = 1e-3;  // a cosine; keeps the visibility term finite
  std::vector<LobeGeometry> out;
  out.reserve(directions.size());
  for (const HalfDiff& d : directions) {
    Cosines c = cosines(d);
    c.i = std::max(c.i, kGrazing);
    c.o = std::max(c.o, kGrazing);
    out.push_back({c, std::pow(std::cos(d.theta_h), 2), std::pow(1 - std::cos(d.theta_d), 5)});
  }
  return out;
}

/// f of one training observation at directions, 1/sr.
Eigen::ArrayXd observation(const BasisRows& rows, const Eigen::VectorXd& mapped) {
  Eigen::ArrayXd f(mapped.size());
  for (Index j = 0; j < f.size(); ++j)
    f[j] = from_mapped(mapped[j], rows.median[j], rows.weight[j]);
  return f;
}

Eigen::ArrayXd recombine(const Exemplar& e, const Eigen::ArrayXd& source) {
  return e.scale * (source - e.offset).max(0.0) + e.albedo / kPi;
}

/// The lobe at q theta_h; past the horizon the basis holds its nearest value.
Eigen::ArrayXd stretched_source(const Basis& basis, const Exemplar& e,
                                const std::vector<HalfDiff>& directions) {
  std::vector<HalfDiff> stretched = directions;
  for (HalfDiff& d : stretched)
    d.theta_h = std::min(d.theta_h * e.stretch, kPi / 2 * 0.999);
  return basis.reconstruct(basis.training_weights().row(e.source).transpose(), stretched).array();
}

/// Centres of one theta_h of the basis' own cells.
std::vector<HalfDiff> slab_directions(const Basis& basis, int h) {
  const BasisGrid& grid = basis.info().grid;
  std::vector<HalfDiff> out;
  for (int d = 0; d < grid.theta_d; ++d) {
    for (int p = 0; p < grid.phi_d; ++p) {
      if (basis.row_of(h, d, p)) out.push_back(grid.centre(h, d, p));
    }
  }
  return out;
}

/// Base of each training observation: a low quantile of its values clear of lobe and horizon.
std::vector<double> bases(const Basis& basis) {
  std::vector<HalfDiff> at;
  for (int h = 0; h < basis.info().grid.theta_h; ++h) {
    for (const HalfDiff& d : slab_directions(basis, h)) {
      if (d.theta_h > kBaseFrom && d.theta_h < kBaseTo &&
          cosine_weight(cosines(d)) > kBaseLeastWeight)
        at.push_back(d);
    }
  }
  const Eigen::MatrixXd& u = basis.training_weights();
  std::vector<double> out(static_cast<std::size_t>(u.rows()), 0.0);
  if (at.empty()) return out;
  const BasisRows rows = basis.rows(at);
  parallel_for_each(static_cast<int>(u.rows()), [&](int i) {
    Eigen::ArrayXd f = observation(rows, rows.q * u.row(i).transpose() + rows.mean);
    const auto n = static_cast<std::ptrdiff_t>(kBaseQuantile * static_cast<double>(f.size()));
    std::nth_element(f.begin(), f.begin() + n, f.end());
    out[static_cast<std::size_t>(i)] = f[n];
  });
  return out;
}

Eigen::MatrixXd to_mapped_rows(const BasisRows& rows, Eigen::MatrixXd f) {
  for (Index i = 0; i < f.cols(); ++i) {
    for (Index j = 0; j < f.rows(); ++j)
      f(j, i) = to_mapped(f(j, i), rows.median[j], rows.weight[j]) - rows.mean[j];
  }
  return f;
}

}  // namespace

ExemplarRecord to_record(const Exemplar& e) {
  ExemplarRecord r{static_cast<float>(e.source), static_cast<float>(e.albedo),
                   static_cast<float>(e.offset), static_cast<float>(e.scale),
                   static_cast<float>(e.stretch)};
  for (std::size_t i = 0; i < e.lobes.size(); ++i) {
    const MicrofacetLobe& lobe = e.lobes[i];
    const std::array<double, 4> values{lobe.alpha, lobe.exponent, lobe.f0, lobe.scale};
    std::transform(values.begin(), values.end(), r.begin() + static_cast<std::ptrdiff_t>(5 + 4 * i),
                   [](double v) { return static_cast<float>(v); });
  }
  return r;
}

Exemplar from_record(const ExemplarRecord& r) {
  Exemplar e{static_cast<int>(r[0]), r[1], r[2], r[3], r[4], {}};
  for (std::size_t i = 0; i < e.lobes.size(); ++i)
    e.lobes[i] = {r[5 + 4 * i], r[6 + 4 * i], r[7 + 4 * i], r[8 + 4 * i]};
  return e;
}

bool is_valid(const Exemplar& e, int observations) {
  const auto in = [](double v, double least, double most) { return v >= least && v <= most; };
  const auto lobe_in = [&in](const MicrofacetLobe& lobe) {
    return in(lobe.alpha, 1e-3, 1) && (lobe.exponent == kBeckmann || in(lobe.exponent, 1.01, 3)) &&
           in(lobe.f0, 0, 1) && in(lobe.scale, 0, 1e3);
  };
  return e.source >= -1 && e.source < observations && in(e.albedo, 0, 1) && in(e.offset, 0, 1e6) &&
         in(e.scale, 0, 1e6) && in(e.stretch, 1e-2, 1e2) && lobe_in(e.lobes[0]) &&
         lobe_in(e.lobes[1]);
}

std::vector<Exemplar> draw_exemplars(const Basis& basis, const ExemplarCounts& counts) {
  constexpr std::uint64_t kSeed = 20260101;
  Dice dice(kSeed);
  const int observations = basis.info().observations;
  std::vector<Exemplar> out;
  for (int i = 0; i < counts.recombined; ++i)
    out.push_back(draw_recombined(dice, observations));
  const std::vector<double> base = bases(basis);
  for (Exemplar& e : out)
    e.offset = base[static_cast<std::size_t>(e.source)];
  for (int i = 0; i < counts.microfacet; ++i)
    out.push_back(draw_microfacet(dice));
  // What the file holds in single precision is what weights are computed from.
  std::transform(out.begin(), out.end(), out.begin(),
                 [](const Exemplar& e) { return from_record(to_record(e)); });
  return out;
}

Eigen::MatrixXd exemplar_reflectance(const Basis& basis, const std::vector<Exemplar>& exemplars,
                                     const std::vector<HalfDiff>& directions) {
  const std::vector<LobeGeometry> geometry = lobe_geometry(directions);
  Eigen::MatrixXd f(static_cast<Index>(directions.size()), static_cast<Index>(exemplars.size()));
  parallel_for_each(static_cast<int>(exemplars.size()), [&](int i) {
    const Exemplar& e = exemplars[static_cast<std::size_t>(i)];
    if (e.source < 0) {
      for (Index j = 0; j < f.rows(); ++j) {
        const LobeGeometry& at = geometry[static_cast<std::size_t>(j)];
        f(j, i) = evaluate(e.lobes[0], at) + evaluate(e.lobes[1], at) + e.albedo / kPi;
      }
    } else {
      f.col(i) = recombine(e, stretched_source(basis, e, directions)).matrix();
    }
  });
  return f;
}

Eigen::MatrixXd project_exemplars(const Basis& basis, const std::vector<Exemplar>& exemplars) {
  Eigen::MatrixXd sums =
      Eigen::MatrixXd::Zero(basis.info().components, static_cast<Index>(exemplars.size()));
  for (int h = 0; h < basis.info().grid.theta_h; ++h) {
    const std::vector<HalfDiff> at = slab_directions(basis, h);
    if (at.empty()) continue;
    const BasisRows rows = basis.rows(at);
    sums.noalias() +=
        rows.q.transpose() * to_mapped_rows(rows, exemplar_reflectance(basis, exemplars, at));
  }
  // Columns of Q = V S are orthogonal with norms S.
  const Eigen::VectorXd scale = basis.singular_values().cwiseMax(1e-6).cwiseAbs2().cwiseInverse();
  return (scale.asDiagonal() * sums).transpose();
}

Eigen::MatrixXd example_rows(const Basis& basis, const std::vector<HalfDiff>& directions) {
  const BasisRows rows = basis.rows(directions);
  const auto exemplars = static_cast<Index>(basis.exemplars().size());
  Eigen::MatrixXd x(rows.q.rows(), exemplars + basis.info().observations);
  x.leftCols(exemplars) =
      to_mapped_rows(rows, exemplar_reflectance(basis, basis.exemplars(), directions));
  x.rightCols(basis.info().observations) = rows.q * basis.training_weights().transpose();
  return x;
}

}  // namespace brdfgate
