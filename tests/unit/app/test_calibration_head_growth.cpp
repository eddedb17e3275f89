// What a calibration's head may say besides, and that files without it stay as they were.
#include "app/calibration_head.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;

namespace {

Calibration plain() {
  Calibration c;
  c.sensor = {64, 40, 10, Mosaic::rggb, 60, 1023};
  c.noise = {0.0963, 0.3};
  NominalRig rig;
  rig.lights = {{55, 180, 0.3}, {20, 0, 0.3}};
  c.geometry = make_geometry(rig, c.sensor);
  return c;
}

std::string text_of(const Calibration& c) {
  return calibration_head_text(c, {1, 1});
}

Calibration parsed(const std::string& text) {
  return parse_calibration_head(with_checksum(text, "00"), "head").calibration;
}

}  // namespace

TEST_CASE("a calibration without a fitted geometry says nothing that old files did not") {
  const std::string text = text_of(plain());
  for (const char* key : {"source", "distortion", "certificate", "stray", "monitor", "colour",
                          "white_factor", "response"})
    CHECK_THAT(text, !Catch::Contains(key));
}

TEST_CASE("lens, sources, certificate and stray light come back from a head") {
  Calibration c = plain();
  c.geometry.camera.distortion = {-0.08, 0.1, 0.0005, -0.0004, 0.01};
  c.quality.camera = {GeometrySource::fitted, 0.0009, 0.123};
  c.quality.lights = {{GeometrySource::by_hand, 0.001, 0}, {}};
  c.certificate = {"SRT-99-020", "2026-01-02", "2027-01-02"};
  c.stray_share = {0.005, -0.0001};
  c.patch_f = {{0.29, 0.28, 0.27}, {0.3, 0.31, 0.32}};
  c.white_factor = "PTB 1234";
  c.white_sigma = 0.004;
  c.colour = CameraColour{
      ColourModel::root_polynomial, Eigen::MatrixXd::Random(3, 6), "a chart", "D50", 0.7, 2.1};
  const Calibration r = parsed(text_of(c));
  CHECK(r.white_factor == "PTB 1234");
  CHECK(r.white_sigma == 0.004);
  REQUIRE(r.colour);
  CHECK(r.colour->model == ColourModel::root_polynomial);
  CHECK(r.colour->to_xyz == c.colour->to_xyz);
  CHECK(r.colour->chart == "a chart");
  CHECK(r.colour->illuminant == "D50");
  CHECK(r.colour->de00_max == 2.1);
  CHECK(r.geometry.camera.distortion == c.geometry.camera.distortion);
  CHECK(r.quality.camera == c.quality.camera);
  CHECK(r.quality.lights == c.quality.lights);
  CHECK(r.certificate == c.certificate);
  CHECK(r.stray_share == c.stray_share);
  REQUIRE(r.patch_f.size() == 2);
  CHECK((r.patch_f[1] == c.patch_f[1]).all());
  CHECK(text_of(r) == text_of(c));
}

TEST_CASE("a tone curve comes back from a head, and one of another sensor is refused") {
  Calibration c = plain();
  c.sensor.bits = 8;
  c.sensor.full_well_dn = 255;
  ToneCurve curve;
  curve.least = 3;
  curve.most = 250;
  for (int z = 0; z < 256; ++z) {
    curve.log_x.push_back(0.01 * z - 1.234567);
    curve.sigma.push_back(0.01 + 1e-6 * z);
  }
  c.response = {curve, curve, curve};
  c.response[2].least = 5;
  const Calibration r = parsed(text_of(c));
  REQUIRE(r.response.size() == 3);
  CHECK(r.response[1].log_x == curve.log_x);
  CHECK(r.response[1].sigma == curve.sigma);
  CHECK(r.response[2].least == 5);
  CHECK(r.response[0].most == 250);
  CHECK(text_of(r) == text_of(c));
  c.response.pop_back();
  CHECK_THAT(test::input_error([&] { return parsed(text_of(c)); }), Catch::Contains("2 curves"));
  c.response.push_back(curve);
  std::swap(c.response[0].log_x[7], c.response[0].log_x[9]);
  CHECK_THAT(test::input_error([&] { return parsed(text_of(c)); }), Catch::Contains("falls from"));
}

TEST_CASE("a head's new fields are checked like its old ones") {
  Calibration c = plain();
  c.quality.camera = {GeometrySource::fitted, 0.0009, 0.123};
  std::string text = text_of(c);
  const auto at = text.find("fitted");
  REQUIRE(at != std::string::npos);
  text.replace(at, 6, "dreamt");
  CHECK_THAT(test::input_error([&] { return parsed(text); }), Catch::Contains("source"));
}
