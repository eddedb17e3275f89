#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <random>

#include "app/recording.hpp"
#include "catch.hpp"
#include "config/png_file.hpp"
#include "support/input_error.hpp"
#include "support/mutate.hpp"
#include "support/shipped.hpp"
#include "support/temp_dir.hpp"

using brdfgate::find_recordings;
using brdfgate::read_recording;
using brdfgate::Recording;
using brdfgate::RecordingRole;
using brdfgate::write_recording;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::place_of;
using brdfgate::test::read_text_file;
using brdfgate::test::replaced;
using brdfgate::test::TempDir;
namespace fs = std::filesystem;

namespace {

/// Three frames of noise, 12 x 8 pixels, with exposures that decimals do not hold exactly.
Recording example() {
  Recording recording;
  recording.role = RecordingRole::white;
  recording.station_hash = std::string(64, 'a');
  recording.capture.sensor = {12, 8, 10, brdfgate::Mosaic::gbrg, 60.5, 1023};
  cv::RNG random(5);
  for (int light = 0; light < 3; ++light) {
    brdfgate::RawFrame frame;
    frame.counts.create(8, 12, CV_16UC1);
    random.fill(frame.counts, cv::RNG::UNIFORM, 0, 1024);
    frame.light = light;
    frame.exposure_s = 14.8e-6 * (1 + light) / 3.0;
    frame.gain = 1.0 + light / 7.0;
    frame.timestamp_ns = 1'700'000'000'123'456'789 + light;
    recording.capture.frames.push_back(frame);
  }
  return recording;
}

bool same(const cv::Mat& a, const cv::Mat& b) {
  return a.type() == b.type() && a.size() == b.size() && cv::countNonZero(a != b) == 0;
}

void cut(const fs::path& file, std::uintmax_t bytes) {
  fs::resize_file(file, bytes);
}

void flip(const fs::path& file, std::size_t at) {
  std::string bytes = read_text_file(file);
  bytes.at(at) = static_cast<char>(bytes.at(at) ^ 1);
  std::ofstream(file, std::ios::binary) << bytes;
}

}  // namespace

TEST_CASE("A recording reads back as it was written, to the last bit") {
  const TempDir dir;
  const auto role = static_cast<RecordingRole>(GENERATE(range(0, 7)));
  Recording written = example();
  written.role = role;
  written.calibration_hash = role == RecordingRole::part ? std::string(64, '1') : "";
  write_recording(dir / "deep/er/part_0001/", written);
  const Recording read = read_recording(dir / "deep/er/part_0001/");
  CHECK(read.name == "part_0001");
  CHECK(read.role == role);
  CHECK(read.station_hash == written.station_hash);
  CHECK(read.calibration_hash == written.calibration_hash);
  CHECK(read.capture.sensor == written.capture.sensor);
  REQUIRE(read.capture.frames.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto& a = read.capture.frames[i];
    const auto& b = written.capture.frames[i];
    CHECK(same(a.counts, b.counts));
    CHECK(a.light == b.light);
    CHECK(a.exposure_s == b.exposure_s);
    CHECK(a.gain == b.gain);
    CHECK(a.timestamp_ns == b.timestamp_ns);
  }
  CHECK(std::distance(fs::directory_iterator(dir / "deep/er"), {}) == 1);
}

TEST_CASE("On disk the lights count from 0 and the ambient frame has none") {
  const TempDir dir;
  write_recording(dir / "r", example());
  const std::string text = read_text_file(dir / "r/recording.yaml");
  CHECK(contains(text, "{file: 000_none.png, light: none,"));
  CHECK(contains(text, "{file: 001_light0.png, light: 0,"));
  CHECK(contains(text, "{file: 002_light1.png, light: 1,"));
  CHECK(contains(text, "schema: brdfgate.recording/1"));
  CHECK(contains(text, "black_level: 60.5"));
}

