#include <set>

#include "catch.hpp"
#include "hal/raw_formats.hpp"

using namespace brdfgate;

namespace {

/// One row of bytes and the counts that a person worked out for them.
struct Row {
  const char* format;
  std::vector<std::uint8_t> bytes;
  std::vector<int> counts;
};

std::vector<int> unpacked(const Row& row, int shift = 0) {
  const RawFormat& format = *find_raw_format(row.format);
  const RawImage image{row.bytes, row.bytes.size(), static_cast<int>(row.counts.size()), 1};
  REQUIRE(is_complete(format, image));
  const cv::Mat counts = unpack(format, image, shift);
  return {counts.begin<std::uint16_t>(), counts.end<std::uint16_t>()};
}

}  // namespace

TEST_CASE("Raw rows are unpacked as the format says") {
  const auto row = GENERATE(values<Row>({
      {"GREY", {0x00, 0x7f, 0xff}, {0, 127, 255}},
      {"RGB24", {1, 2, 3, 4, 5, 6}, {2, 5}},
      {"Y10", {0x34, 0x02, 0xff, 0x03}, {0x234, 1023}},
      {"Y12", {0xbc, 0x0a}, {0xabc}},
      {"Y16", {0x01, 0x80, 0xff, 0xff}, {0x8001, 65535}},
      // Low pairs 0b00, 0b01, 0b10, 0b11 of pixels 0 to 3: 11 10 01 00.
      {"Y10P", {0x00, 0x01, 0x80, 0xff, 0b11100100}, {0, 5, 514, 1023}},
      {"SRGGB10P", {0xff, 0x00, 0x00, 0x00, 0b00000011}, {1023, 0, 0, 0}},
      {"SRGGB10P", {0x00, 0x00, 0x00, 0x80, 0b01000000}, {0, 0, 0, 513}},
      // Low nibbles: 0xb of pixel 0 in the low half, 0x4 of pixel 1 in the high half.
      {"Y12P", {0xaa, 0x12, 0x4b}, {0xaab, 0x124}},
      {"SBGGR12P", {0xff, 0x00, 0x0f, 0x00, 0xff, 0xf0}, {4095, 0, 0, 4095}},
      // A last group that the image's width does not fill.
      {"Y10P", {0x40, 0x41, 0, 0, 0b00001001}, {257, 262}},
  }));
  CAPTURE(row.format, row.bytes);
  CHECK(unpacked(row) == row.counts);
}

TEST_CASE("Counts at a word's high end are shifted down") {
  CHECK(unpacked({"Y16", {0xc0, 0xff, 0x40, 0x00}, {0, 0}}, 6) == std::vector<int>{1023, 1});
}

TEST_CASE("Rows follow one another by the stride, and the last one needs no padding") {
  const std::vector<std::uint8_t> bytes{1, 2, 99, 3, 4};
  const RawFormat& grey = *find_raw_format("GREY");
  const RawImage image{bytes, 3, 2, 2};
  REQUIRE(is_complete(grey, image));
  const cv::Mat expected = (cv::Mat_<std::uint16_t>(2, 2) << 1, 2, 3, 4);
  CHECK(cv::countNonZero(unpack(grey, image) != expected) == 0);
  CHECK_FALSE(is_complete(grey, {std::span(bytes).first(4), 3, 2, 2}));
  CHECK_FALSE(is_complete(grey, {bytes, 1, 2, 2}));
  CHECK_FALSE(is_complete(grey, {{}, 2, 2, 0}));
}

TEST_CASE("Every format is found by each of its names, and no name means two") {
  std::set<std::string_view> fourccs;
  for (const RawFormat& format : raw_formats()) {
    CAPTURE(format.name);
    CHECK(find_raw_format(format.name) == &format);
    CHECK(find_raw_format(format.fourcc) == &format);
    CHECK(find_raw_format(format.libcamera) == &format);
    CHECK(fourccs.insert(format.fourcc).second);
    CHECK(fourcc_text(format.v4l2_code()) == format.fourcc);
  }
  CHECK(find_raw_format("MJPG") == nullptr);
  CHECK(find_raw_format("") == nullptr);
  CHECK(find_raw_format("SRGGB10P")->v4l2_code() == 0x41415270);  // 'p' 'R' 'A' 'A'
}
