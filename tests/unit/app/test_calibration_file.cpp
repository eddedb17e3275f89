#include <cmath>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <string>

#include "app/calibration_file.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;

namespace {

Radiance noisy_white(const SensorFormat& sensor, double level, unsigned seed) {
  cv::RNG random(seed);
  const int type = CV_32FC(sensor.channels());
  Radiance white;
  white.value.create(sensor.cells(), type);
  white.variance.create(sensor.cells(), type);
  white.mask = cv::Mat::zeros(sensor.cells(), CV_8UC1);
  const int n = static_cast<int>(white.value.total()) * sensor.channels();
  for (int i = 0; i < n; ++i) {
    const double shade = 1 - 0.3 * i / n;
    const double sigma = 0.007 * level * std::sqrt(shade);  // 10,000 electrons twice over
    white.value.ptr<float>()[i] = static_cast<float>(level * shade + random.gaussian(sigma));
    white.variance.ptr<float>()[i] = static_cast<float>(sigma * sigma);
  }
  return white;
}

Calibration sample(int width, int height, Mosaic mosaic) {
  Calibration c;
  c.sensor = {width, height, 10, mosaic, 60.123456789012345, 1023};
  c.noise = {0.0963, 1.0 / 3};
  NominalRig rig;
  rig.lights = {{55, 180, 0.3}, {20, 0, 0.3}};
  c.geometry = make_geometry(rig, c.sensor);
  c.white_reflectance = {0.99, 0.985, 0.98};
  c.white = {noisy_white(c.sensor, 60e3, 1), noisy_white(c.sensor, 45e3, 2)};
  c.white[0].mask.at<unsigned char>(1, 2) = kClipped;
  c.white[1].mask.at<unsigned char>(0, 0) = kNoiseFloor | kInvalid;
  c.station_hash = "0123abcd";
  c.created = "2024-05-06T07:08:09Z";
  return c;
}

double worst_relative(const cv::Mat& a, const cv::Mat& b) {
  double worst = 0;
  const int n = static_cast<int>(a.total()) * a.channels();
  for (int i = 0; i < n; ++i)
    worst = std::max<double>(worst, std::abs(a.ptr<float>()[i] / b.ptr<float>()[i] - 1));
  return worst;
}

std::string bytes_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// The same bytes with one text for another of equal length, as an editor or a bad disk would.
std::string with_replaced(std::string bytes, const std::string& from, const std::string& to) {
  const auto at = bytes.find(from);
  REQUIRE(at != std::string::npos);
  REQUIRE(from.size() == to.size());
  return bytes.replace(at, from.size(), to);
}

std::string refusal(const std::filesystem::path& file) {
  return test::input_error([&] { return read_calibration(file); });
}

}  // namespace

TEST_CASE("a calibration comes back from its file") {
  const auto mosaic = GENERATE(Mosaic::mono, Mosaic::gbrg);
  const test::TempDir dir;
  const Calibration c = sample(64, 40, mosaic);
  const std::string hash = write_calibration(dir / "c.exr", c);
  const Calibration r = read_calibration(dir / "c.exr");
  CHECK(hash.size() == 64);
  CHECK(r.hash == hash);
  CHECK(r.sensor == c.sensor);  // exactly: the shortest text that reads back as the same double
  CHECK(r.noise.gain_dn_per_e == c.noise.gain_dn_per_e);
  CHECK(r.noise.read_noise_dn == c.noise.read_noise_dn);
  CHECK(r.geometry.camera.focal_px == c.geometry.camera.focal_px);
  CHECK(r.geometry.camera.centre_px == c.geometry.camera.centre_px);
  CHECK(r.geometry.camera.X_WC.matrix() == c.geometry.camera.X_WC.matrix());
  REQUIRE(r.geometry.lights_W.size() == 2);
  CHECK(r.geometry.lights_W[0] == c.geometry.lights_W[0]);
  CHECK(r.geometry.lights_W[1] == c.geometry.lights_W[1]);
  CHECK(r.white_reflectance == c.white_reflectance);
  CHECK(r.station_hash == c.station_hash);
  CHECK(r.created == c.created);
  REQUIRE(r.white.size() == 2);
  for (std::size_t l = 0; l < 2; ++l) {
    REQUIRE(r.white[l].value.type() == c.white[l].value.type());
    CHECK(worst_relative(r.white[l].value, c.white[l].value) < 1.0 / 2048);
    CHECK(worst_relative(r.white[l].variance, c.white[l].variance) < 2.05 / 32);
    CHECK(cv::norm(r.white[l].mask, c.white[l].mask, cv::NORM_INF) == 0);
  }
}

TEST_CASE("writing what was read changes nothing") {
  const test::TempDir dir;
  const std::string first = write_calibration(dir / "a.exr", sample(32, 32, Mosaic::rggb));
  const std::string second = write_calibration(dir / "b.exr", read_calibration(dir / "a.exr"));
  CHECK(write_calibration(dir / "c.exr", read_calibration(dir / "b.exr")) == second);
  CHECK(first == second);
}

TEST_CASE("a clipped cell's bound does not spoil the others' precision") {
  const test::TempDir dir;
  Calibration c = sample(32, 32, Mosaic::mono);
  c.white[0].value.at<float>(1, 2) = 3.2e7F;  // masked in sample()
  write_calibration(dir / "c.exr", c);
  const Calibration r = read_calibration(dir / "c.exr");
  CHECK(worst_relative(r.white[0].value, c.white[0].value) < 1.0 / 2048);
}

