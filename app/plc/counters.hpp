// The station's counters, kept over restarts.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace brdfgate {

struct Counters {
  std::uint32_t inspected = 0;
  std::uint32_t passed = 0;
  std::uint32_t rejected = 0;
  std::uint32_t not_judged = 0;
  std::uint32_t missed_triggers = 0;
  std::uint32_t faults = 0;
  std::uint32_t restarts = 0;
  std::uint32_t clients_refused = 0;
  std::uint32_t last_result_id = 0;  ///< of the last completed result

  bool operator==(const Counters&) const = default;
};

/// counters.json in the state directory, with a checksum over its numbers. Each store replaces the
/// file atomically (written beside, fsync, renamed, directory fsync): a power cut leaves the old or
/// the new one. Not for the inspection's thread: an SD card takes its time.
class CounterFile {
 public:
  /// Creates the directory when it is missing; reads the file when there is one. A file that cannot
  /// be understood is put aside as counters.json.damaged, the counters begin at zero and warning()
  /// says so. Counts one more restart, skips result ids that a crash may have kept from being
  /// stored, and stores that. Throws InputError when the directory cannot be written.
  explicit CounterFile(const std::filesystem::path& state_dir);

  /// As read, with this start counted.
  const Counters& at_start() const { return stored_; }
  const std::string& warning() const { return warning_; }

  /// Writes when something changed. Throws InputError when that fails (disk full); the next call
  /// tries again.
  void store(const Counters& counters);

 private:
  std::filesystem::path file_;
  Counters stored_;
  std::string warning_;
};

/// Results that may be published between two stores; after a start result ids go on this far beyond
/// the last one stored, so that none is ever used twice.
inline constexpr std::uint32_t kResultIdGap = 1000;

}  // namespace brdfgate
