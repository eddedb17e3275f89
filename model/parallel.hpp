// Loops over all cores whose result does not depend on how many there are.
#pragma once

#include <algorithm>
#include <exception>
#include <opencv2/core/utility.hpp>
#include <vector>

namespace brdfgate {

/// Calls work(i) for i in [0, count) on OpenCV's threads. Each call must write to a place of its
/// own; then the result is the same for any number of threads. Throws what the lowest i threw, so
/// that an error is the same one too.
template <typename Work>
void parallel_for_each(int count, Work&& work) {
  std::vector<std::exception_ptr> errors(static_cast<std::size_t>(count));
  cv::parallel_for_(cv::Range(0, count), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) {
      try {
        work(i);
      } catch (...) {
        errors[static_cast<std::size_t>(i)] = std::current_exception();
      }
    }
  });
  for (const std::exception_ptr& error : errors) {
    if (error) std::rethrow_exception(error);
  }
}

/// The same in blocks of at most `size`: work(first, length). The partition depends on `count` and
/// `size` alone.
template <typename Work>
void parallel_for_blocks(int count, int size, Work&& work) {
  parallel_for_each((count + size - 1) / size, [&](int block) {
    const int first = block * size;
    work(first, std::min(size, count - first));
  });
}

}  // namespace brdfgate
