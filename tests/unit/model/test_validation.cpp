#include <numbers>

#include "catch.hpp"
#include "model/analytic.hpp"
#include "model/validation.hpp"

using namespace brdfgate;

TEST_CASE("The validation rig has the literature's 298 rows") {
  const BinnedSamples samples = observe_exactly(*make_brdf(LambertParameters{Rgb(0.1, 0.2, 0.3)}));
  CHECK(samples.bins.size() == 298);
  for (const Bin& bin : samples.bins) {
    CHECK(cosines(bin.angles).above_horizon());
    CHECK(bin.f[2] == Approx(0.3 / std::numbers::pi));
  }
}

TEST_CASE(
    "Light 1 shows the peak at the centre of the view and light 2 half the angle between light and "
    "camera") {
  ValidationRig rig;
  rig.lattice = 3;  // corners fall off the disc: the centre and four rim points
  const BinnedSamples samples = observe_exactly(*make_brdf(LambertParameters{}), rig);
  REQUIRE(samples.bins.size() == 10);
  const double degree = std::numbers::pi / 180;
  CHECK(samples.bins[2].angles.theta_h == Approx(0).margin(1e-9));
  CHECK(samples.bins[2].angles.theta_d == Approx(55 * degree));
  CHECK(samples.bins[7].angles.theta_h == Approx(37.5 * degree));
  CHECK(samples.bins[7].angles.theta_d == Approx(17.5 * degree));
}
