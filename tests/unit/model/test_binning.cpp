#include <cmath>
#include <numbers>

#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/synthetic_part.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

/// One light, a 12 x 8 image of one cluster in one bin; f = 2, variance 0.5 everywhere.
struct HandMade {
  std::vector<Reflectance> r;
  StationMap map;
  Regions regions;

  HandMade() {
    const cv::Size size(12, 8);
    r.push_back({cv::Mat(size, CV_32FC1, cv::Scalar(2)), cv::Mat(size, CV_32FC1, cv::Scalar(0.5)),
                 cv::Mat::zeros(size, CV_8UC1)});
    map.cells.inside = cv::Mat(size, CV_8UC1, cv::Scalar(255));
    map.cells.angles = {cv::Mat(size, CV_32FC3, cv::Scalar(0.1, 0.5, 1.0))};
    map.bins.id = {cv::Mat::zeros(size, CV_32SC1)};
    map.bins.light = {1};
    map.bins.mean_angles = {{0.1, 0.5, 1.0}};
    regions = {cv::Mat::zeros(size, CV_8UC1), 1, 1};
  }
  BinnedSamples bin(const BinningOptions& options = {}) const {
    return bin_samples(r, map, regions, 0, options);
  }
};

/// Geometry of a part in a pose, cell by cell in double precision.
struct PosedOracle {
  StationMap map;
  const SyntheticStation& station;
  StationGeometry geometry;

  PosedOracle(const SyntheticStation& s, const PartPose& pose)
      : station(s), geometry(in_part_frame(s.geometry, pose)) {
    map.cells = cell_geometry(geometry, s.sensor, {1, 1});
    map.bins = s.map.bins;
    for (std::size_t light = 0; light < map.bins.id.size(); ++light) {
      map.bins.id[light] = s.map.bins.id[light].clone();
      for (int i = 0; i < static_cast<int>(s.map.cells.inside.total()); ++i) {
        const cv::Point at(i % s.map.cells.inside.cols, i / s.map.cells.inside.cols);
        int& id = map.bins.id[light].at<int>(at);
        if (id >= 0) id = map.bins.find(light, map.cells.angles[light].at<cv::Vec3f>(at));
      }
    }
  }
  static double irradiance(const StationGeometry& g, const CellGeometry& cells, std::size_t light,
                           const cv::Point& at) {
    const auto p = cells.position_m.at<cv::Vec2f>(at);
    return cells.cos_i[light].at<float>(at) /
           (g.lights_W[light] - Eigen::Vector3d(p[0], p[1], 0)).squaredNorm();
  }
  std::vector<Reflectance> reflectance(const std::vector<Reflectance>& r) const {
    std::vector<Reflectance> out = r;
    for (std::size_t light = 0; light < r.size(); ++light) {
      out[light].value = r[light].value.clone();
      out[light].variance = r[light].variance.clone();
      for (int i = 0; i < static_cast<int>(r[light].value.total()); ++i) {
        const cv::Point at(i % r[light].value.cols, i / r[light].value.cols);
        const auto gain =
            static_cast<float>(irradiance(station.geometry, station.map.cells, light, at) /
                               irradiance(geometry, map.cells, light, at));
        out[light].value.at<cv::Vec3f>(at) *= gain;
        out[light].variance.at<cv::Vec3f>(at) *= gain * gain;
      }
    }
    return out;
  }
};

}  // namespace

TEST_CASE("A bin holds the mean reflectance and the variance of that mean") {
  HandMade h;
  h.r[0].value(cv::Rect(0, 0, 6, 8)).setTo(4);
  const BinnedSamples s = h.bin();
  REQUIRE(s.bins.size() == 1);
  CHECK(s.channels == 1);
  CHECK(s.bins[0].id == 0);
  CHECK(s.bins[0].light == 1);
  CHECK(s.bins[0].pixels == 96);
  CHECK(s.bins[0].f[0] == Approx(3));
  CHECK(s.bins[0].variance[0] == Approx(0.5 / 96));
}

