#include "hal/v4l2/v4l2_system.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <limits>

namespace brdfgate {
namespace {

template <typename Call>
int uninterrupted(const Call& call) {
  while (true) {
    const int result = call();
    if (result >= 0) return result;
    if (errno != EINTR) return -errno;
  }
}

class LinuxV4l2 final : public V4l2System {
 public:
  int open(const char* path) override {
    return uninterrupted([&] { return ::open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC); });
  }
  void close(int fd) override { ::close(fd); }
  int ioctl(int fd, unsigned long request, void* argument) override {
    return uninterrupted([&] { return ::ioctl(fd, request, argument); });
  }
  void* map(int fd, std::size_t bytes, std::uint32_t offset) override {
    void* at = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, offset);
    return at == MAP_FAILED ? nullptr : at;
  }
  void unmap(void* at, std::size_t bytes) override { ::munmap(at, bytes); }
  int poll(int fd, std::int64_t timeout_ns) override {
    const std::int64_t deadline = now_ns() + timeout_ns;
    pollfd asked{.fd = fd, .events = POLLIN, .revents = 0};
    const int ready = uninterrupted([&] {
      const std::int64_t left = std::max<std::int64_t>(deadline - now_ns(), 0);
      // Rounded up: a last fraction of a millisecond must not spin.
      const std::int64_t ms =
          std::min<std::int64_t>((left + 999'999) / 1'000'000, std::numeric_limits<int>::max());
      return ::poll(&asked, 1, static_cast<int>(ms));
    });
    return ready > 0 ? asked.revents : ready;
  }
  std::int64_t now_ns() override {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1'000'000'000LL + now.tv_nsec;
  }
};

}  // namespace

V4l2System& linux_v4l2() {
  static LinuxV4l2 system;
  return system;
}

}  // namespace brdfgate