TEST_CASE("every change of a calibration changes its hash") {
  const test::TempDir dir;
  const Calibration c = sample(32, 32, Mosaic::rggb);
  const std::string hash = write_calibration(dir / "c.exr", c);
  CHECK(write_calibration(dir / "c.exr", c) == hash);
  Calibration moved = c;
  moved.geometry.lights_W[1].x() += 1e-9;
  CHECK(write_calibration(dir / "c.exr", moved) != hash);
  Calibration masked = sample(32, 32, Mosaic::rggb);
  masked.white[1].mask.at<unsigned char>(9, 9) = kInvalid;
  CHECK(write_calibration(dir / "c.exr", masked) != hash);
}

TEST_CASE("the default station's calibration takes less than 3 MB") {
  const test::TempDir dir;
  write_calibration(dir / "c.exr", sample(1456, 1088, Mosaic::rggb));
  CHECK(std::filesystem::file_size(dir / "c.exr") < 3'000'000);
}

TEST_CASE("writing replaces the file whole and leaves nothing beside it") {
  const test::TempDir dir;
  const auto file = dir.write("c.exr", "what was there before");
  const std::string hash = write_calibration(file, sample(32, 32, Mosaic::rggb));
  CHECK(read_calibration(file).hash == hash);
  CHECK(std::distance(std::filesystem::directory_iterator(dir.path()), {}) == 1);
}

TEST_CASE("a calibration that cannot be written is an error with the file's name") {
  const test::TempDir dir;
  const auto message = [&](const std::filesystem::path& file, const Calibration& c) {
    return test::input_error([&] { return write_calibration(file, c); });
  };
  Calibration c = sample(32, 32, Mosaic::rggb);
  CHECK(test::contains(message(dir / "missing/c.exr", c), "missing/c.exr: cannot be written"));
  c.white.pop_back();
  CHECK(test::contains(message(dir / "c.exr", c), "1 white references; expected one for each of "));
  c = sample(32, 32, Mosaic::rggb);
  c.sensor.width = 30;
  CHECK(test::contains(message(dir / "c.exr", c), "another layout"));
}

TEST_CASE("what is no calibration is refused by name") {
  const test::TempDir dir;
  const Calibration c = sample(32, 32, Mosaic::rggb);
  write_calibration(dir / "good.exr", c);
  const std::string good = bytes_of(dir / "good.exr");

  SECTION("no file") {
    CHECK(test::contains(refusal(dir / "none.exr"), "none.exr: no such file"));
  }
  SECTION("not an EXR") {
    CHECK(test::contains(refusal(dir.write("c.exr", "schema: brdfgate.calibration/1")),
                         "c.exr: not an OpenEXR image"));
    CHECK(test::contains(refusal(dir.write("c.exr", "")), "c.exr: not an OpenEXR image"));
  }
  SECTION("an EXR that is no calibration") {
    const auto file =
        dir.write("c.exr", with_replaced(good, "brdfgate.calibration", "somebody.elses.image"));
    CHECK(test::contains(refusal(file), "without the header attribute 'brdfgate.calibration'"));
  }
  SECTION("another schema") {
    const auto file =
        dir.write("c.exr", with_replaced(good, "brdfgate.calibration/1", "brdfgate.calibration/2"));
    const std::string message = refusal(file);
    CHECK(test::contains(message, "c.exr (head):1:"));
    CHECK(test::contains(message, "(schema): 'brdfgate.calibration/2'"));
  }
  SECTION("a missing layer") {
    const auto file = dir.write("c.exr", with_replaced(good, "light2.white.G", "light2.white.X"));
    CHECK(test::contains(refusal(file), "layer 'light2.white.G' is missing"));
  }
  SECTION("sizes that differ") {
    const auto file = dir.write("c.exr", with_replaced(good, "width: 32", "width: 34"));
    CHECK(test::contains(refusal(file), "expected 17 x 16 cells"));
  }
  SECTION("an edited head") {
    const auto file = dir.write("c.exr", with_replaced(good, "0123abcd", "0123abce"));
    CHECK(test::contains(refusal(file), "checksum"));
  }
  SECTION("a camera pose that is none") {
    std::string head = with_replaced(good, "pose_WC: [0", "pose_WC: [2");
    CHECK(test::contains(refusal(dir.write("c.exr", head)), "camera.pose_WC"));
  }
}

TEST_CASE("no damaged byte passes and none is worse than an error") {
  const test::TempDir dir;
  write_calibration(dir / "good.exr", sample(8, 8, Mosaic::rggb));
  const std::string good = bytes_of(dir / "good.exr");
  const Calibration before = read_calibration(dir / "good.exr");
  cv::RNG random(4);
  int refused = 0;
  constexpr int kTrials = 300;
  for (int i = 0; i < kTrials; ++i) {
    std::string bytes = good;
    if (i % 3 == 0) {
      bytes.resize(static_cast<std::size_t>(random.uniform(0, static_cast<int>(good.size()))));
    } else {
      bytes[static_cast<std::size_t>(random.uniform(0, static_cast<int>(good.size())))] ^=
          static_cast<char>(1 << random.uniform(0, 8));
    }
    const auto file = dir.write("c.exr", bytes);
    // A header field that says nothing about the content (the screen window) may change.
    const std::string message = test::input_error([&] {
      const Calibration read = read_calibration(file);
      CHECK(read.hash == before.hash);
      CHECK(cv::norm(read.white[0].value, before.white[0].value, cv::NORM_INF) == 0);
      return 0;
    });
    refused += message == "(no error)" ? 0 : 1;
  }
  CHECK(refused > kTrials * 8 / 10);
}