TEST_CASE("The scatter of noisy bin means is the one that their variance says") {
  const SyntheticStation station;
  SyntheticPart part;
  part.materials = {matte({0.5, 0.05, 0.004})};
  const std::vector<Reflectance> r = render(station, part);
  const Regions regions{true_labels(station, plain_part), 1, 1};
  const BinnedSamples s = bin_samples(r, station.map, regions, 0);
  for (int c = 0; c < 3; ++c) {
    double chi2 = 0;
    for (const Bin& b : s.bins) {
      const double truth = part.materials[0]->eval(b.angles)[c];
      chi2 += std::pow(b.f[c] - truth, 2) / b.variance[c];
    }
    const double n = static_cast<double>(s.bins.size());
    CHECK(std::abs(chi2 / n - 1) < 4 * std::sqrt(2 / n));
  }
}

TEST_CASE("A bin with a clipped cell is dropped: leaving out the brightest would bias its mean") {
  HandMade h;
  h.r[0].mask.at<unsigned char>(3, 3) = kClipped;
  CHECK(h.bin().bins.empty());
}

TEST_CASE("Cells under the noise floor count with their value, invalid ones not at all") {
  HandMade h;
  h.r[0].value.at<float>(3, 3) = -94;
  SECTION("noise floor") {
    h.r[0].mask.at<unsigned char>(3, 3) = kNoiseFloor;
    CHECK(h.bin().bins.at(0).pixels == 96);
    CHECK(h.bin().bins.at(0).f[0] == Approx(1));
  }
  SECTION("invalid") {
    h.r[0].mask.at<unsigned char>(3, 3) = kInvalid;
    CHECK(h.bin().bins.at(0).pixels == 95);
    CHECK(h.bin().bins.at(0).f[0] == Approx(2));
  }
}

TEST_CASE("A mean below zero is noise and held at zero") {
  HandMade h;
  h.r[0].value.setTo(-1e-5);
  CHECK(h.bin().bins.at(0).f[0] == 0);
}

TEST_CASE("Cells near another label are mixed and left out") {
  HandMade h;
  const unsigned char other = GENERATE(as<unsigned char>{}, 1, kUnknown, kNotPart);
  h.regions.clusters = 2;
  h.regions.label(cv::Rect(0, 0, 4, 8)).setTo(other);
  h.r[0].value(cv::Rect(0, 0, 6, 8)).setTo(1000);  // poison up to the margin of two cells
  CHECK(h.bin().bins.at(0).pixels == 6 * 8);
  CHECK(h.bin().bins.at(0).f[0] == Approx(2));
  CHECK(h.bin({0, 4}).bins.at(0).pixels == 8 * 8);
}

TEST_CASE("A bin of fewer than min_pixels cells is dropped") {
  HandMade h;
  CHECK(h.bin({2, 96}).bins.size() == 1);
  CHECK(h.bin({2, 97}).bins.empty());
}

TEST_CASE("A bin's angles are means over the cells that were used") {
  HandMade h;
  h.regions.label(cv::Rect(0, 0, 4, 8)).setTo(kNotPart);
  h.map.cells.angles[0](cv::Rect(0, 0, 6, 8)).setTo(cv::Scalar(1.5, 1.5, 2.5));
  h.map.cells.angles[0](cv::Rect(9, 0, 3, 8)).setTo(cv::Scalar(0.2, 0.7, 1.2));
  const HalfDiff a = h.bin().bins.at(0).angles;
  CHECK(a.theta_h == Approx(0.15));
  CHECK(a.theta_d == Approx(0.6));
  CHECK(a.phi_d == Approx(1.1));
}

TEST_CASE("phi_d of 0 and of pi average to the one direction that both mean") {
  HandMade h;
  const double near_zero = GENERATE(0.1, 0.3);
  h.map.bins.mean_angles[0].phi_d = 0.05;
  h.map.cells.angles[0](cv::Rect(0, 0, 6, 8)).setTo(cv::Scalar(0.1, 0.5, near_zero));
  h.map.cells.angles[0](cv::Rect(6, 0, 6, 8)).setTo(cv::Scalar(0.1, 0.5, std::numbers::pi - 0.2));
  const double expected = (near_zero - 0.2) / 2;
  const double phi = h.bin().bins.at(0).angles.phi_d;
  CHECK(std::abs(std::remainder(phi - expected, std::numbers::pi)) < 1e-6);
  CHECK(phi >= 0);
  CHECK(phi < std::numbers::pi);
}

