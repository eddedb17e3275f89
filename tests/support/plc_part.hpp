// A judged part with every published value different, for packing and handshake tests.
#pragma once

#include "model/verdict.hpp"

namespace brdfgate::test {

/// `k` weights of `channels` channels; weight i of channel c of cluster n is n + c + (i + 1) / 16,
/// which a float holds exactly.
inline ClusterResult scripted_cluster(int n, int k = 12, int channels = 3) {
  ClusterResult c;
  c.index = n;
  c.name = "material " + std::to_string(n);
  c.present = true;
  c.pixels = 16 * (1000 + n) + 7;
  c.area_share = 0.125;
  c.valid = {true, true, true, true, true};
  c.channels = channels;
  c.weights = Eigen::MatrixXd(k, channels);
  for (int channel = 0; channel < channels; ++channel) {
    for (int i = 0; i < k; ++i)
      c.weights(i, channel) = n + channel + (i + 1) / 16.0;
  }
  c.weight_sigmas = Eigen::MatrixXd::Constant(k, channels, 0.25);
  c.deviation = {2.5 + n, 10, 0.75 + n, 3};
  c.gloss_gu = {20.5 + n, 60.5 + n, 85.5 + n};
  c.lab = Lab(50.5 + n, -3.25, 7.75);
  c.delta_e00 = 0.5;
  return c;
}

inline PartResult scripted_part(Verdict verdict, int clusters = 2) {
  PartResult part;
  part.verdict = verdict;
  if (verdict == Verdict::reject) part.reason_bits = bit(Reason::t2) | bit(Reason::gloss);
  if (verdict == Verdict::not_judged) part.reason_bits = bit(Reason::tilt);
  part.t2_ratio = 0.875;
  part.spe_ratio = 0.625;
  part.worst_cluster = 1;
  part.tilt_deg = {0.25, -0.5};
  part.ambient = 0.0078125;
  part.defects.resize(verdict == Verdict::reject ? 3 : 0);
  for (int n = 0; n < clusters; ++n)
    part.clusters.push_back(scripted_cluster(n));
  return part;
}

}  // namespace brdfgate::test
