// What the libcamera backend needs of libcamera, thin enough for made-up requests to stand in:
// buffers in slots, queued with settings, coming back with what the sensor reports of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>

namespace brdfgate {

struct RequestSettings {
  double exposure_s = 0;
  double gain = 1;
  double frame_duration_s = 0;  ///< not shorter, and not longer than it must be
};

/// A slot's buffer, filled; valid until the slot is queued again.
struct CompletedRequest {
  std::size_t slot = 0;
  bool cancelled = false;  ///< the camera stopped, or went away
  bool damaged = false;
  std::uint64_t sequence = 0;
  std::int64_t timestamp_ns = 0;     ///< CLOCK_MONOTONIC
  std::optional<double> exposure_s;  ///< as the sensor reports it; none: it reports nothing
  std::optional<double> gain;        ///< likewise, analogue
  std::span<const std::uint8_t> bytes;
};

struct RequestRange {
  double least = 0;
  double most = 0;
};

/// An open, configured camera. Construction and every call throw CameraError; destruction releases
/// it.
class RequestDevice {
 public:
  RequestDevice() = default;
  RequestDevice(const RequestDevice&) = delete;
  RequestDevice& operator=(const RequestDevice&) = delete;
  virtual ~RequestDevice() = default;

  /// Nothing where the camera has no such control.
  virtual std::optional<RequestRange> exposure_range_s() const = 0;
  virtual std::optional<RequestRange> gain_range() const = 0;
  virtual std::optional<RequestRange> frame_duration_range_s() const = 0;
  virtual std::size_t slots() const = 0;
  virtual std::size_t stride() const = 0;
  virtual void start() = 0;
  /// Every queued slot is free afterwards.
  virtual void stop() noexcept = 0;
  virtual void queue(std::size_t slot, const RequestSettings& settings) = 0;
  /// The next one to complete; nothing when `timeout_ns` passed.
  virtual std::optional<CompletedRequest> wait(std::int64_t timeout_ns) = 0;
  virtual void check_alive() = 0;
  virtual std::int64_t now_ns() = 0;  ///< CLOCK_MONOTONIC
};

using OpenRequestDevice = std::function<std::unique_ptr<RequestDevice>()>;

}  // namespace brdfgate