TEST_CASE("Binning all clusters in one pass gives what binning each gives") {
  const SyntheticStation station;
  SyntheticPart part;
  part.region = [](double x, double y) {
    return plain_part(x, y) == kNotPart ? int(kNotPart) : int(std::hypot(x, y) < 0.02);
  };
  part.materials = {matte({0.5, 0.3, 0.2}), shiny(Rgb::Constant(0.1), Rgb::Constant(0.05), 0.1)};
  const std::vector<Reflectance> r = render(station, part);
  const Regions regions{true_labels(station, part.region), 2, 1};
  const std::vector<BinnedSamples> all = bin_all(r, station.map, regions);
  REQUIRE(all.size() == 2);
  for (int k = 0; k < 2; ++k) {
    const BinnedSamples one = bin_samples(r, station.map, regions, k);
    const BinnedSamples& same = all[static_cast<std::size_t>(k)];
    REQUIRE(same.bins.size() == one.bins.size());
    REQUIRE(one.bins.size() > 20);
    for (std::size_t i = 0; i < one.bins.size(); ++i) {
      CHECK(same.bins[i].id == one.bins[i].id);
      CHECK(same.bins[i].pixels == one.bins[i].pixels);
      CHECK((same.bins[i].f == one.bins[i].f).all());
      CHECK((same.bins[i].variance == one.bins[i].variance).all());
      CHECK(same.bins[i].angles.phi_d == one.bins[i].angles.phi_d);
    }
  }
}

TEST_CASE("A part in another pose is binned as its own geometry in double precision says") {
  const SyntheticStation station(182, 136);
  SyntheticPart part;
  part.materials = {shiny(Rgb::Constant(0.1), Rgb::Constant(0.05), 0.1)};
  const std::vector<Reflectance> r = render(station, part);
  const Regions regions{true_labels(station, plain_part), 1, 1};
  const PartPose pose = GENERATE(PartPose{}, PartPose{0.012, -0.007, 0.0015});
  const std::vector<BinnedSamples> fast =
      bin_all(r, station.map, regions, PosedPart{station.geometry, pose});
  const PosedOracle oracle(station, pose);
  const std::vector<BinnedSamples> plain = bin_all(oracle.reflectance(r), oracle.map, regions);
  REQUIRE(fast[0].bins.size() == plain[0].bins.size());
  REQUIRE(plain[0].bins.size() > 200);
  int moved = 0;
  for (std::size_t i = 0; i < plain[0].bins.size(); ++i) {
    const Bin& a = fast[0].bins[i];
    const Bin& b = plain[0].bins[i];
    REQUIRE(a.id == b.id);
    moved += std::abs(a.pixels - b.pixels);
    if (a.pixels != b.pixels) continue;  // a cell on an edge: rounding may tell either way
    CHECK(a.f[0] == Approx(b.f[0]).epsilon(1e-4));
    CHECK(a.variance[0] == Approx(b.variance[0]).epsilon(1e-4));
    CHECK(a.angles.theta_h == Approx(b.angles.theta_h).margin(2e-5));
    CHECK(a.angles.theta_d == Approx(b.angles.theta_d).margin(2e-5));
  }
  CHECK(moved < 0.002 * cv::countNonZero(regions.label == 0));
}

TEST_CASE("Binning refuses what does not fit together, naming it") {
  HandMade h;
  CHECK(contains(input_error([&] { return bin_samples(h.r, h.map, h.regions, 1); }), "cluster: 1"));
  h.regions.label = cv::Mat::zeros(3, 3, CV_8UC1);
  CHECK(contains(input_error([&] { return h.bin(); }), "different sizes"));
  CHECK(contains(input_error([&] { return bin_samples({}, h.map, h.regions, 0); }), "no light"));
}
