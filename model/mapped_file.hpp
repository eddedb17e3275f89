// Files read by mapping them, and files written all or nothing.
#pragma once

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <span>

namespace brdfgate {

/// A whole file mapped read-only for the life of the object. Thread-safe.
class MappedFile {
 public:
  /// Throws InputError naming the file and the system's reason.
  explicit MappedFile(const std::filesystem::path& file);
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  ~MappedFile();

  std::span<const std::byte> bytes() const { return bytes_; }
  /// Gives the pages back; they are read again (from the page cache, as a rule) when touched.
  void drop_pages() const;

 private:
  std::span<const std::byte> bytes_;
};

/// Bytes that become `file` at commit(), by a rename; without it nothing of them stays.
class AtomicFile {
 public:
  /// Throws InputError where the folder cannot be written.
  explicit AtomicFile(std::filesystem::path file);
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  ~AtomicFile();

  void write(std::span<const std::byte> bytes);
  /// Throws InputError where not every byte reached the disk (full, quota).
  void commit();

 private:
  std::filesystem::path file_;
  std::filesystem::path temporary_;
  std::ofstream out_;
  bool committed_ = false;
};

}  // namespace brdfgate
