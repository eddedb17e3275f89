#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/synthetic_part.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

constexpr double kDeg = std::numbers::pi / 180;

struct Extent {
  int cells = 0;
  int part_cells = 0;  ///< of a centred part of 80 x 80 mm
  cv::Vec3f least{9, 9, 9};
  cv::Vec3f most{-9, -9, -9};
};

std::vector<Extent> extents(const StationMap& map) {
  std::vector<Extent> out(static_cast<std::size_t>(map.bins.bins()));
  for (std::size_t light = 0; light < map.bins.id.size(); ++light) {
    for (int v = 0; v < map.cells.inside.rows; ++v) {
      for (int u = 0; u < map.cells.inside.cols; ++u) {
        const int id = map.bins.id[light].at<int>(v, u);
        if (id < 0) continue;
        Extent& e = out.at(static_cast<std::size_t>(id));
        const auto p = map.cells.position_m.at<cv::Vec2f>(v, u);
        const auto a = map.cells.angles[light].at<cv::Vec3f>(v, u);
        ++e.cells;
        e.part_cells += plain_part(p[0], p[1]) == 0 ? 1 : 0;
        for (int i = 0; i < 3; ++i) {
          e.least[i] = std::min(e.least[i], a[i]);
          e.most[i] = std::max(e.most[i], a[i]);
        }
      }
    }
  }
  return out;
}

const SyntheticStation& default_station() {
  static const SyntheticStation station(728, 544);
  return station;
}

}  // namespace

TEST_CASE("Every inspected cell has a bin of its light and no other cell has one") {
  const StationMap& map = default_station().map;
  REQUIRE(map.bins.id.size() == 2);
  for (int light = 1; light <= 2; ++light) {
    const cv::Mat& id = map.bins.id[static_cast<std::size_t>(light) - 1];
    CHECK(cv::countNonZero((id >= 0) != (map.cells.inside != 0)) == 0);
    for (int v = 0; v < id.rows; v += 7) {
      for (int u = 0; u < id.cols; u += 7) {
        if (id.at<int>(v, u) < 0) continue;
        REQUIRE(map.bins.light.at(static_cast<std::size_t>(id.at<int>(v, u))) == light);
      }
    }
  }
}

TEST_CASE("A part of 80 x 80 mm fills about the 298 bins that the ridge parameter was set for") {
  int filled = 0;
  for (const Extent& e : extents(default_station().map))
    filled += e.part_cells >= 10 ? 1 : 0;
  CHECK(filled > 288);
  CHECK(filled < 308);
}

TEST_CASE("No bin averages fewer than 16 cells and none is far larger than the others") {
  const StationMap& map = default_station().map;
  const int area = cv::countNonZero(map.cells.inside);
  for (const Extent& e : extents(map)) {
    CHECK(e.cells >= 16);
    CHECK(e.cells < 2 * area / 150);
  }
}

TEST_CASE("Near the peak a bin spans one cell of the MERL axis of theta_h") {
  const StationMap& map = default_station().map;
  const std::vector<Extent> all = extents(map);
  int checked = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto axis = [](float theta_h) { return std::sqrt(theta_h / (90 * kDeg)) * 90; };
    if (axis(all[i].least[0]) < 4 || axis(all[i].most[0]) > 16) continue;
    CHECK(axis(all[i].most[0]) - axis(all[i].least[0]) < 1.001);
    ++checked;
  }
  CHECK(checked >= 12);
}

TEST_CASE("Away from the peak no bin joins two patches across the wrap of phi_d") {
  for (const Extent& e : extents(default_station().map)) {
    if (e.least[0] < 2.9 * kDeg) continue;
    CHECK(e.most[2] - e.least[2] < 60 * kDeg);
  }
}

