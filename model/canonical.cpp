#include "model/canonical.hpp"

#include <cmath>
#include <map>

#include "model/error.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

Bin empty_bin(const BinFrame& frame, std::size_t i) {
  Bin bin;
  bin.id = frame.id[i];
  bin.light = frame.light[i];
  bin.angles = frame.directions[i];
  return bin;
}

}  // namespace

BinFrame frame_of(const BinnedSamples& samples) {
  BinFrame frame;
  for (const Bin& bin : samples.bins) {
    frame.id.push_back(bin.id);
    frame.light.push_back(bin.light);
    frame.directions.push_back(bin.angles);
  }
  return frame;
}

BinnedSamples onto_frame(const Basis& basis, const BinnedSamples& samples, const Weights& w,
                         const BinFrame& frame) {
  check_samples(samples);
  if (frame.id.empty()) throw InputError("bin frame", "no bins", "at least one");
  std::map<int, Index> seen;
  for (const Bin& bin : samples.bins)
    seen.emplace(bin.id, static_cast<Index>(seen.size()));
  const BasisRows from = basis.rows(samples.directions());
  const BasisRows to = basis.rows(frame.directions);
  const Eigen::MatrixXd unexplained = centred(samples, from) - from.q * w.c;
  const Eigen::MatrixXd explained = to.q * w.c;
  BinnedSamples out;
  out.channels = samples.channels;
  for (std::size_t i = 0; i < frame.id.size(); ++i) {
    Bin bin = empty_bin(frame, i);
    const auto j = static_cast<Index>(i);
    const auto found = seen.find(frame.id[i]);
    for (Index channel = 0; channel < out.channels; ++channel) {
      const double rest = found == seen.end() ? 0 : unexplained(found->second, channel);
      bin.f[channel] =
          from_mapped(explained(j, channel) + rest + to.mean[j], to.median[j], to.weight[j]);
    }
    if (found != seen.end()) {
      const Bin& source = samples.bins[static_cast<std::size_t>(found->second)];
      bin.pixels = source.pixels;
      for (Index channel = 0; channel < out.channels; ++channel) {
        const double ratio = source.f[channel] > 0 ? bin.f[channel] / source.f[channel] : 1;
        bin.variance[channel] = source.variance[channel] * ratio * ratio;
      }
    }
    out.bins.push_back(bin);
  }
  return out;
}

}  // namespace brdfgate
