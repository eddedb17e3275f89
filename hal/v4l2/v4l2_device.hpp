// An open V4L2 device: descriptor, format, mapped buffers, stream. Knows no bracket.
#pragma once

#include <linux/videodev2.h>

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "hal/camera.hpp"
#include "hal/camera_settings.hpp"
#include "hal/v4l2/v4l2_system.hpp"

namespace brdfgate {

/// A descriptor and the name of what it opens. Every failure is a CameraError that names it, the
/// call and the system's reason; a device that went away is CameraFault::absent.
class V4l2Node {
 public:
  V4l2Node(V4l2System& system, std::string path);
  V4l2Node(const V4l2Node&) = delete;
  V4l2Node& operator=(const V4l2Node&) = delete;
  ~V4l2Node() { system_.close(fd_); }

  /// 0 or more, or minus errno.
  int try_ioctl(unsigned long request, void* argument) const;
  void ioctl(unsigned long request, const char* name, void* argument) const;
  [[noreturn]] void fail(int error, const char* call, CameraFault fault) const;
  [[noreturn]] void fail(const std::string& what, const char* call, CameraFault fault) const;

  int fd() const { return fd_; }
  V4l2System& system() const { return system_; }
  const std::string& path() const { return path_; }

 private:
  V4l2System& system_;
  std::string path_;
  int fd_;
};

/// One filled buffer, dequeued: give it back with requeue() before the next one is needed.
struct V4l2Frame {
  std::uint32_t index = 0;
  std::span<const std::uint8_t> bytes;  ///< as far as the driver filled it
  std::uint64_t sequence = 0;           ///< widened over the driver's 32 bits
  std::int64_t timestamp_ns = 0;
  std::uint32_t flags = 0;  ///< V4L2_BUF_FLAG_...
  bool damaged = false;     ///< the driver says that the contents are not sound
};

/// Construction opens the device, checks that it captures and streams, and sets the format; the
/// device must take it exactly. Destruction stops, unmaps, frees and closes.
class V4l2Device {
 public:
  V4l2Device(V4l2System& system, const CameraDeviceSettings& settings, const SensorFormat& sensor);
  V4l2Device(const V4l2Device&) = delete;
  V4l2Device& operator=(const V4l2Device&) = delete;
  ~V4l2Device();

  const V4l2Node& node() const { return node_; }
  std::size_t stride() const { return stride_; }
  /// The driver's frame period, s; 0: it says none.
  double frame_period_s() const { return frame_period_s_; }

  bool streaming() const { return streaming_; }
  /// Allocates, maps and queues the buffers where there are none, and starts.
  void start();
  void stop() noexcept;
  /// A filled buffer, waiting up to `timeout_ns` for one; nothing when time passed.
  std::optional<V4l2Frame> wait(std::int64_t timeout_ns);
  void requeue(const V4l2Frame& frame);
  /// Gives back, unseen, what was filled before now.
  void flush();
  /// Throws when the device is gone.
  void check_alive() const;

 private:
  struct Mapping {
    void* at = nullptr;
    std::size_t bytes = 0;
  };

  void check_capabilities() const;
  void set_format(const RawFormat& format, const SensorFormat& sensor);
  void set_frame_interval(double interval_s);
  void allocate();
  void free_buffers() noexcept;
  void queue(std::uint32_t index);
  std::optional<V4l2Frame> dequeue();

  V4l2Node node_;
  int wanted_buffers_;
  std::size_t stride_ = 0;
  double frame_period_s_ = 0;
  bool streaming_ = false;
  std::vector<Mapping> buffers_;
  std::uint64_t last_sequence_ = 0;
};

}  // namespace brdfgate
