#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "catch.hpp"
#include "config/png_file.hpp"
#include "support/input_error.hpp"
#include "support/shipped.hpp"
#include "support/temp_dir.hpp"

using brdfgate::crc32;
using brdfgate::PngExpectation;
using brdfgate::read_gray_png;
using brdfgate::write_gray_png;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::read_text_file;
using brdfgate::test::TempDir;

namespace {

std::uint32_t crc_of(const std::string& text) {
  return crc32({reinterpret_cast<const unsigned char*>(text.data()), text.size()});
}

std::string word(std::uint32_t value) {
  std::string out;
  for (int shift = 24; shift >= 0; shift -= 8)
    out += static_cast<char>(value >> shift);
  return out;
}

std::string chunk(const std::string& type, const std::string& data) {
  return word(static_cast<std::uint32_t>(data.size())) + type + data + word(crc_of(type + data));
}

std::string header(std::uint32_t width, std::uint32_t height, char bits, char colour) {
  return chunk("IHDR", word(width) + word(height) + bits + colour + std::string(3, '\0'));
}

const std::string kSignature = "\x89PNG\r\n\x1a\n";

}  // namespace

TEST_CASE("The checksum is that of the published check values") {
  CHECK(crc_of("123456789") == 0xcbf43926u);  // the catalogue's check value of CRC-32/ISO-HDLC
  CHECK(crc_of("IEND") == 0xae426082u);       // the last four bytes of every PNG file
  CHECK(crc_of("") == 0u);
}

TEST_CASE("A grey image of either depth survives the file") {
  const TempDir dir;
  for (const int type : {CV_8UC1, CV_16UC1}) {
    cv::Mat image(37, 53, type);
    cv::RNG(3).fill(image, cv::RNG::UNIFORM, 0, type == CV_8UC1 ? 256 : 65536);
    write_gray_png(dir / "a.png", image);
    PngExpectation expected;
    expected.bits = type == CV_8UC1 ? 8 : 16;
    const cv::Mat read = read_gray_png(dir / "a.png", expected);
    REQUIRE(read.type() == type);
    CHECK(cv::countNonZero(read != image) == 0);
  }
}

TEST_CASE("A file that is no sound grey PNG is refused by name and cause") {
  const TempDir dir;
  const std::string end = chunk("IEND", "");
  const std::string head = header(2, 1, 8, 0);
  const std::string pixels = chunk("IDAT", "no zlib stream");
  const auto [bytes, what] = GENERATE_COPY(table<std::string, std::string>({
      {"GIF89a..............", "not a PNG file"},
      {kSignature, "PNG is cut short"},
      {kSignature + end, "PNG without a header"},
      {kSignature + chunk("IHDR", "short") + end, "PNG header of a wrong length"},
      {kSignature + header(0, 1, 8, 0) + end, "0 x 1 pixels; expected 1 to 16384 a side"},
      {kSignature + header(16385, 1, 8, 0) + end, "16385 x 1 pixels"},
      {kSignature + header(0xffffffff, 0xffffffff, 8, 0) + end, "4294967295 x 4294967295 pixels"},
      {kSignature + header(2, 1, 8, 3) + end, "8 bits, colour type 3; expected 8 bits, one grey"},
      {kSignature + header(2, 1, 1, 0) + end, "1 bits, colour type 0"},
      {kSignature + head + end, "PNG without pixels"},
      {kSignature + head + chunk("tRNS", "ab") + pixels + end, "PNG with transparency"},
      {kSignature + head + pixels, "PNG is cut short"},
      {kSignature + head + word(0xffffffff) + "IDAT", "PNG is cut short"},
      {kSignature + head + pixels + end, "PNG does not decode"},
  }));
  const auto file = dir.write("a.png", bytes);
  const std::string message = input_error([&] { return read_gray_png(file, {}).rows; });
  CAPTURE(message, what);
  CHECK(contains(message, file.string() + ": " + what));
}

TEST_CASE("A folder that takes no file is named") {
  const TempDir dir;
  const cv::Mat image(2, 2, CV_8UC1, cv::Scalar(0));
  CHECK(contains(input_error([&] {
                   write_gray_png(dir / "none/a.png", image);
                   return 0;
                 }),
                 "none/a.png: cannot be written"));
}
