// The clock of the frames' timestamps.
#pragma once

#include <chrono>
#include <cstdint>

namespace brdfgate {

/// ns of CLOCK_MONOTONIC, which std::chrono::steady_clock is on Linux.
inline std::int64_t monotonic_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

}  // namespace brdfgate
