#include <fstream>

#include "app/hand_geometry.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;

namespace {

StationGeometry nominal() {
  NominalRig rig;
  rig.lights = {{55, 180, 0.3}, {20, 0, 0.3}};
  return make_geometry(rig, {1456, 1088, 10, Mosaic::rggb, 60, 1023});
}

GeometryByHand read(const std::string& text) {
  const test::TempDir dir;
  std::ofstream(dir / "g.yaml") << text;
  return read_hand_geometry(dir / "g.yaml", nominal());
}

std::string refusal(const std::string& text) {
  return test::input_error([&] { return read(text); });
}

const std::string kHead = "schema: brdfgate.geometry/1\nsigma_mm: 0.5\n";

}  // namespace

TEST_CASE("the nominal camera's place, written by hand, gives the nominal camera") {
  const StationGeometry n = nominal();
  const Eigen::Vector3d mm = 1e3 * n.camera.position();
  const GeometryByHand g = read(kHead + "camera: {position_mm: [" + std::to_string(mm.x()) +
                                ", 0, " + std::to_string(mm.z()) + "]}\n");
  REQUIRE(g.camera);
  CHECK(g.camera->X_WC.isApprox(n.camera.X_WC, 1e-6));
  CHECK(g.camera->focal_px == n.camera.focal_px);
  CHECK(g.lights_W.empty());
  CHECK(g.sigma_m == Approx(0.5e-3));
}

TEST_CASE("one light measured by hand leaves the other to the fit") {
  const GeometryByHand g = read(kHead + "lights: [{position_mm: [-240, 1, 170]}, {}]\n");
  REQUIRE(g.lights_W.size() == 2);
  CHECK(g.lights_W[0]->isApprox(Eigen::Vector3d(-0.240, 0.001, 0.170)));
  CHECK_FALSE(g.lights_W[1]);
  CHECK_FALSE(g.camera);
}

TEST_CASE("a geometry file that cannot be right is refused by its field") {
  CHECK_THAT(refusal("sigma_mm: 1\n"), Catch::Contains("schema"));
  CHECK_THAT(refusal(kHead + "lights: [{}]\n"), Catch::Contains("1 lights"));
  CHECK_THAT(refusal(kHead + "lights: [{position_mm: [0, 0, -5]}, {}]\n"),
             Catch::Contains("under the inspected plane"));
  CHECK_THAT(refusal(kHead + "camera: {position_mm: [1, 2]}\n"), Catch::Contains("position_mm"));
  CHECK_THAT(refusal(kHead + "camera: {position_mm: [1, 2, 3], zoom: 2}\n"),
             Catch::Contains("zoom"));
  CHECK_THAT(refusal("schema: brdfgate.geometry/1\nsigma_mm: 0\n"), Catch::Contains("sigma_mm"));
}