TEST_CASE("A malformed index is refused at its place with its path") {
  struct Bad {
    std::string from, to, value, path, what;
  };
  const auto bad = GENERATE(values<Bad>({
      {"recording/1", "recording/2", "brdfgate.recording/2", "schema",
       "expected brdfgate.recording/1"},
      {"role: white", "role: whte", "whte", "role", "did you mean 'white'?"},
      {"role: white", "role: white\nrole: part", "role: part", "", "duplicate key 'role'"},
      {"role: white", "role: white\nnote: x", "note", "note", "unknown key"},
      {"width: 12", "width: 1", "1,", "sensor.width", "2..16384"},
      {"width: 12", "width: 14", "000_none.png", "frames[0].file",
       "000_none.png: 12 x 8 pixels; expected 14 x 8 pixels"},
      {"bits: 10", "bits: 17", "17", "sensor.bits", "8..16"},
      {"black_level: 60.5", "black_level: 1023", "1023, f", "sensor.black_level", "below full"},
      {"full_well_dn: 1023", "full_well_dn: 1024", "1024", "sensor.full_well_dn", "at most 1023"},
      {"light: 0", "light: 2", "2, exp", "frames[1].light", "one of none, 0, 1"},
      {"file: 000_none.png", "file: ../000_none.png", "../0", "frames[0].file",
       "inside the recording's folder"},
      {"file: 000_none.png", "file: a/../../r/000_none.png", "a/..", "frames[0].file",
       "inside the recording's folder"},
      {"file: 000_none.png", "file: /etc/passwd", "/etc", "frames[0].file",
       "inside the recording's folder"},
      {"file: 000_none.png", "file: ''", "''", "frames[0].file", "inside the recording's folder"},
      {"file: 000_none.png", "file: .", ".,", "frames[0].file", "not a regular file"},
      {"file: 000_none.png", "file: none.png", "none.png", "frames[0].file",
       "none.png: no such file"},
      {"file: 000_none.png", "file: recording.yaml", "recording.yaml", "frames[0].file",
       "not a PNG file"},
      {"gain: 1,", "gain: 0,", "0, t", "frames[0].gain", "above 0"},
      {"timestamp_ns: 1700000000123456789", "timestamp_ns: 1.5", "1.5", "frames[0].timestamp_ns",
       "no whole number"},
      {"light: none, ", "", "{file: 000", "frames[0].light", "missing"},
      {"exposure_s: ", "exposure_s: -", "-", "frames[0].exposure_s", "above 0"},
      {"exposure_s: ", "exposure_ms: ", "{file: 000", "frames[0].exposure_s",
       "is 'exposure_ms' in line"},
  }));
  const TempDir dir;
  write_recording(dir / "r", example());
  const std::string text = replaced(read_text_file(dir / "r/recording.yaml"), bad.from, bad.to);
  const fs::path index = dir.write("r/recording.yaml", text);
  const std::string message = input_error([&] { return read_recording(dir / "r"); });
  std::size_t at = text.find(bad.value, bad.to.empty() ? 0 : text.find(bad.to));
  if (at == std::string::npos) at = text.find(bad.value);
  const std::string path = bad.path.empty() ? ": " : " (" + bad.path + "): ";
  CAPTURE(text, message);
  CHECK(contains(message, index.string() + ":" + place_of(text, at) + path));
  CHECK(contains(message, bad.what));
}

TEST_CASE("A recording without frames is refused when read and when written") {
  const TempDir dir;
  write_recording(dir / "r", example());
  const std::string text = read_text_file(dir / "r/recording.yaml");
  dir.write("r/recording.yaml", text.substr(0, text.find("frames:")) + "frames: []\n");
  CHECK(contains(input_error([&] { return read_recording(dir / "r"); }), "(frames): 0 frames"));
  Recording none = example();
  none.capture.frames.clear();
  CHECK(contains(input_error([&] {
                   write_recording(dir / "s", none);
                   return 0;
                 }),
                 "no frames"));
}

