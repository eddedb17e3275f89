#include <cmath>

#include "app/light_curve.hpp"
#include "catch.hpp"
#include "support/sim_rig.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

class SmallBench final : public Station {
 public:
  explicit SmallBench(const SimBenchSettings& settings, double drift = 0)
      : Station(LightsMode::steady), bench_(settings) {
    Scene scene = scene_of(SceneTarget::white);
    scene.light.drift = {drift, 0};
    bench_.place(scene, 1, 0);
  }
  Camera& camera() override { return bench_.camera(); }
  Lights& lights() override { return bench_.lights(); }
  bool simulated() const override { return true; }
  void check() override {}
  void next_part(std::uint32_t /*trigger_id*/) override {}

 private:
  SimStation bench_;
};

CameraConfig brackets() {
  CameraConfig camera;
  camera.bracket_ms = {0.1, 1, 100};
  return camera;
}

}  // namespace

TEST_CASE("The curve that is measured is the one the lights follow") {
  SimBenchSettings s = precise_bench();
  s.light_rise_s = 0.003;
  SmallBench station(s);
  const LightCurve curve = measure_light_curve(station, brackets(), 1);
  CHECK(curve.seen);
  CHECK(curve.exposure_s == Approx(0.001));  // 100 ms would clip
  REQUIRE(curve.points.size() > 40);
  for (const LightCurvePoint& point : curve.points) {
    const double tau = s.light_rise_s;
    const double t = curve.exposure_s;
    const double level = 1 - tau / t * std::exp(-point.after_s / tau) * (1 - std::exp(-t / tau));
    CAPTURE(point.after_s);
    CHECK(point.level == Approx(level).margin(0.002));
  }
  // Within 1 % from tau ln(100) less about half an exposure on, as finely as frames fall.
  CHECK(curve.settled_s == Approx(0.003 * std::log(100.0) - 0.0005).margin(0.0004));
  CHECK(curve.points.front().after_s < 0.0001);
}

TEST_CASE("A light that is there at once has settled with its first frame") {
  SmallBench station(precise_bench());
  const LightCurve curve = measure_light_curve(station, brackets(), 2);
  CHECK(curve.seen);
  CHECK(curve.settled_s == curve.points.front().after_s);
}

TEST_CASE("A light that stays dark is not seen, and has no curve") {
  SmallBench station(precise_bench(), -1);
  const LightCurve curve = measure_light_curve(station, brackets(), 1);
  CHECK_FALSE(curve.seen);
  CHECK(curve.points.empty());
}
