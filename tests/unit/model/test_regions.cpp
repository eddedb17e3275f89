#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <random>
#include <string>

#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/synthetic_part.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

const SyntheticStation& station() {
  static const SyntheticStation s;
  return s;
}

struct NamedMaterial {
  std::string name;
  BrdfPtr brdf;
};

/// From white to black, from matte to metal.
std::vector<NamedMaterial> plain_materials() {
  return {{"white", matte({0.9, 0.9, 0.9})},
          {"matte", matte({0.5, 0.3, 0.2})},
          {"black", matte({0.005, 0.005, 0.005})},
          {"satin", shiny(Rgb::Constant(0.3), Rgb::Constant(0.05), 0.35)},
          {"dark satin", shiny(Rgb::Constant(0.03), Rgb::Constant(0.05), 0.35)},
          {"glossy", shiny({0.4, 0.1, 0.05}, Rgb::Constant(0.04), 0.08)},
          {"polished steel", shiny(Rgb::Zero(), Rgb::Constant(0.6), 0.1)},
          {"gold", shiny(Rgb::Zero(), {0.95, 0.7, 0.35}, 0.2)},
          {"rough aluminium", shiny(Rgb::Zero(), Rgb::Constant(0.9), 0.5)}};
}

int unknown_cells(const Regions& regions) {
  return cv::countNonZero(regions.label == kUnknown);
}

/// Least share, over the true regions, of interior cells (three cells and more from any border)
/// that carry the region's commonest label.
double right_share(const cv::Mat& truth, const cv::Mat& label) {
  cv::Mat least;
  cv::Mat most;
  cv::erode(truth, least, cv::Mat::ones(7, 7, CV_8UC1));
  cv::dilate(truth, most, cv::Mat::ones(7, 7, CV_8UC1));
  std::map<int, std::map<int, int>> table;
  for (int v = 0; v < truth.rows; ++v) {
    for (int u = 0; u < truth.cols; ++u) {
      const int t = truth.at<unsigned char>(v, u);
      if (t == kNotPart || least.at<unsigned char>(v, u) != most.at<unsigned char>(v, u)) continue;
      ++table[t][label.at<unsigned char>(v, u)];
    }
  }
  double worst = 1;
  for (const auto& [region, votes] : table) {
    int sum = 0;
    int top = 0;
    for (const auto& [other, n] : votes) {
      sum += n;
      top = std::max(top, n);
    }
    worst = std::min(worst, static_cast<double>(top) / sum);
  }
  return worst;
}

bool on_part(double x, double y) {
  return plain_part(x, y) != kNotPart;
}
RegionAt on_part_only(const RegionAt& inside) {
  return [inside](double x, double y) { return on_part(x, y) ? inside(x, y) : int(kNotPart); };
}
const RegionAt kHalvesY = on_part_only([](double, double y) { return int(y > 0); });
const RegionAt kHalvesX = on_part_only([](double x, double) { return int(x > 0.01); });
const RegionAt kThirds =
    on_part_only([](double, double y) { return y > 0.015 ? 2 : int(y < -0.01); });
const RegionAt kPrint = on_part_only(  // 2 % of the area
    [](double x, double y) {
      return int(std::abs(x - 0.015) < 0.0057 && std::abs(y + 0.02) < 0.0057);
    });
const RegionAt kStripes = on_part_only(
    [](double, double y) { return static_cast<int>(std::floor((y + 0.05) / 0.005)) % 2; });
const RegionAt kStripesOf3 = on_part_only(
    [](double x, double) { return static_cast<int>(std::floor((x + 0.05) / 0.007)) % 3; });

BrdfPtr grey(double albedo) {
  return matte(Rgb::Constant(albedo));
}
BrdfPtr satin(double albedo) {
  return shiny(Rgb::Constant(albedo), Rgb::Constant(0.05), 0.3);
}

struct MixedCase {
  std::string name;
  RegionAt region;
  std::vector<BrdfPtr> materials;
};

std::vector<MixedCase> mixed_cases() {
  const BrdfPtr gold = shiny(Rgb::Zero(), {0.95, 0.7, 0.35}, 0.2);
  const BrdfPtr steel = shiny(Rgb::Zero(), Rgb::Constant(0.6), 0.3);
  return {
      {"grey levels 20 % apart", kHalvesY, {grey(0.3), grey(0.36)}},
      {"grey levels 20 % apart, the other way", kHalvesX, {grey(0.3), grey(0.36)}},
      {"dark grey levels", kHalvesY, {grey(0.02), grey(0.025)}},
      {"same level, other hue", kHalvesY, {matte({0.3, 0.2, 0.2}), matte({0.2, 0.24, 0.2})}},
      {"three grey levels", kThirds, {grey(0.25), grey(0.3), grey(0.37)}},
      {"a print of 2 %", kPrint, {grey(0.5), grey(0.4)}},
      {"a dark print on satin", kPrint, {satin(0.2), satin(0.05)}},
      {"a print on metal", kPrint, {gold, matte({0.3, 0.05, 0.05})}},
      {"stripes", kStripes, {grey(0.5), grey(0.4)}},
      {"stripes of three materials", kStripesOf3, {grey(0.5), grey(0.3), matte({0.4, 0.2, 0.1})}},
      {"satin halves", kHalvesX, {satin(0.1), satin(0.13)}},
      {"two metals", kHalvesY, {gold, steel}},
  };
}

}  // namespace