TEST_CASE("A hostile frame file is refused by its name and cause") {
  const TempDir dir;
  write_recording(dir / "r", example());
  const fs::path file = dir / "r/001_light0.png";
  const auto size = fs::file_size(file);
  std::string expected;
  SECTION("another depth") {
    cv::imwrite(file.string(), cv::Mat(8, 12, CV_8UC1, cv::Scalar(1)));
    expected = "8 bits, colour type 0; expected 16 bits, one grey channel";
  }
  SECTION("colour") {
    cv::imwrite(file.string(), cv::Mat(8, 12, CV_16UC3, cv::Scalar(1, 2, 3)));
    expected = "16 bits, colour type 2; expected 16 bits, one grey channel";
  }
  SECTION("another size") {
    cv::imwrite(file.string(), cv::Mat(12, 8, CV_16UC1, cv::Scalar(1)));
    expected = "8 x 12 pixels; expected 12 x 8 pixels";
  }
  SECTION("a header that claims billions of pixels") {
    std::string bytes = read_text_file(file);
    bytes.replace(16, 8, std::string("\x7f\xff\xff\xff\x7f\xff\xff\xff", 8));
    const std::uint32_t crc =
        brdfgate::crc32({reinterpret_cast<const unsigned char*>(bytes.data()) + 12, 17});
    for (int i = 0; i < 4; ++i)
      bytes[29 + i] = static_cast<char>(crc >> (24 - 8 * i));
    std::ofstream(file, std::ios::binary) << bytes;
    expected = "2147483647 x 2147483647 pixels; expected 12 x 8 pixels";
  }
  SECTION("counts beyond the converter's bits") {
    cv::Mat counts(8, 12, CV_16UC1, cv::Scalar(0));
    counts.at<std::uint16_t>(5, 7) = 1024;
    cv::imwrite(file.string(), counts);
    expected = "count 1024 in column 7, row 5; expected at most 1023 from 10 bits";
  }
  SECTION("cut in the pixels") {
    cut(file, size / 2);
    expected = "PNG is cut short";
  }
  SECTION("cut before the end chunk") {
    cut(file, size - 12);
    expected = "PNG is cut short";
  }
  SECTION("cut in the header") {
    cut(file, 20);
    expected = "PNG is cut short";
  }
  SECTION("empty") {
    cut(file, 0);
    expected = "not a PNG file";
  }
  SECTION("a flipped bit in the pixels") {
    flip(file, size / 2);
    expected = "PNG chunk 'IDAT' has a wrong checksum";
  }
  SECTION("a folder") {
    fs::remove(file);
    fs::create_directory(file);
    expected = "not a regular file";
  }
  const std::string message = input_error([&] { return read_recording(dir / "r"); });
  CAPTURE(message);
  CHECK(contains(message, "(frames[1].file): "));
  CHECK(contains(message, file.string() + ": " + expected));
}

TEST_CASE("Any damaged byte of a recording is refused or harmless") {
  const TempDir dir;
  write_recording(dir / "r", example());
  const fs::path file = dir / "r/000_none.png";
  const std::string good = read_text_file(file);
  for (std::size_t at = 0; at < good.size(); ++at) {
    flip(file, at);
    CAPTURE(at);
    REQUIRE(input_error([&] { return read_recording(dir / "r"); }) != "(no error)");
    std::ofstream(file, std::ios::binary) << good;
  }
  const std::string index = read_text_file(dir / "r/recording.yaml");
  std::mt19937_64 random(3);
  int refused = 0;
  for (int i = 0; i < 300; ++i) {
    const std::string text = brdfgate::test::mutated(index, random);
    dir.write("r/recording.yaml", text);
    CAPTURE(i, text);
    const std::string message = input_error([&] { return read_recording(dir / "r"); });
    REQUIRE_FALSE(contains(message, "\n"));
    refused += message != "(no error)" ? 1 : 0;
  }
  CHECK(refused > 100);
}

TEST_CASE("Writing never touches what exists and leaves nothing half done") {
  const TempDir dir;
  const auto write = [&](const fs::path& path, const Recording& recording) {
    return input_error([&] {
      write_recording(path, recording);
      return 0;
    });
  };
  fs::create_directory(dir / "empty");
  CHECK(contains(write(dir / "empty", example()), "exists already"));
  const fs::path file = dir.write("file", "kept");
  CHECK(contains(write(file, example()), "exists already"));
  CHECK(contains(write(file / "below", example()), "cannot be written"));
  CHECK(read_text_file(file) == "kept");
  Recording foreign = example();
  foreign.capture.frames[2].counts = cv::Mat(8, 11, CV_16UC1, cv::Scalar(0));
  CHECK(contains(write(dir / "foreign", foreign), "a frame of another format"));
  foreign = example();
  foreign.capture.frames[2].light = 3;
  CHECK(contains(write(dir / "foreign", foreign), "a frame under light 3"));
  CHECK(std::distance(fs::directory_iterator(dir.path()), {}) == 2);
}

TEST_CASE("Recordings are found in a folder or in its subfolders, in order") {
  const TempDir dir;
  const auto complaint = [&](const fs::path& path) {
    return input_error([&] { return find_recordings(path).size(); });
  };
  CHECK(contains(complaint(dir.path()), "no recording; expected recording.yaml"));
  CHECK(contains(complaint(dir / "none"), "cannot be read"));
  for (const char* name : {"part_0002", "part_0010", "part_0001", "part_0003.tmp-17"}) {
    dir.write(std::string(name) + "/recording.yaml", "x: 1\n");
  }
  dir.write("notes/readme", "x");
  dir.write("file", "x");
  CHECK(find_recordings(dir.path()) ==
        std::vector<fs::path>{dir / "part_0001", dir / "part_0002", dir / "part_0010"});
  CHECK(find_recordings(dir / "part_0002") == std::vector<fs::path>{dir / "part_0002"});
}
