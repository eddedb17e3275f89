// Single-channel PNG files from outside, checked before anything decodes them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <span>

namespace brdfgate {

/// What a file must be.
struct PngExpectation {
  int bits = 8;          ///< 8 or 16
  cv::Size size;         ///< empty: any
  int max_side = 16384;  ///< pixels
};

/// CV_8UC1 or CV_16UC1. Throws InputError naming the file: not a PNG, another size, depth or colour
/// type, cut short, a chunk whose checksum is wrong (ISO/IEC 15948), pixels that do not decode. The
/// size is checked before memory is taken for it.
cv::Mat read_gray_png(const std::filesystem::path& file, const PngExpectation& expected);

/// CV_8UC1 or CV_16UC1, fast compression. Throws InputError where it cannot write.
void write_gray_png(const std::filesystem::path& file, const cv::Mat& image);

/// CRC-32 of ISO 3309 and ISO/IEC 15948 annex D.
std::uint32_t crc32(std::span<const unsigned char> bytes);

}  // namespace brdfgate