TEST_CASE("The fixture is told from the part to within a cell of its border") {
  for (const NamedMaterial& m : plain_materials()) {
    INFO(m.name);
    SyntheticPart part;
    part.materials = {m.brdf};
    const cv::Mat fixture = fixture_cells(render(station(), part), {part.fixture, 0.25});
    const cv::Mat truth = true_not_part(station(), plain_part);
    cv::Mat grown;
    cv::Mat shrunk;
    cv::dilate(truth, grown, cv::Mat());
    cv::erode(truth, shrunk, cv::Mat());
    CHECK(cv::countNonZero(fixture & ~grown) == 0);
    CHECK(cv::countNonZero(shrunk & ~fixture) == 0);
  }
}

TEST_CASE("Fixture cells must agree in every channel and in both lights") {
  SyntheticPart part;
  part.materials = {matte(part.fixture)};
  part.noise = false;
  std::vector<Reflectance> r = render(station(), part);
  const cv::Rect spot(150, 100, 9, 9);
  REQUIRE(cv::countNonZero(fixture_cells(r, {part.fixture, 0.25})(spot)) == 81);
  SECTION("other colour under one light") {
    const std::size_t light = GENERATE(std::size_t{0}, std::size_t{1});
    r[light].value(spot).setTo(cv::Scalar(0.01 / 3.1416, 0.25 / 3.1416, 0.6 / 3.1416));
    CHECK(cv::countNonZero(fixture_cells(r, {part.fixture, 0.25})(spot)) == 0);
  }
  SECTION("clipped") {
    r[0].mask(spot).setTo(kClipped);
    CHECK(cv::countNonZero(fixture_cells(r, {part.fixture, 0.25})(spot)) == 0);
  }
  SECTION("single cells are noise") {
    r[0].value.at<cv::Vec3f>(105, 155) = cv::Vec3f(1, 1, 1);
    CHECK(cv::countNonZero(fixture_cells(r, {part.fixture, 0.25})(spot)) == 81);
  }
  SECTION("unusable cells are not part") {
    part.materials = {grey(0.5)};
    r = render(station(), part);
    r[0].mask(spot).setTo(kInvalid);
    CHECK(cv::countNonZero(fixture_cells(r, {part.fixture, 0.25})(spot)) == 81);
  }
}

TEST_CASE("A plain part is one region, whatever its gloss") {
  for (const NamedMaterial& m : plain_materials()) {
    INFO(m.name);
    SyntheticPart part;
    part.materials = {m.brdf};
    const Regions found = find_regions(render(station(), part), station().map.cells,
                                       true_not_part(station(), plain_part), 8);
    CHECK(found.clusters == 1);
    CHECK(unknown_cells(found) == 0);
    CHECK(cv::countNonZero(found.label != true_labels(station(), plain_part)) == 0);
  }
}

TEST_CASE("Texture and uneven light do not make more materials of one") {
  SyntheticPart part;
  part.materials = {grey(0.4)};
  std::vector<double> texture(std::size_t{200} * 200);
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (double& t : texture)
    t = std::exp(0.1 * normal(random));
  SECTION("texture of 10 % in patches of a millimetre") {
    part.change = [&texture](double x, double y) {
      const auto i = static_cast<std::size_t>((x + 0.05) * 1e3);
      const auto j = static_cast<std::size_t>((y + 0.05) * 1e3);
      return Rgb(Rgb::Constant(texture[i * 200 + j]));
    };
  }
  SECTION("light falling off by a third") {
    part.change = [](double x, double y) { return Rgb(Rgb::Constant(1 - 100 * (x * x + y * y))); };
  }
  const Regions found = find_regions(render(station(), part), station().map.cells,
                                     true_not_part(station(), plain_part), 8);
  CHECK(found.clusters == 1);
  CHECK(unknown_cells(found) == 0);
}

