// A basis trained on the spot from analytic materials: small, quick, and good enough to estimate
// with.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "model/analytic.hpp"
#include "model/basis_training.hpp"
#include "support/temp_dir.hpp"

namespace brdfgate::test {

/// Lambertian materials and GGX lobes from polished to matt, coloured so that channels differ.
inline std::vector<NamedBrdf> small_training_set() {
  std::vector<NamedBrdf> set;
  int number = 0;
  const auto name = [&] { return "material-" + std::to_string(number++); };
  for (const double albedo : {0.05, 0.3, 0.8}) {
    set.push_back({name(), make_brdf(LambertParameters{Rgb(albedo, 0.7 * albedo, 0.3 * albedo)})});
  }
  for (const double alpha : {0.03, 0.1, 0.3}) {
    for (const double f0 : {0.04, 0.5}) {
      GgxParameters p;
      p.diffuse = Rgb(0.02, 0.1, 0.4) * (1 - f0);
      p.f0 = Rgb(f0, 0.9 * f0, 0.8 * f0);
      p.alpha = alpha;
      set.push_back({name(), make_brdf(p)});
    }
  }
  return set;
}

inline TrainingOptions small_training_options(int components = 12) {
  TrainingOptions options;
  options.grid = {24, 12, 12};
  options.components = components;
  options.licence = "none: made by a test";
  options.attribution = "analytic models";
  return options;
}

/// Trained in a folder of its own, which is gone at once: the mapping outlives the file's name.
inline std::shared_ptr<const Basis> small_basis(int components = 12) {
  const TempDir dir;
  train_basis(small_training_set(), small_training_options(components), dir / "small.basis");
  return Basis::open(dir / "small.basis");
}

}  // namespace brdfgate::test