TEST_CASE("A bin's mean angles lie within its cells'") {
  const StationMap& map = default_station().map;
  const std::vector<Extent> all = extents(map);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const HalfDiff& mean = map.bins.mean_angles[i];
    CHECK(mean.theta_h >= all[i].least[0]);
    CHECK(mean.theta_h <= all[i].most[0]);
    CHECK(mean.theta_d >= all[i].least[1]);
    CHECK(mean.theta_d <= all[i].most[1]);
    CHECK(mean.phi_d >= 0);
    CHECK(mean.phi_d < std::numbers::pi);
    if (all[i].least[0] < 2.9 * kDeg) continue;  // the whole circle: any phi_d will do
    CHECK(mean.phi_d >= all[i].least[2] - 1e-6);
    CHECK(mean.phi_d <= all[i].most[2] + 1e-6);
  }
}

TEST_CASE("The mean over a bin is the reflectance at its mean angles, even of a narrow lobe") {
  const SyntheticStation& station = default_station();
  SyntheticPart part;
  part.noise = false;
  part.materials = {shiny(Rgb::Constant(0.1), Rgb::Constant(0.05), 0.05)};
  const std::vector<Reflectance> r = render(station, part);
  const Regions regions{true_labels(station, plain_part), 1, 1};
  const BinnedSamples samples = bin_samples(r, station.map, regions, 0);
  REQUIRE(samples.bins.size() > 280);
  for (const Bin& b : samples.bins)
    CHECK(std::abs(std::log(b.f[1] / part.materials[0]->eval(b.angles)[1])) < 0.05);
}

TEST_CASE("The same station gets the same bins") {
  const SyntheticStation a;
  const SyntheticStation b;
  REQUIRE(a.map.bins.bins() == b.map.bins.bins());
  for (std::size_t light = 0; light < 2; ++light)
    CHECK(cv::countNonZero(a.map.bins.id[light] != b.map.bins.id[light]) == 0);
}

TEST_CASE("Bins exist for any number of lights anywhere and for mono sensors") {
  SensorFormat sensor;
  sensor.width = 120;
  sensor.height = 100;
  sensor.mosaic = Mosaic::mono;
  NominalRig rig;
  rig.camera_deg = 10;
  rig.lights = {{10, 180, 0.3}, {70, 90, 0.5}, {45, -30, 0.2}};
  const CellGeometry cells = cell_geometry(make_geometry(rig, sensor), sensor, {0.05, 0.05});
  const StationMap map{cells, make_bin_map(cells)};
  REQUIRE(map.bins.id.size() == 3);
  const std::vector<Extent> all = extents(map);
  CHECK(std::count(map.bins.light.begin(), map.bins.light.end(), 3) > 20);
  CHECK(std::all_of(all.begin(), all.end(), [](const Extent& e) { return e.cells >= 16; }));
}

TEST_CASE("A region of fewer cells than a bin needs is one bin") {
  SyntheticStation station(40, 30);
  station.map.cells.inside.setTo(0);
  station.map.cells.inside(cv::Rect(10, 10, 3, 3)).setTo(255);
  const BinMap bins = make_bin_map(station.map.cells);
  CHECK(bins.bins() == 2);
  CHECK(cv::countNonZero(bins.id[0] == 0) == 9);
}

TEST_CASE("A geometry without lights has no bins and says so") {
  CHECK(contains(input_error([] { return make_bin_map(CellGeometry{}); }), "no light"));
}

TEST_CASE("cells of the taught pose belong to the bins they were cut into") {
  const SensorFormat sensor = [] {
    SensorFormat s;
    s.width = 160;
    s.height = 120;
    s.mosaic = Mosaic::mono;
    return s;
  }();
  NominalRig rig;
  rig.lights = {{55, 180, 0.25}, {20, 0, 0.25}};
  const CellGeometry cells = cell_geometry(make_geometry(rig, sensor), sensor, {0.08, 0.08});
  const BinMap bins = make_bin_map(cells);
  for (std::size_t light = 0; light < 2; ++light) {
    int moved = 0;
    for (int i = 0; i < static_cast<int>(cells.inside.total()); ++i) {
      const cv::Point at(i % cells.inside.cols, i / cells.inside.cols);
      if (cells.inside.at<unsigned char>(at) == 0) continue;
      moved +=
          bins.find(light, cells.angles[light].at<cv::Vec3f>(at)) != bins.id[light].at<int>(at);
    }
    // Equal angles on both sides of a cut may fall to either.
    CHECK(moved <= 0.002 * double(cells.inside.total()));
  }
}