TEST_CASE("Different materials are found, with their borders, in the order of their areas") {
  for (const MixedCase& c : mixed_cases()) {
    INFO(c.name);
    SyntheticPart part;
    part.region = c.region;
    part.materials = c.materials;
    const Regions found = find_regions(render(station(), part), station().map.cells,
                                       true_not_part(station(), c.region), 8);
    CHECK(found.clusters == static_cast<int>(c.materials.size()));
    CHECK(right_share(true_labels(station(), c.region), found.label) > 0.99);
    CHECK(unknown_cells(found) == 0);
    for (int k = 1; k < found.clusters; ++k)
      CHECK(cv::countNonZero(found.label == k - 1) >= cv::countNonZero(found.label == k));
  }
}

TEST_CASE("No more regions are found than asked for") {
  SyntheticPart part;
  part.region = kThirds;
  part.materials = {grey(0.2), grey(0.4), grey(0.8)};
  const int most = GENERATE(1, 2, 3);
  const Regions found = find_regions(render(station(), part), station().map.cells,
                                     true_not_part(station(), kThirds), most);
  CHECK(found.clusters == most);
}

TEST_CASE("A mono sensor's regions are found by level alone") {
  const SyntheticStation mono(364, 272, Mosaic::mono);
  SyntheticPart part;
  part.region = kThirds;
  part.materials = {grey(0.25), grey(0.3), satin(0.37)};
  const std::vector<Reflectance> r = render(mono, part);
  REQUIRE(r[1].value.channels() == 1);
  const Regions found = find_regions(r, mono.map.cells, true_not_part(mono, kThirds), 8);
  CHECK(found.clusters == 3);
  CHECK(right_share(true_labels(mono, kThirds), found.label) > 0.99);
}

TEST_CASE("Stains and dust on the first part do not become materials") {
  SyntheticPart part;
  part.materials = {satin(0.3)};
  part.change = [](double x, double y) {
    double factor = 1;
    for (int i = 0; i < 12; ++i)  // twelve spots of 3 mm, 1.3 % of the part, all different
      if (std::hypot(x - 0.012 * (i % 4) + 0.02, y - 0.015 * std::floor(i / 4.0) + 0.015) < 0.0015)
        factor = 0.3 + 0.15 * i;
    return Rgb(Rgb::Constant(factor));
  };
  const Regions found = find_regions(render(station(), part), station().map.cells,
                                     true_not_part(station(), plain_part), 8);
  CHECK(found.clusters == 1);
  CHECK(unknown_cells(found) < 0.015 * cv::countNonZero(found.label != kNotPart));
}

TEST_CASE("Coverage is the share of inspected cells that show the part") {
  SyntheticPart part;
  part.materials = {grey(0.5)};
  const std::vector<Reflectance> r = render(station(), part);
  const cv::Mat not_part = true_not_part(station(), plain_part);
  const double expected =
      static_cast<double>(cv::countNonZero(station().map.cells.inside & ~not_part)) /
      cv::countNonZero(station().map.cells.inside);
  CHECK(find_regions(r, station().map.cells, not_part, 8).coverage == Approx(expected));
  const TaughtAppearance taught = taught_from(station(), part.materials[0]);
  CHECK(assign_regions(r, station().map.bins, not_part, {taught}, 0.45).coverage ==
        Approx(expected));
  const cv::Mat nothing(not_part.size(), CV_8UC1, cv::Scalar(255));
  const Regions none = find_regions(r, station().map.cells, nothing, 8);
  CHECK(none.clusters == 0);
  CHECK(none.coverage == 0);
}

TEST_CASE("A clean noisy part is assigned without an unknown cell") {
  for (const NamedMaterial& m : plain_materials()) {
    INFO(m.name);
    SyntheticPart part;
    part.materials = {m.brdf};
    const Regions regions = assign_regions(render(station(), part), station().map.bins,
                                           true_not_part(station(), plain_part),
                                           {taught_from(station(), m.brdf)}, 0.45);
    CHECK(unknown_cells(regions) == 0);
    CHECK(cv::countNonZero(regions.label != true_labels(station(), plain_part)) == 0);
  }
}

TEST_CASE("Taught materials are assigned where they are") {
  for (const MixedCase& c : mixed_cases()) {
    INFO(c.name);
    SyntheticPart part;
    part.region = c.region;
    part.materials = c.materials;
    std::vector<TaughtAppearance> taught;
    for (const BrdfPtr& m : c.materials)
      taught.push_back(taught_from(station(), m));
    const cv::Mat truth = true_labels(station(), c.region);
    const Regions regions = assign_regions(render(station(), part), station().map.bins,
                                           true_not_part(station(), c.region), taught, 0.45);
    CHECK(regions.clusters == static_cast<int>(taught.size()));
    CHECK(right_share(truth, regions.label) > 0.99);
    CHECK(unknown_cells(regions) == 0);
    for (int k = 0; k < regions.clusters; ++k) {  // numbers as taught
      const int both = cv::countNonZero((regions.label == k) & (truth == k));
      CHECK(both > 0.9 * cv::countNonZero(truth == k));
    }
  }
}

