#include "app/calibration_report.hpp"
#include "app/html_page.hpp"
#include "catch.hpp"
#include "support/shipped.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;

TEST_CASE("base64 is RFC 4648's") {
  CHECK(base64("").empty());
  CHECK(base64("f") == "Zg==");
  CHECK(base64("fo") == "Zm8=");
  CHECK(base64("foobar") == "Zm9vYmFy");
}

TEST_CASE("text cannot become markup") {
  CHECK(html_text("<b>&\"") == "&lt;b&gt;&amp;&quot;");
}

TEST_CASE("a report of a plain calibration is one page with its pictures in it") {
  CalibrationOutcome outcome;
  Calibration& c = outcome.calibration;
  c.sensor = {64, 48, 10, Mosaic::mono, 60, 1023};
  c.noise = {0.1, 1};
  NominalRig rig;
  rig.lights = {{55, 180, 0.3}, {20, 0, 0.3}};
  c.geometry = make_geometry(rig, c.sensor);
  c.certificate.number = "A<1>";
  c.certificate.due = "2027-01-01";
  for (int l = 0; l < 2; ++l) {
    Radiance white;
    white.value = cv::Mat(48, 64, CV_32FC1, cv::Scalar(1000));
    white.variance = cv::Mat(48, 64, CV_32FC1, cv::Scalar(1));
    white.mask = cv::Mat::zeros(48, 64, CV_8UC1);
    c.white.push_back(white);
  }
  PhotonTransfer sweep;
  for (int i = 1; i < 9; ++i)
    sweep.points.push_back({i * 1e-3, 100.0 * i, 10.0 * i + 1});
  outcome.sweep = sweep;
  outcome.warnings = {"5 < 6"};
  const test::TempDir dir;
  write_calibration_report(dir / "r.html", outcome, {});
  const std::string page = test::read_text_file(dir / "r.html");
  CHECK_THAT(page, Catch::Contains("A&lt;1&gt;") && Catch::Contains("5 &lt; 6"));
  std::size_t pictures = 0;
  for (std::size_t at = page.find("data:image/png;base64,iVBOR"); at != std::string::npos;
       at = page.find("data:image/png;base64,iVBOR", at + 1))
    ++pictures;
  CHECK(pictures == 3);  // two lights, one noise curve
  CHECK_THAT(page, !Catch::Contains("src=\"http") && Catch::Contains("</html>"));
}
