// A made-up camera behind libcamera's requests, on its own clock: nothing waits. A request's
// settings reach the sensor when its turn comes and take effect some frames later; the metadata say
// what was in effect.
#pragma once

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <map>
#include <vector>

#include "hal/libcamera/request_device.hpp"
#include "support/fake_v4l2.hpp"

namespace brdfgate::test {

/// The sensor: it lives on while the device is closed and opened.
struct FakeRequestSensor {
  FakeSensor sensor;
  bool present = true;
  bool out_of_memory = false;
  bool exposure_sticks = false;  ///< reported truthfully: never what was asked
  bool reports = true;           ///< false: no metadata
  double line_s = 20e-6;
  std::function<FakeFault(std::uint32_t frame)> fault = [](std::uint32_t) { return FakeFault{}; };
  std::function<void(std::uint32_t frame)> at_frame = [](std::uint32_t) {};
  std::int64_t now = 1'000'000'000'000;
  std::uint32_t frame = 0;
  int open = 0;
  int requests_queued = 0;

  double applied_s(double asked) const {
    return std::max(1.0, std::round(asked / line_s)) * line_s;
  }
};

class FakeRequests final : public RequestDevice {
 public:
  explicit FakeRequests(FakeRequestSensor& world) : world_(world) {
    if (!world.present) throw CameraError(CameraFault::absent, "fake", "find", "no camera");
    if (world.out_of_memory) {
      throw CameraError(CameraFault::out_of_memory, "fake", "allocate", "no memory");
    }
    ++world_.open;
    buffers_.resize(4);
  }
  ~FakeRequests() override { --world_.open; }

  std::optional<RequestRange> exposure_range_s() const override { return RequestRange{20e-6, 0.2}; }
  std::optional<RequestRange> gain_range() const override { return RequestRange{1, 16}; }
  std::optional<RequestRange> frame_duration_range_s() const override {
    return RequestRange{world_.sensor.interval_s, 1};
  }
  std::size_t slots() const override { return buffers_.size(); }
  std::size_t stride() const override {
    return world_.sensor.format->row_bytes(world_.sensor.width) + world_.sensor.padding;
  }
  void start() override {
    effects_ = {RequestSettings{0.01, 1, world_.sensor.interval_s}};
    effects_.resize(static_cast<std::size_t>(world_.sensor.latency_frames) + 1, effects_.front());
    world_.frame = 0;
  }
  void stop() noexcept override { queued_.clear(); }
  void queue(std::size_t slot, const RequestSettings& settings) override {
    ++world_.requests_queued;
    queued_.push_back({slot, settings});
  }
  void check_alive() override {
    if (!world_.present) throw CameraError(CameraFault::absent, "fake", "alive", "gone");
  }
  std::int64_t now_ns() override { return world_.now += 1000; }

  std::optional<CompletedRequest> wait(std::int64_t timeout_ns) override {
    const std::int64_t deadline = world_.now + timeout_ns;
    while (world_.present && !queued_.empty()) {
      const double needed = effects_.front().frame_duration_s;
      if (world_.now + std::llround(1e9 * needed) > deadline) break;
      if (auto done = run_frame()) return done;
    }
    if (!world_.present && !queued_.empty()) {
      const Queued next = queued_.front();
      queued_.pop_front();
      CompletedRequest cancelled;
      cancelled.slot = next.slot;
      cancelled.cancelled = true;
      return cancelled;
    }
    world_.now = std::max(world_.now, deadline);
    return std::nullopt;
  }

 private:
  struct Queued {
    std::size_t slot = 0;
    RequestSettings settings;
  };

  /// One frame of the sensor with the request whose turn it is; nothing when it was lost.
  std::optional<CompletedRequest> run_frame() {
    const Queued next = queued_.front();
    effects_.push_back(next.settings);
    effects_.pop_front();
    const RequestSettings now = effects_.front();
    const double exposure_s = world_.exposure_sticks ? 0.01 : world_.applied_s(now.exposure_s);
    const FakeFault fault = world_.fault(world_.frame);
    const std::int64_t begin = world_.now;
    const double late = fault.kind == FakeFault::late ? fault.late_s : 0;
    world_.now += std::llround(1e9 * (std::max(now.frame_duration_s, exposure_s) + late));
    const std::uint32_t number = world_.frame++;
    world_.at_frame(world_.frame);
    if (fault.kind == FakeFault::dropped) return std::nullopt;
    queued_.pop_front();
    CompletedRequest done = last_;
    if (fault.kind != FakeFault::repeated) {
      done.sequence = number;
      done.timestamp_ns = begin + std::llround(1e9 * exposure_s) + world_.sensor.stamp_offset_ns;
      if (world_.reports) done.exposure_s = exposure_s;
      if (world_.reports) done.gain = now.gain;
      last_ = done;
    }
    done.slot = next.slot;
    done.damaged = fault.kind == FakeFault::damaged;
    fill(next.slot, exposure_s * now.gain, number);
    done.bytes = buffers_[next.slot];
    if (fault.kind == FakeFault::truncated) done.bytes = done.bytes.first(done.bytes.size() / 2);
    return done;
  }
  void fill(std::size_t slot, double dose_s, std::uint32_t number) {
    const FakeSensor& s = world_.sensor;
    const int top = (1 << s.format->bits) - 1;
    const int count = s.black + static_cast<int>(std::lround(s.counts_per_s * dose_s)) +
                      (s.noise > 0 ? static_cast<int>(number % 2) : 0);
    const auto row = packed_row(
        *s.format, std::vector<int>(static_cast<std::size_t>(s.width), std::min(count, top)));
    std::vector<std::uint8_t>& bytes = buffers_[slot];
    bytes.assign(stride() * static_cast<std::size_t>(s.height), 0);
    for (int y = 0; y < s.height; ++y)
      std::copy(
          row.begin(), row.end(),
          bytes.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(y) * stride()));
  }

  FakeRequestSensor& world_;
  std::vector<std::vector<std::uint8_t>> buffers_;
  std::deque<Queued> queued_;
  std::deque<RequestSettings> effects_;  ///< the first is in effect
  CompletedRequest last_;
};

}  // namespace brdfgate::test