TEST_CASE("What no taught material explains is unknown, and nothing else") {
  SyntheticPart part;
  part.region = kPrint;
  part.materials = {grey(0.5), grey(0.15)};
  const cv::Mat truth = true_labels(station(), kPrint);
  const Regions regions =
      assign_regions(render(station(), part), station().map.bins, true_not_part(station(), kPrint),
                     {taught_from(station(), part.materials[0])}, 0.45);
  CHECK(right_share(truth, regions.label) > 0.99);
  const int seen = unknown_cells(regions);
  const int there = cv::countNonZero(truth == 1);
  CHECK(seen > 0.8 * there);
  CHECK(seen < 1.1 * there);
  CHECK(cv::countNonZero((regions.label == 0) & (truth == 1)) < 0.2 * there);
}

TEST_CASE("A rim of cells that mix part and fixture is neither unknown nor another material") {
  SyntheticPart part;
  part.materials = {grey(0.8)};
  std::vector<Reflectance> r = render(station(), part);
  const double blur_cells = GENERATE(1.0, 2.0, 3.0);
  for (Reflectance& light : r)
    cv::GaussianBlur(light.value, light.value, {19, 19}, blur_cells);
  const cv::Mat not_part = true_not_part(station(), plain_part);
  const std::vector<TaughtAppearance> taught{taught_from(station(), grey(0.8)),
                                             taught_from(station(), matte({0.4, 0.5, 0.6}))};
  const Regions assigned = assign_regions(r, station().map.bins, not_part, taught, 0.45);
  CHECK(unknown_cells(assigned) == 0);
  CHECK(cv::countNonZero(assigned.label == 1) == 0);
  const Regions found = find_regions(r, station().map.cells, not_part, 8);
  CHECK(found.clusters == 1);
  CHECK(unknown_cells(found) == 0);
}

TEST_CASE("Bins that the taught parts did not reach borrow the nearest bin's expectation") {
  SyntheticPart part;
  part.materials = {satin(0.3)};
  TaughtAppearance taught = taught_from(station(), part.materials[0]);
  int removed = 0;
  for (Eigen::Index b = 0; b < taught.log_f.rows(); b += 3) {
    removed += taught.log_f.row(b).isFinite().all() ? 1 : 0;
    taught.log_f.row(b).setConstant(NAN);
  }
  REQUIRE(removed > 40);
  const Regions regions = assign_regions(render(station(), part), station().map.bins,
                                         true_not_part(station(), plain_part), {taught}, 0.2);
  CHECK(unknown_cells(regions) == 0);
}

TEST_CASE("Regions refuse what does not fit together, naming it") {
  SyntheticPart part;
  part.materials = {grey(0.5)};
  const std::vector<Reflectance> r = render(station(), part);
  const cv::Mat not_part = true_not_part(station(), plain_part);
  const CellGeometry& cells = station().map.cells;
  CHECK(contains(input_error([&] { return find_regions(r, cells, not_part, 0); }),
                 "max_clusters: 0"));
  CHECK(contains(input_error([&] { return find_regions(r, cells, not_part, 9); }),
                 "max_clusters: 9"));
  CHECK(contains(input_error([&] { return find_regions({}, cells, not_part, 8); }), "no light"));
  const auto assign = [&](const std::vector<TaughtAppearance>& taught) {
    return assign_regions(r, station().map.bins, not_part, taught, 0.45);
  };
  CHECK(contains(input_error([&] { return assign({}); }), "1 to 8"));
  CHECK(contains(input_error([&] { return assign({{Eigen::ArrayXXd::Zero(3, 3)}}); }), "3 bins"));
}

TEST_CASE("Materials that light 2 shows alike are told apart by their taught place", "[regions]") {
  const SyntheticStation station(182, 136);
  const RegionAt halves = [](double x, double y) {
    if (std::max(std::abs(x), std::abs(y)) > 0.035) return int{kNotPart};
    return x > 0 ? 1 : 0;
  };
  SyntheticPart part;
  part.region = halves;
  part.materials = {matte({0.2, 0.15, 0.1}), matte({0.2, 0.15, 0.1})};
  const std::vector<Reflectance> r = render(station, part);
  const std::vector<TaughtAppearance> taught{taught_from(station, part.materials[0]),
                                             taught_from(station, part.materials[1])};
  const cv::Mat truth = true_labels(station, halves);
  const cv::Mat not_part = true_not_part(station, halves);
  const auto wrong = [&](const cv::Mat& prior) {
    const Regions found = assign_regions(r, station.map.bins, not_part, taught, 0.45, prior);
    return double(cv::countNonZero((found.label != truth) & (not_part == 0))) /
           cv::countNonZero(not_part == 0);
  };
  CHECK(wrong(truth) < 0.01);
  CHECK(wrong({}) > 0.1);
}
