#include "config/png_file.hpp"

#include <array>
#include <cstring>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "config/yaml_reader.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

using Bytes = std::span<const unsigned char>;

constexpr std::uintmax_t kMaxFileBytes = std::uintmax_t{1} << 30;
constexpr std::array<unsigned char, 8> kSignature{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
constexpr std::size_t kChunkFrame = 12;  ///< length, type and checksum around the data

std::uint32_t big_endian(Bytes bytes) {
  return std::uint32_t{bytes[0]} << 24 | std::uint32_t{bytes[1]} << 16 |
         std::uint32_t{bytes[2]} << 8 | std::uint32_t{bytes[3]};
}

/// Slicing by eight (Kounavis and Berry 2005): table k holds the remainder of a byte followed by k
/// zero bytes, so that eight bytes take eight independent lookups.
using CrcTables = std::array<std::array<std::uint32_t, 256>, 8>;

CrcTables make_crc_tables() {
  CrcTables tables{};
  for (std::uint32_t n = 0; n < 256; ++n) {
    std::uint32_t c = n;
    for (int k = 0; k < 8; ++k)
      c = (c & 1u) != 0 ? 0xedb88320u ^ (c >> 1) : c >> 1;
    tables[0][n] = c;
  }
  for (std::size_t k = 1; k < tables.size(); ++k) {
    for (std::size_t n = 0; n < 256; ++n) {
      const std::uint32_t before = tables[k - 1][n];
      tables[k][n] = tables[0][before & 0xffu] ^ (before >> 8);
    }
  }
  return tables;
}

/// The chunks in turn, each with its length and checksum verified.
class ChunkWalk {
 public:
  ChunkWalk(Bytes file, std::string name) : rest_(file.subspan(8)), name_(std::move(name)) {}

  struct Chunk {
    std::string type;
    Bytes data;
  };

  Chunk next() {
    if (rest_.size() < kChunkFrame) fail_cut();
    const std::size_t length = big_endian(rest_);
    if (length > rest_.size() - kChunkFrame) fail_cut();
    const Bytes typed = rest_.subspan(4, length + 4);
    Chunk chunk{{typed.begin(), typed.begin() + 4}, typed.subspan(4)};
    if (crc32(typed) != big_endian(rest_.subspan(length + 8))) {
      throw InputError(name_, "PNG chunk " + shown(chunk.type) + " has a wrong checksum",
                       "an undamaged file");
    }
    rest_ = rest_.subspan(length + kChunkFrame);
    return chunk;
  }

 private:
  [[noreturn]] void fail_cut() const {
    throw InputError(name_, "PNG is cut short", "a whole file");
  }

  Bytes rest_;
  std::string name_;
};

std::string size_text(std::uint64_t width, std::uint64_t height) {
  return std::to_string(width) + " x " + std::to_string(height) + " pixels";
}

void check_header(Bytes header, const std::string& name, const PngExpectation& expected) {
  if (header.size() != 13) throw InputError(name, "PNG header of a wrong length");
  const std::uint32_t width = big_endian(header);
  const std::uint32_t height = big_endian(header.subspan(4));
  const auto side = static_cast<std::uint32_t>(expected.max_side);
  const bool wrong_size =
      !expected.size.empty() && (width != static_cast<std::uint32_t>(expected.size.width) ||
                                 height != static_cast<std::uint32_t>(expected.size.height));
  if (wrong_size) {
    throw InputError(name, size_text(width, height),
                     size_text(static_cast<std::uint64_t>(expected.size.width),
                               static_cast<std::uint64_t>(expected.size.height)));
  }
  if (width == 0 || height == 0 || width > side || height > side) {
    throw InputError(name, size_text(width, height), "1 to " + std::to_string(side) + " a side");
  }
  constexpr unsigned char kGray = 0;
  if (header[8] != expected.bits || header[9] != kGray) {
    throw InputError(name,
                     std::to_string(header[8]) + " bits, colour type " + std::to_string(header[9]),
                     std::to_string(expected.bits) + " bits, one grey channel (colour type 0)");
  }
}

/// Everything but the pixels: libpng reports damage on stderr, which is the caller's to write.
void check_structure(Bytes file, const std::string& name, const PngExpectation& expected) {
  if (file.size() < kSignature.size() ||
      std::memcmp(file.data(), kSignature.data(), kSignature.size()) != 0) {
    throw InputError(name, "not a PNG file", "a PNG file");
  }
  ChunkWalk walk(file, name);
  const ChunkWalk::Chunk header = walk.next();
  if (header.type != "IHDR") throw InputError(name, "PNG without a header", "IHDR first");
  check_header(header.data, name, expected);
  bool pixels = false;
  for (std::string type; type != "IEND";) {
    type = walk.next().type;
    // Transparency would turn the grey channel into four.
    if (type == "tRNS") throw InputError(name, "PNG with transparency", "one grey channel");
    pixels = pixels || type == "IDAT";
  }
  if (!pixels) throw InputError(name, "PNG without pixels", "an IDAT chunk");
}

}  // namespace

std::uint32_t crc32(Bytes bytes) {
  static const CrcTables kTables = make_crc_tables();
  std::uint32_t crc = 0xffffffffu;
  std::size_t i = 0;
  for (; i + 8 <= bytes.size(); i += 8) {
    const unsigned char* b = bytes.data() + i;
    crc ^= std::uint32_t{b[0]} | std::uint32_t{b[1]} << 8 | std::uint32_t{b[2]} << 16 |
           std::uint32_t{b[3]} << 24;
    crc = kTables[7][crc & 0xffu] ^ kTables[6][crc >> 8 & 0xffu] ^ kTables[5][crc >> 16 & 0xffu] ^
          kTables[4][crc >> 24] ^ kTables[3][b[4]] ^ kTables[2][b[5]] ^ kTables[1][b[6]] ^
          kTables[0][b[7]];
  }
  for (; i < bytes.size(); ++i)
    crc = kTables[0][(crc ^ bytes[i]) & 0xffu] ^ (crc >> 8);
  return crc ^ 0xffffffffu;
}

cv::Mat read_gray_png(const std::filesystem::path& file, const PngExpectation& expected) {
  std::string bytes = read_bytes(file, kMaxFileBytes);
  const Bytes view(reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
  check_structure(view, file.string(), expected);
  const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8UC1, bytes.data());
  cv::Mat image;
  try {
    image = cv::imdecode(encoded, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    throw InputError(file.string(), "PNG does not decode: " + error.err);
  }
  if (image.empty()) throw InputError(file.string(), "PNG does not decode", "an undamaged file");
  if (image.type() != (expected.bits == 16 ? CV_16UC1 : CV_8UC1)) {
    throw InputError(file.string(), "PNG decodes to another format", "one grey channel");
  }
  return image;
}

void write_gray_png(const std::filesystem::path& file, const cv::Mat& image) {
  std::vector<unsigned char> bytes;
  try {
    // Raw frames are noise: higher levels take many times as long for a few percent.
    cv::imencode(".png", image, bytes, {cv::IMWRITE_PNG_COMPRESSION, 1});
  } catch (const cv::Exception& error) {
    throw InputError(file.string(), "cannot be encoded: " + error.err);
  }
  std::ofstream out(file, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (!out) throw InputError(file.string(), "cannot be written", "a writable folder with space");
}

}  // namespace brdfgate
