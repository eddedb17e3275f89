// Raw pixel formats: their names, and their bytes unpacked into counts.
//
// Sources: the kernel's "Image Formats" pages (userspace-api/media/v4l: pixfmt-bayer, pixfmt-yuv-
// luma, pixfmt-srggb10p, pixfmt-srggb12p) and MIPI CSI-2's RAW10 and RAW12 packing, which the
// formats ending in P and libcamera's _CSI2P keep. Words are little-endian.
#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <span>
#include <string>
#include <string_view>

#include "model/frame.hpp"

namespace brdfgate {

/// How pixels lie in a row.
enum class RawPacking {
  bytes,         ///< one byte a pixel
  words,         ///< one 16-bit word a pixel, the count in its low bits
  csi2p10,       ///< 4 pixels in 5 bytes: the 8 high bits of each, then the low pairs, first pixel
                 ///< lowest
  green_of_rgb,  ///< 3 bytes a pixel, the middle one taken
  csi2p12,  ///< 2 pixels in 3 bytes: the 8 high bits of each, then the low nibbles, first lowest
};

/// Every name is a null-terminated literal.
struct RawFormat {
  std::string_view name;       ///< the kernel's, without V4L2_PIX_FMT_: SRGGB10P
  std::string_view fourcc;     ///< V4L2's four characters: pRAA
  std::string_view libcamera;  ///< libcamera's name: SRGGB10_CSI2P
  Mosaic mosaic = Mosaic::mono;
  int bits = 0;  ///< of a count as stored
  RawPacking packing = RawPacking::bytes;

  /// V4L2's pixelformat.
  std::uint32_t v4l2_code() const;
  /// Bytes of `width` pixels without padding; a packed group is never split.
  std::size_t row_bytes(int width) const;
};

/// All formats. RGB24 is none of a sensor: the green channel of a camera that gives no raw frames
/// (libcamera's vimc, a webcam), to try the rest of a station with and not to measure.
std::span<const RawFormat> raw_formats();
/// By any of its three names; nullptr: unknown.
const RawFormat* find_raw_format(std::string_view name);
/// The four characters of a V4L2 pixelformat, for messages.
std::string fourcc_text(std::uint32_t code);

/// One image as it lies in memory.
struct RawImage {
  std::span<const std::uint8_t> bytes;
  std::size_t stride = 0;  ///< bytes from row to row, at least the format's row_bytes
  int width = 0;
  int height = 0;
};

/// Enough bytes for its rows; the last one needs no padding.
bool is_complete(const RawFormat& format, const RawImage& image);

/// CV_16UC1, height x width. `shift_right`: bits dropped at the low end, for counts aligned to the
/// high end of a word. Precondition: is_complete().
cv::Mat unpack(const RawFormat& format, const RawImage& image, int shift_right = 0);

}  // namespace brdfgate
