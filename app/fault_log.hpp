// Faults in the log: once per class with a count, so that a broken cable does not fill a disk.
#pragma once

#include <spdlog/spdlog.h>

#include <cstdint>
#include <map>
#include <string>

namespace brdfgate {

/// Logs a fault class when it is first seen and again at every doubling of its count.
class FaultLog {
 public:
  /// Returns how often this class has been seen, this time included.
  std::uint64_t report(const std::string& fault_class, const std::string& text) {
    const std::uint64_t count = ++counts_[fault_class];
    if ((count & (count - 1)) == 0) {
      spdlog::error("{}: {} (seen {} time(s))", fault_class, text, count);
    }
    return count;
  }

 private:
  std::map<std::string, std::uint64_t> counts_;
};

}  // namespace brdfgate
