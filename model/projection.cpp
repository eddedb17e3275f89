#include "model/projection.hpp"

namespace brdfgate {

namespace {

/// The grid's cells that comparisons count, without values.
BinnedSamples empty_cells(const BasisGrid& grid) {
  constexpr double kLeastCosine = 0.02;
  BinnedSamples samples;
  for (int h = 0; h < grid.theta_h; ++h) {
    for (int d = 0; d < grid.theta_d; ++d) {
      for (int p = 0; p < grid.phi_d; ++p) {
        Bin bin;
        bin.angles = grid.centre(h, d, p);
        if (!cosines(bin.angles).above_horizon(kLeastCosine)) continue;
        bin.id = static_cast<int>(samples.bins.size());
        bin.light = 1;
        bin.pixels = 1;
        samples.bins.push_back(bin);
      }
    }
  }
  return samples;
}

}  // namespace

BinnedSamples sample_cells(const Brdf& brdf, const BasisGrid& grid) {
  BinnedSamples samples = empty_cells(grid);
  for (Bin& bin : samples.bins)
    bin.f = brdf.eval(bin.angles);
  return samples;
}

BinnedSamples sample_cells(const Basis& basis, const Weights& weights, const BasisGrid& grid) {
  BinnedSamples samples = empty_cells(grid);
  const std::vector<HalfDiff> directions = samples.directions();
  for (Eigen::Index channel = 0; channel < 3; ++channel) {
    const Eigen::Index source = weights.c.cols() == 1 ? 0 : channel;
    const Eigen::VectorXd f = basis.reconstruct(weights.c.col(source), directions);
    for (std::size_t j = 0; j < samples.bins.size(); ++j)
      samples.bins[j].f[channel] = f[static_cast<Eigen::Index>(j)];
  }
  return samples;
}

Weights project(const Basis& basis, const Brdf& brdf) {
  constexpr double kNoRidge = 1e-6;
  return ridge(basis, sample_cells(brdf, basis.info().grid), kNoRidge);
}

}  // namespace brdfgate
