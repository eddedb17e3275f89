#include "hal/raw_formats.hpp"

#include <algorithm>
#include <array>

namespace brdfgate {
namespace {

using enum RawPacking;

constexpr std::array<RawFormat, 31> kFormats{{
    {"GREY", "GREY", "R8", Mosaic::mono, 8, bytes},
    {"Y10", "Y10 ", "R10", Mosaic::mono, 10, words},
    {"Y10P", "Y10P", "R10_CSI2P", Mosaic::mono, 10, csi2p10},
    {"Y12", "Y12 ", "R12", Mosaic::mono, 12, words},
    {"Y12P", "Y12P", "R12_CSI2P", Mosaic::mono, 12, csi2p12},
    {"Y16", "Y16 ", "R16", Mosaic::mono, 16, words},
    {"RGB24", "RGB3", "BGR888", Mosaic::mono, 8, green_of_rgb},
    {"SRGGB8", "RGGB", "SRGGB8", Mosaic::rggb, 8, bytes},
    {"SBGGR8", "BA81", "SBGGR8", Mosaic::bggr, 8, bytes},
    {"SGRBG8", "GRBG", "SGRBG8", Mosaic::grbg, 8, bytes},
    {"SGBRG8", "GBRG", "SGBRG8", Mosaic::gbrg, 8, bytes},
    {"SRGGB10", "RG10", "SRGGB10", Mosaic::rggb, 10, words},
    {"SBGGR10", "BG10", "SBGGR10", Mosaic::bggr, 10, words},
    {"SGRBG10", "BA10", "SGRBG10", Mosaic::grbg, 10, words},
    {"SGBRG10", "GB10", "SGBRG10", Mosaic::gbrg, 10, words},
    {"SRGGB10P", "pRAA", "SRGGB10_CSI2P", Mosaic::rggb, 10, csi2p10},
    {"SBGGR10P", "pBAA", "SBGGR10_CSI2P", Mosaic::bggr, 10, csi2p10},
    {"SGRBG10P", "pgAA", "SGRBG10_CSI2P", Mosaic::grbg, 10, csi2p10},
    {"SGBRG10P", "pGAA", "SGBRG10_CSI2P", Mosaic::gbrg, 10, csi2p10},
    {"SRGGB12", "RG12", "SRGGB12", Mosaic::rggb, 12, words},
    {"SBGGR12", "BG12", "SBGGR12", Mosaic::bggr, 12, words},
    {"SGRBG12", "BA12", "SGRBG12", Mosaic::grbg, 12, words},
    {"SGBRG12", "GB12", "SGBRG12", Mosaic::gbrg, 12, words},
    {"SRGGB12P", "pRCC", "SRGGB12_CSI2P", Mosaic::rggb, 12, csi2p12},
    {"SBGGR12P", "pBCC", "SBGGR12_CSI2P", Mosaic::bggr, 12, csi2p12},
    {"SGRBG12P", "pgCC", "SGRBG12_CSI2P", Mosaic::grbg, 12, csi2p12},
    {"SGBRG12P", "pGCC", "SGBRG12_CSI2P", Mosaic::gbrg, 12, csi2p12},
    {"SRGGB16", "RG16", "SRGGB16", Mosaic::rggb, 16, words},
    {"SBGGR16", "BYR2", "SBGGR16", Mosaic::bggr, 16, words},
    {"SGRBG16", "GR16", "SGRBG16", Mosaic::grbg, 16, words},
    {"SGBRG16", "GB16", "SGBRG16", Mosaic::gbrg, 16, words},
}};

void unpack_bytes(const std::uint8_t* in, std::uint16_t* out, int width) {
  std::copy(in, in + width, out);
}

void unpack_words(const std::uint8_t* in, std::uint16_t* out, int width) {
  for (int x = 0; x < width; ++x, in += 2)
    out[x] = static_cast<std::uint16_t>(in[0] | in[1] << 8);
}

void unpack_green(const std::uint8_t* in, std::uint16_t* out, int width) {
  for (int x = 0; x < width; ++x, in += 3)
    out[x] = in[1];
}

/// `Group` pixels: their high bytes, then one byte with `Bits` - 8 low bits of each.
template <int Group, int Bits>
void unpack_csi2p(const std::uint8_t* in, std::uint16_t* out, int width) {
  constexpr int kLow = Bits - 8;
  constexpr int kMask = (1 << kLow) - 1;
  for (int x = 0; x < width; x += Group, in += Group + 1) {
    for (int i = 0; i < std::min(Group, width - x); ++i)
      out[x + i] = static_cast<std::uint16_t>(in[i] << kLow | (in[Group] >> (kLow * i) & kMask));
  }
}

using UnpackRow = void (*)(const std::uint8_t*, std::uint16_t*, int);

UnpackRow row_function(RawPacking packing) {
  switch (packing) {
    case bytes:
      return unpack_bytes;
    case words:
      return unpack_words;
    case green_of_rgb:
      return unpack_green;
    case csi2p10:
      return unpack_csi2p<4, 10>;
    case csi2p12:
      return unpack_csi2p<2, 12>;
  }
  return nullptr;
}

std::size_t groups(int width, int of) {
  return static_cast<std::size_t>((width + of - 1) / of);
}

}  // namespace

std::uint32_t RawFormat::v4l2_code() const {
  std::uint32_t code = 0;
  for (std::size_t i = 0; i < 4; ++i)
    code |= static_cast<std::uint32_t>(static_cast<unsigned char>(fourcc[i])) << (8 * i);
  return code;
}

std::size_t RawFormat::row_bytes(int width) const {
  switch (packing) {
    case bytes:
      return static_cast<std::size_t>(width);
    case words:
      return 2 * static_cast<std::size_t>(width);
    case green_of_rgb:
      return 3 * static_cast<std::size_t>(width);
    case csi2p10:
      return 5 * groups(width, 4);
    case csi2p12:
      return 3 * groups(width, 2);
  }
  return 0;
}

std::span<const RawFormat> raw_formats() {
  return kFormats;
}

const RawFormat* find_raw_format(std::string_view name) {
  const auto named = [&](const RawFormat& format) {
    return name == format.name || name == format.fourcc || name == format.libcamera;
  };
  const auto* const found = std::find_if(kFormats.begin(), kFormats.end(), named);
  return found == kFormats.end() ? nullptr : found;
}

std::string fourcc_text(std::uint32_t code) {
  std::string text;
  for (int i = 0; i < 4; ++i) {
    const auto c = static_cast<unsigned char>(code >> (8 * i) & 0x7f);
    text += c >= 0x20 && c < 0x7f ? static_cast<char>(c) : '?';
  }
  return text;
}

bool is_complete(const RawFormat& format, const RawImage& image) {
  const std::size_t row_bytes = format.row_bytes(image.width);
  const auto rows = static_cast<std::size_t>(image.height);
  return rows > 0 && image.stride >= row_bytes &&
         image.bytes.size() >= image.stride * (rows - 1) + row_bytes;
}

cv::Mat unpack(const RawFormat& format, const RawImage& image, int shift_right) {
  cv::Mat counts(image.height, image.width, CV_16UC1);
  const UnpackRow unpack_row = row_function(format.packing);
  for (int y = 0; y < image.height; ++y) {
    unpack_row(image.bytes.data() + static_cast<std::size_t>(y) * image.stride,
               counts.ptr<std::uint16_t>(y), image.width);
  }
  if (shift_right > 0) {
    counts.forEach<std::uint16_t>([shift_right](std::uint16_t& count, const int*) {
      count = static_cast<std::uint16_t>(count >> shift_right);
    });
  }
  return counts;
}

}  // namespace brdfgate
