#include "model/mapped_file.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

#include "model/error.hpp"

namespace brdfgate {
namespace {

std::string system_reason() {
  return std::system_category().message(errno);
}

/// A file descriptor that closes itself.
struct Descriptor {
  explicit Descriptor(int number) : fd(number) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
  int fd;
};

}  // namespace

MappedFile::MappedFile(const std::filesystem::path& file) {
  const Descriptor descriptor(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  if (descriptor.fd < 0) throw InputError(file, "cannot open: " + system_reason());
  struct stat status{};
  if (::fstat(descriptor.fd, &status) != 0) {
    throw InputError(file, "cannot read its size: " + system_reason());
  }
  if (!S_ISREG(status.st_mode)) throw InputError(file, "is not a regular file");
  const auto size = static_cast<std::size_t>(status.st_size);
  if (size == 0) return;  // mmap refuses an empty range; an empty span says the same
  void* start = ::mmap(nullptr, size, PROT_READ, MAP_SHARED, descriptor.fd, 0);
  if (start == MAP_FAILED) throw InputError(file, "cannot map: " + system_reason());
  bytes_ = {static_cast<const std::byte*>(start), size};
}

MappedFile::~MappedFile() {
  if (!bytes_.empty()) ::munmap(const_cast<std::byte*>(bytes_.data()), bytes_.size());
}

void MappedFile::drop_pages() const {
  if (bytes_.empty()) return;
  ::madvise(const_cast<std::byte*>(bytes_.data()), bytes_.size(), MADV_DONTNEED);
}

AtomicFile::AtomicFile(std::filesystem::path file)
    : file_(std::move(file)), temporary_(file_.string() + ".part" + std::to_string(::getpid())) {
  errno = 0;
  out_.open(temporary_, std::ios::binary | std::ios::trunc);
  if (!out_) throw InputError(file_, "cannot write: " + system_reason(), "a writable folder");
}

AtomicFile::~AtomicFile() {
  if (committed_) return;
  out_.close();
  std::error_code ignored;
  std::filesystem::remove(temporary_, ignored);
}

void AtomicFile::write(std::span<const std::byte> bytes) {
  out_.write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
}

void AtomicFile::commit() {
  errno = 0;
  out_.close();
  if (out_.fail()) throw InputError(file_, "cannot write: " + system_reason(), "enough space");
  std::error_code failed;
  std::filesystem::rename(temporary_, file_, failed);
  if (failed) throw InputError(file_, "cannot write: " + failed.message());
  committed_ = true;
}

}  // namespace brdfgate
