#include "catch.hpp"
#include "model/reference_upkeep.hpp"
#include "support/input_error.hpp"

using namespace brdfgate;

namespace {

Radiance plate(double level) {
  Radiance r;
  r.value = cv::Mat(20, 30, CV_32FC3, cv::Scalar(level, 2 * level, 3 * level));
  r.variance = cv::Mat(20, 30, CV_32FC3, cv::Scalar::all(1));
  r.mask = cv::Mat::zeros(20, 30, CV_8UC1);
  return r;
}

Calibration with(double light1, double light2) {
  Calibration c;
  c.white = {plate(light1), plate(light2)};
  return c;
}

}  // namespace

TEST_CASE("a lamp's drift is found per light, whatever a few dirty cells say") {
  Calibration now = with(98e3, 51e3);
  now.white[0].value(cv::Rect(0, 0, 5, 5)).setTo(cv::Scalar::all(0));
  now.white[1].value.at<cv::Vec3f>(3, 3) = cv::Vec3f(1e9F, 1e9F, 1e9F);
  now.white[1].mask.at<std::uint8_t>(3, 3) = kClipped;
  const std::vector<double> drift = lamp_drift(with(100e3, 50e3), now);
  REQUIRE(drift.size() == 2);
  CHECK(drift[0] == Approx(-0.02));
  CHECK(drift[1] == Approx(0.02));
}

TEST_CASE("a last calibration of another station is refused") {
  Calibration other = with(1, 1);
  other.white.pop_back();
  CHECK_THROWS_AS(lamp_drift(other, with(1, 1)), InputError);
  other = with(1, 1);
  other.white[1].value = cv::Mat(10, 30, CV_32FC3);
  CHECK_THAT(test::input_error([&] { return lamp_drift(other, with(1, 1)); }),
             Catch::Contains("light 2") && Catch::Contains("another size"));
  other = with(1, 1);
  other.white[0].mask.setTo(kInvalid);
  CHECK_THROWS_AS(lamp_drift(other, with(1, 1)), InputError);
}

TEST_CASE("stray light is what a black gauge shows, by its worst channel") {
  std::vector<Radiance> black{plate(500), plate(100)};
  black[1].value.setTo(cv::Scalar(100, 200, 900));  // blue strays
  black[0].mask.setTo(kNoiseFloor);                 // dark cells still count
  const std::vector<double> share = stray_share(black, with(100e3, 100e3));
  CHECK(share[0] == Approx(0.005));
  CHECK(share[1] == Approx(0.003));
}

TEST_CASE("a certificate's days are counted over months and leap years") {
  CHECK(days_until_due({"", "2027-01-01", "2028-03-01"}, "2028-02-28") == 2);
  CHECK(days_until_due({"", "", "2027-01-01"}, "2027-02-01") == -31);
  CHECK_FALSE(days_until_due({}, "2027-01-01").has_value());
}

TEST_CASE("a calibration is due when its certificate ends or it is too old, whichever is first") {
  Calibration c;
  c.created = "2026-01-31T08:00:00Z";
  CHECK_FALSE(days_until_due(c, 0, "2030-01-01"));
  CHECK(days_until_due(c, 30, "2026-02-01") == 29);
  CHECK(days_until_due(c, 30, "2026-03-03") == -1);
  c.certificate.due = "2026-02-10";
  CHECK(days_until_due(c, 0, "2026-02-01") == 9);
  CHECK(days_until_due(c, 30, "2026-02-01") == 9);
  CHECK(days_until_due(c, 5, "2026-02-01") == 4);
  c.created = "yesterday";
  CHECK_THROWS_AS(days_until_due(c, 5, "2026-02-01"), InputError);
}

TEST_CASE("dates that do not exist are refused") {
  const std::string date =
      GENERATE("2027-02-29", "2027-13-01", "27-01-01", "2027-1-1", "2027/01/01", "", "2027-01-01x");
  CHECK_THROWS_AS(check_date(date, "due"), InputError);
}
