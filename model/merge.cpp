#include "model/merge.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "model/error.hpp"
#include "model/saturation.hpp"

namespace brdfgate {
namespace {

/// Weights from the signal-free start, then from the estimate: the third changes nothing that can
/// be measured (method.md: bias under 0.06 %).
constexpr int kIterations = 3;

static_assert(kMergeBlock % (2 * kDitherPeriod) == 0, "the dither must repeat within a block");
static_assert(kDitherPeriod == std::tuple_size_v<decltype(MergePlan::Exposure::saturated_from)>);

std::string frame_name(std::size_t index) {
  return "frame " + std::to_string(index);
}

void check_frame(const SensorFormat& sensor, const RawFrame& frame, std::size_t index) {
  if (frame.counts.type() != CV_16UC1) {
    throw InputError(frame_name(index), "counts of type " + cv::typeToString(frame.counts.type()),
                     "CV_16UC1");
  }
  if (frame.counts.cols != sensor.width || frame.counts.rows != sensor.height) {
    throw InputError(
        frame_name(index),
        std::to_string(frame.counts.cols) + " x " + std::to_string(frame.counts.rows) + " pixels",
        std::to_string(sensor.width) + " x " + std::to_string(sensor.height));
  }
  if (!(frame.exposure_s > 0) || !std::isfinite(frame.exposure_s)) {
    throw InputError(frame_name(index), "exposure " + std::to_string(frame.exposure_s) + " s",
                     "over 0");
  }
  if (!(frame.gain > 0) || !std::isfinite(frame.gain)) {
    throw InputError(frame_name(index), "analogue gain " + std::to_string(frame.gain), "over 0");
  }
}

/// One step of the iteration: sums of w z / t and of w at the present estimate.
struct WeightedSums {
  MergeLane signal, weight;
};

void add_exposure(const MergeLane& signal, const MergeLane& time, const MergeLane& divisor,
                  WeightedSums& sums) {
  const MergeLane share = divisor.inverse();
  sums.signal += signal * share;
  sums.weight += time * share;
}

/// Counts of one block in contiguous memory; a row's last, shorter block is filled up with zeros.
const std::uint16_t* block_counts(const std::uint16_t* row, int count, CountLane& padded) {
  if (count == kMergeBlock) return row;
  padded.fill(0);
  std::copy_n(row, count, padded.begin());
  return padded.data();
}

/// Signal and time of one exposure, both 0 where saturated.
void load(const MergePlan::Exposure& exposure, float black, const CountLane& saturated_from,
          const std::uint16_t* counts, MergeLane& signal, MergeLane& time) {
  for (int i = 0; i < kMergeBlock; ++i) {
    const float good = counts[i] < saturated_from[i] ? 1.0F : 0.0F;
    signal[i] = good * exposure.per_gain * (static_cast<float>(counts[i]) - black);
    time[i] = good * exposure.exposure_s;
  }
}

/// The shortest exposure always counts: where it is saturated it is the lower bound.
void load_shortest(const MergePlan::Exposure& exposure, float black,
                   const CountLane& saturated_from, const std::uint16_t* counts,
                   MergeScratch& scratch, std::uint8_t* clipped) {
  for (int i = 0; i < kMergeBlock; ++i) {
    scratch.signal[0][i] = exposure.per_gain * (static_cast<float>(counts[i]) - black);
    clipped[i] = counts[i] < saturated_from[i] ? 0 : 1;
  }
  scratch.time[0].setConstant(exposure.exposure_s);
}

/// x = sum q s / sum q t with q_j = 1 / (g x + k_j), from the scratch's signals and times.
WeightedSums solve(const MergePlan& plan, const MergeScratch& scratch, std::size_t used) {
  WeightedSums sums{scratch.signal[0], scratch.time[0]};  // photon noise alone: all weigh alike
  for (std::size_t j = 1; j < used; ++j) {
    sums.signal += scratch.signal[j];
    sums.weight += scratch.time[j];
  }
  for (int step = 0; step < kIterations; ++step) {
    const MergeLane shot = plan.gain_dn_per_e * (sums.signal / sums.weight).max(0.0F);
    sums.signal.setZero();
    sums.weight.setZero();
    for (std::size_t j = 0; j < used; ++j) {
      add_exposure(scratch.signal[j], scratch.time[j], shot + scratch.k[j], sums);
    }
  }
  return sums;
}

void merge_block(const MergePlan& plan, int y, int x0, MergeScratch& scratch, MergedRow& out) {
  const int count = std::min(kMergeBlock, plan.sensor.width - x0);
  const int cell_row = plan.sensor.mosaic == Mosaic::mono ? y : y / 2;
  const float black = static_cast<float>(plan.sensor.black_level_dn);
  CountLane padded;
  std::size_t used = 0;
  for (const MergePlan::Exposure& exposure : plan.exposures) {
    const std::uint16_t* counts =
        block_counts(exposure.counts->ptr<std::uint16_t>(y) + x0, count, padded);
    const CountLane& cut = exposure.saturated_from[cell_row % kDitherPeriod];
    if (used == 0) {
      load_shortest(exposure, black, cut, counts, scratch, out.clipped.data() + x0);
    } else {
      load(exposure, black, cut, counts, scratch.signal[used], scratch.time[used]);
      if (!(scratch.time[used].maxCoeff() > 0)) continue;  // saturated in the whole block
    }
    scratch.k[used++] = exposure.k;
  }
  const WeightedSums sums = solve(plan, scratch, used);
  Eigen::Map<MergeLane>(out.value.data() + x0) = sums.signal / sums.weight;
  Eigen::Map<MergeLane>(out.variance.data() + x0) = sums.weight.inverse();
}

void merge_row(const MergePlan& plan, int y, MergeScratch& scratch, MergedRow& out) {
  for (int x0 = 0; x0 < plan.sensor.width; x0 += kMergeBlock)
    merge_block(plan, y, x0, scratch, out);
}

/// EMVA 1288's absolute sensitivity threshold: signal-to-noise ratio 1.
bool under_noise_floor(float value, float variance) {
  return !(value > 0 && value * value >= variance);
}

void store_mono(const MergedRow& row, int v, Radiance& out) {
  const int width = out.value.cols;
  std::copy_n(row.value.begin(), width, out.value.ptr<float>(v));
  std::copy_n(row.variance.begin(), width, out.variance.ptr<float>(v));
  auto* mask = out.mask.ptr<unsigned char>(v);
  for (int u = 0; u < width; ++u) {
    mask[u] = static_cast<unsigned char>(
        (row.clipped[u] ? kClipped : 0) |
        (under_noise_floor(row.value[u], row.variance[u]) ? kNoiseFloor : 0));
  }
}

/// Column of a colour within its row of the 2x2 cell, and which of the two rows.
struct CellPlan {
  int red_row = 0, red_column = 0;
};

CellPlan cell_plan(Mosaic mosaic) {
  switch (mosaic) {
    case Mosaic::bggr:
      return {1, 1};
    case Mosaic::grbg:
      return {0, 1};
    case Mosaic::gbrg:
      return {1, 0};
    default:
      return {0, 0};
  }
}

/// Red and one green lie in one sensor row, blue (diagonal to red) and the other green in the
/// other; the greens are averaged.
void store_cells(const CellPlan& plan, const std::array<MergedRow, 2>& rows, int v, Radiance& out) {
  const MergedRow& a = rows[plan.red_row];
  const MergedRow& b = rows[1 - plan.red_row];
  auto* value = out.value.ptr<float>(v);
  auto* variance = out.variance.ptr<float>(v);
  auto* mask = out.mask.ptr<unsigned char>(v);
  for (int u = 0; u < out.value.cols; ++u) {
    const int red = 2 * u + plan.red_column;       // in row a; in row b a green
    const int blue = 2 * u + 1 - plan.red_column;  // in row b; in row a a green
    const std::array<float, 3> x{a.value[red], 0.5F * (a.value[blue] + b.value[red]),
                                 b.value[blue]};
    const std::array<float, 3> s{a.variance[red], 0.25F * (a.variance[blue] + b.variance[red]),
                                 b.variance[blue]};
    const bool clipped = (a.clipped[red] | a.clipped[blue] | b.clipped[red] | b.clipped[blue]) != 0;
    bool dark = false;
    for (int c = 0; c < 3; ++c) {
      value[3 * u + c] = x[c];
      variance[3 * u + c] = s[c];
      dark |= under_noise_floor(x[c], s[c]);
    }
    mask[u] = static_cast<unsigned char>((clipped ? kClipped : 0) | (dark ? kNoiseFloor : 0));
  }
}

MergePlan::Exposure exposure_plan(const SensorFormat& sensor, const SensorNoise& noise,
                                  const RawFrame& frame, bool spread) {
  MergePlan::Exposure out;
  const double read_variance = std::pow(noise.read_noise_dn * frame.gain, 2) + 1.0 / 12.0;
  out.counts = &frame.counts;
  out.exposure_s = static_cast<float>(frame.exposure_s);
  out.per_gain = static_cast<float>(1 / frame.gain);
  out.k = static_cast<float>(read_variance / (frame.exposure_s * frame.gain * frame.gain));
  const SaturationRule rule(sensor, noise, frame.gain, spread);
  const int side = sensor.mosaic == Mosaic::mono ? 1 : 2;
  for (int v = 0; v < kDitherPeriod; ++v) {
    for (int i = 0; i < kMergeBlock; ++i) {
      out.saturated_from[v][i] = static_cast<std::uint16_t>(
          std::clamp(rule.first_saturated_dn(i / side % kDitherPeriod, v), 0, 65535));
    }
  }
  return out;
}

}  // namespace

void check_bracket(const SensorFormat& sensor, const SensorNoise& noise,
                   const std::vector<RawFrame>& frames) {
  if (frames.empty()) throw InputError("bracket", "no frame", "at least one exposure");
  if (!(noise.gain_dn_per_e > 0)) {
    throw InputError("sensor noise", "gain " + std::to_string(noise.gain_dn_per_e) + " DN/e",
                     "over 0");
  }
  for (std::size_t i = 0; i < frames.size(); ++i)
    check_frame(sensor, frames[i], i);
}

MergePlan::MergePlan(const SensorFormat& format, const SensorNoise& noise,
                     const std::vector<RawFrame>& frames)
    : sensor(format), gain_dn_per_e(static_cast<float>(noise.gain_dn_per_e)) {
  std::vector<const RawFrame*> order;
  order.reserve(frames.size());
  for (const RawFrame& frame : frames)
    order.push_back(&frame);
  const auto light = [](const RawFrame* frame) { return frame->exposure_s * frame->gain; };
  std::stable_sort(order.begin(), order.end(),
                   [&](auto* a, auto* b) { return light(a) < light(b); });
  for (const RawFrame* frame : order) {
    const bool spread = light(frame) > 1.01 * light(order.front());
    exposures.push_back(exposure_plan(sensor, noise, *frame, spread));
  }
}

MergeScratch::MergeScratch(const MergePlan& plan)
    : signal(plan.exposures.size()), time(plan.exposures.size()), k(plan.exposures.size()) {
  const int padded = (plan.sensor.width + kMergeBlock - 1) / kMergeBlock * kMergeBlock;
  for (MergedRow& row : rows) {
    row.value.resize(padded);
    row.variance.resize(padded);
    row.clipped.resize(padded);
  }
}

void merge_cell_row(const MergePlan& plan, int v, MergeScratch& scratch, Radiance& out) {
  if (plan.sensor.mosaic == Mosaic::mono) {
    merge_row(plan, v, scratch, scratch.rows[0]);
    store_mono(scratch.rows[0], v, out);
    return;
  }
  merge_row(plan, 2 * v, scratch, scratch.rows[0]);
  merge_row(plan, 2 * v + 1, scratch, scratch.rows[1]);
  store_cells(cell_plan(plan.sensor.mosaic), scratch.rows, v, out);
}

}  // namespace brdfgate
