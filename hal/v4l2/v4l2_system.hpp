// The kernel calls that the V4L2 backend makes, thin enough for a made-up driver to stand in.
#pragma once

#include <cstddef>
#include <cstdint>

namespace brdfgate {

class V4l2System {
 public:
  V4l2System() = default;
  V4l2System(const V4l2System&) = delete;
  V4l2System& operator=(const V4l2System&) = delete;
  virtual ~V4l2System() = default;

  // A descriptor, 0 or a count; minus errno on failure. Interrupted calls are made again.
  virtual int open(const char* path) = 0;  ///< read and write, not blocking, closed on exec
  virtual void close(int fd) = 0;
  virtual int ioctl(int fd, unsigned long request, void* argument) = 0;
  /// nullptr on failure.
  virtual void* map(int fd, std::size_t bytes, std::uint32_t offset) = 0;
  virtual void unmap(void* at, std::size_t bytes) = 0;
  /// poll(2) for POLLIN: the events that came, 0 when `timeout_ns` passed.
  virtual int poll(int fd, std::int64_t timeout_ns) = 0;
  /// CLOCK_MONOTONIC, ns.
  virtual std::int64_t now_ns() = 0;
};

/// The kernel's.
V4l2System& linux_v4l2();

}  // namespace brdfgate
