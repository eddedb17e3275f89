#include "app/plc/result_blocks.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

namespace brdfgate {
namespace {

void write_readings(RegisterImage& image, const ClusterResult& cluster) {
  const int c = cluster.index;
  constexpr std::array<const char*, 3> kGloss{"cluster.gloss_20", "cluster.gloss_60",
                                              "cluster.gloss_85"};
  for (std::size_t i = 0; i < kGloss.size() && cluster.valid.gloss; ++i) {
    image.put_real(kGloss[i], cluster.gloss_gu[i], c);
  }
  if (!cluster.valid.colour) return;
  image.put_real("cluster.lightness", cluster.lab[0], c);
  image.put_real("cluster.a_star", cluster.lab[1], c);
  image.put_real("cluster.b_star", cluster.lab[2], c);
  image.put_real("cluster.delta_e00", cluster.delta_e00, c);
}

/// The first eight components of every channel.
Eigen::MatrixXd published(const Eigen::MatrixXd& all) {
  return all.topLeftCorner(std::min<Eigen::Index>(all.rows(), kPublishedWeights),
                           std::min<Eigen::Index>(all.cols(), kPublishedChannels));
}

void write_weights(RegisterImage& image, const ClusterResult& cluster) {
  if (!cluster.valid.weights) return;
  const Eigen::MatrixXd weights = published(cluster.weights);
  for (Eigen::Index channel = 0; channel < weights.cols(); ++channel) {
    for (Eigen::Index i = 0; i < weights.rows(); ++i) {
      image.put_real("cluster.weights", weights(i, channel), cluster.index,
                     static_cast<int>(channel * kPublishedWeights + i));
    }
  }
  const Eigen::MatrixXd sigmas = published(cluster.weight_sigmas);
  if (sigmas.size() == 0) return;
  const double mean_square = sigmas.squaredNorm() / static_cast<double>(sigmas.size());
  image.put_real("cluster.weight_uncertainty", std::sqrt(mean_square), cluster.index);
}

std::uint16_t valid_bits(const ClusterResult& cluster) {
  std::uint16_t bits = 0;
  const auto set = [&bits](bool on, std::uint16_t bit) {
    if (on) bits |= bit;
  };
  set(cluster.present, valid_bit::kPresent);
  set(cluster.valid.weights, valid_bit::kWeights);
  set(cluster.valid.highlight, valid_bit::kHighlight);
  set(cluster.valid.gloss, valid_bit::kGloss);
  set(cluster.valid.colour, valid_bit::kColour);
  set(cluster.valid.measured, valid_bit::kMeasured);
  return bits;
}

void write_cluster(RegisterImage& image, const ClusterResult& cluster) {
  const int c = cluster.index;
  if (c < 0 || c >= image.map().instances("cluster")) return;
  image.put("cluster.valid_bits", valid_bits(cluster), c);
  image.put("cluster.pixels_16", static_cast<std::uint64_t>(std::max(0, cluster.pixels)) / 16, c);
  image.put_real("cluster.area_share", cluster.area_share, c);
  image.put_real("cluster.t2", cluster.deviation.t2, c);
  image.put_real("cluster.spe", cluster.deviation.spe, c);
  write_readings(image, cluster);
  write_weights(image, cluster);
}

}  // namespace

void clear_result(RegisterImage& image) {
  std::ranges::fill(image.words(image.map().block("result")), std::uint16_t{0});
  for (int c = 0; c < image.map().instances("cluster"); ++c) {
    std::ranges::fill(image.words(image.map().block("cluster", c)), std::uint16_t{0});
  }
}

void write_head(RegisterImage& image, const ResultHead& head) {
  image.put("result.seq_head", head.sequence);
  image.put("result.seq_tail", head.sequence);
  image.put("result.trigger_id", head.trigger_id);
  image.put("result.result_id", head.result_id);
  image.put("result.result_state", static_cast<std::uint16_t>(head.state));
  image.put("result.acquisition_ms", head.acquisition_ms);
  image.put("result.processing_ms", head.processing_ms);
  image.put("result.cycle_ms", head.cycle_ms);
  for (int c = 0; c < image.map().instances("cluster"); ++c) {
    image.put("cluster.seq_head", head.sequence, c);
    image.put("cluster.seq_tail", head.sequence, c);
  }
}

void write_part(RegisterImage& image, const PartResult& part, Verdict verdict) {
  image.put("result.verdict", static_cast<std::uint16_t>(verdict));
  image.put("result.reason_bits", part.reason_bits);
  image.put("result.worst_cluster", static_cast<std::uint64_t>(std::max(0, part.worst_cluster)));
  image.put_real("result.t2_ratio", part.t2_ratio);
  image.put_real("result.spe_ratio", part.spe_ratio);
  image.put_real("result.tilt_x_deg", part.tilt_deg[0]);
  image.put_real("result.tilt_y_deg", part.tilt_deg[1]);
  image.put_real("result.ambient", part.ambient);
  image.put("result.defects", part.defects.size());
  for (const ClusterResult& cluster : part.clusters)
    write_cluster(image, cluster);
}

void swap_in(const RegisterImage& from, RegisterImage& to) {
  const auto copy = [&](const RegisterRange& range) {
    std::ranges::copy(from.words(range), to.words(range).begin());
  };
  copy(to.map().block("result"));
  for (int c = 0; c < to.map().instances("cluster"); ++c)
    copy(to.map().block("cluster", c));
}

Verdict publishable_verdict(const PartResult& part) {
  const bool contradicts = part.verdict == Verdict::pass && part.reason_bits != 0;
  return part.verdict == Verdict::none || contradicts ? Verdict::not_judged : part.verdict;
}

}  // namespace brdfgate
