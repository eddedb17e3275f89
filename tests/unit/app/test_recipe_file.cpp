#include <fstream>
#include <iterator>
#include <limits>
#include <string>

#include "app/recipe_file.hpp"
#include "catch.hpp"
#include "support/gaussian_parts.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

namespace fs = std::filesystem;

MonitoredDirections three_directions(int bins, int channels) {
  MonitoredDirections d;
  d.names = {"diffuse level", "gloss level", "roughness"};
  for (int j = 0; j < bins; ++j) {
    d.frame.id.push_back(20 + j);
    d.frame.light.push_back(1 + j % 2);
    d.frame.directions.push_back({0.1 * j, 0.9, 0.2});
  }
  d.reference = Eigen::MatrixXd::Random(bins, channels);
  d.weight = Eigen::MatrixXd::Constant(bins, channels, 4e4);
  d.response = Eigen::MatrixXd::Random(bins * channels, 3);
  return d;
}

TaughtLayout small_layout() {
  TaughtLayout l{0.0005,
                 cv::Mat(5, 5, CV_8UC1, cv::Scalar(kNotPart)),
                 cv::Mat(5, 5, CV_32FC1, cv::Scalar(-2)),
                 cv::Mat(5, 5, CV_8UC1, cv::Scalar(255)),
                 {{1e-4, -2e-4}, 0.01}};
  l.label.at<unsigned char>(2, 3) = 0;
  l.look.at<float>(2, 3) = 0.25F;
  l.seen.at<unsigned char>(0, 1) = 0;
  return l;
}

Recipe taught_recipe(int clusters = 2, int channels = 3) {
  Recipe recipe;
  recipe.id = 7;
  recipe.name = "lid: \"red\" #3";
  recipe.created = "2024-05-06T07:08:09Z";
  recipe.parts = 4;
  recipe.calibration_hash = std::string(64, 'a');
  recipe.basis_checksum = "0123456789";  // reads as a number unless quoted
  recipe.channels = channels;
  recipe.components = 4;
  recipe.part_height_mm = 2.125;
  recipe.settings.max_ambient = 0.1234567890123;
  recipe.settings.min_bins = 33;
  recipe.warnings = {"taught from 4 part(s)", "no: colour"};
  test::GaussianParts good(2);
  good.components = 4;
  good.channels = channels;
  good.monitored = 3 / channels;
  good.bins = 6;
  recipe.layout = small_layout();
  for (int i = 0; i < clusters; ++i) {
    TaughtCluster taught = teach_observed(good.parts(4), recipe.settings);
    taught.directions = three_directions(6, channels);
    taught.name = i == 0 ? "body" : "region " + std::to_string(i);
    taught.area_share = 1.0 / clusters;
    taught.gloss_gu = {1.5, 20.25, 60};
    taught.lab = {40, -3, 7.5};
    recipe.clusters.push_back(std::move(taught));
  }
  return recipe;
}

std::string text_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void check_near(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  REQUIRE(a.rows() == b.rows());
  REQUIRE(a.cols() == b.cols());
  CHECK((a - b).norm() <= 1e-8 * b.norm());
}

void check_same(const TaughtCluster& a, const TaughtCluster& b) {
  CHECK(a.name == b.name);
  CHECK(a.parts == b.parts);
  check_near(a.mean, b.mean);
  CHECK(a.directions.names == b.directions.names);
  CHECK(a.directions.frame.id == b.directions.frame.id);
  CHECK(a.directions.frame.light == b.directions.frame.light);
  CHECK(a.directions.frame.directions[3].theta_h == b.directions.frame.directions[3].theta_h);
  CHECK(a.directions.reference == b.directions.reference);
  CHECK(a.directions.weight == b.directions.weight);
  CHECK(a.directions.response == b.directions.response);
  check_near(a.monitored_mean, b.monitored_mean);
  check_near(a.monitored_covariance, b.monitored_covariance);
  CHECK(a.t2_limit == Approx(b.t2_limit).epsilon(1e-8));
  CHECK(a.bin_id == b.bin_id);
  check_near(a.bin_residual, b.bin_residual);
  check_near(a.bin_residual_sigma, b.bin_residual_sigma);
  CHECK(a.spe_limit == Approx(b.spe_limit).epsilon(1e-8));
  CHECK(a.area_share == Approx(b.area_share).epsilon(1e-8));
  CHECK(a.gloss_gu == b.gloss_gu);
  check_near(a.lab.matrix(), b.lab.matrix());
}

/// The file's text with the first `from` replaced.
std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  REQUIRE(at != std::string::npos);
  return text.replace(at, from.size(), to);
}

}  // namespace

TEST_CASE("A recipe comes back from its file with every field", "[recipe_file]") {
  const TempDir dir;
  for (const int channels : {1, 3}) {
    const Recipe written = taught_recipe(2, channels);
    write_recipe(dir / "a.yaml", written);
    const Recipe r = read_recipe(dir / "a.yaml");
    CHECK(r.part_height_mm == 2.125);
    CHECK(r.id == 7);
    CHECK(r.name == written.name);
    CHECK(r.created == written.created);
    CHECK(r.parts == 4);
    CHECK(r.calibration_hash == written.calibration_hash);
    CHECK(r.basis_checksum == written.basis_checksum);
    CHECK(r.channels == channels);
    CHECK(r.components == 4);
    CHECK(r.warnings == written.warnings);
    REQUIRE(r.clusters.size() == 2);
    check_same(r.clusters[0], written.clusters[0]);
    check_same(r.clusters[1], written.clusters[1]);
    CHECK(r.layout.pitch_m == 0.0005);
    CHECK(r.layout.taught.shift_m == written.layout.taught.shift_m);
    CHECK(r.layout.taught.rotation == 0.01);
    CHECK(cv::countNonZero(r.layout.label != written.layout.label) == 0);
    CHECK(cv::countNonZero(r.layout.seen != written.layout.seen) == 0);
    CHECK(r.layout.look.at<float>(2, 3) == 0.25F);
    CHECK(r.layout.look.at<float>(4, 4) == -2);
    // Written again it is the same text.
    write_recipe(dir / "b.yaml", r);
    CHECK(text_of(dir / "a.yaml") == text_of(dir / "b.yaml"));
  }
}

TEST_CASE("Rules come back with their clusters, and are refused where they stand",
          "[recipe_file][rules]") {
  const TempDir dir;
  Recipe recipe = taught_recipe();
  Rule gloss;
  gloss.reading = RuleReading::gloss_60_gu;
  gloss.cluster = 1;
  gloss.tolerance = 2.5;
  Rule colour;
  colour.high = 1.25;
  recipe.rules = {2, {gloss, colour}};
  write_recipe(dir / "r.yaml", recipe);
  const Recipe r = read_recipe(dir / "r.yaml");
  REQUIRE(r.rules.rules.size() == 2);
  CHECK(r.rules.guard == 2);
  CHECK(r.rules.rules[0].cluster == 1);
  CHECK(r.rules.rules[0].tolerance == 2.5);
  CHECK(r.rules.rules[1].cluster == kEveryCluster);
  CHECK(r.rules.rules[1].high == 1.25);
  const auto file =
      dir.write("bad.yaml", replaced(text_of(dir / "r.yaml"), "tolerance: 2.5", "tolerance: -1"));
  const std::string error = input_error([&] { return read_recipe(file); });
  CAPTURE(error);
  CHECK(contains(error, "bad.yaml:"));
  CHECK(contains(error, "(rules.rules[0].tolerance): -1 is out of range"));
}

TEST_CASE("Every setting comes back exactly", "[recipe_file]") {
  const TempDir dir;
  Recipe recipe = taught_recipe(1);
  JudgeSettings& s = recipe.settings;
  s = {0.0123, 0.034, 1.25,  7.5,   0.041, 0.0031, 0.51, 0.22,
       1.75,   0.061, 0.011, 0.071, 21,    4.5,    3.25, 0.75};
  write_recipe(dir / "r.yaml", recipe);
  const JudgeSettings r = read_recipe(dir / "r.yaml").settings;
  CHECK(r.false_reject_rate == s.false_reject_rate);
  CHECK(r.change_floor == s.change_floor);
  CHECK(r.max_shift_mm == s.max_shift_mm);
  CHECK(r.max_rotation_deg == s.max_rotation_deg);
  CHECK(r.max_tilt_deg == s.max_tilt_deg);
  CHECK(r.colour_limit_de00 == s.colour_limit_de00);
  CHECK(r.gloss_limit_gu == s.gloss_limit_gu);
  CHECK(r.area_share_limit == s.area_share_limit);
  CHECK(r.unknown_share_limit == s.unknown_share_limit);
  CHECK(r.assign_tolerance == s.assign_tolerance);
  CHECK(r.defect_log_threshold == s.defect_log_threshold);
  CHECK(r.defect_min_mm2 == s.defect_min_mm2);
  CHECK(r.max_ambient == s.max_ambient);
  CHECK(r.max_clipped == s.max_clipped);
  CHECK(r.min_coverage == s.min_coverage);
  CHECK(r.min_bins == s.min_bins);
}

TEST_CASE("Eight clusters are read, nine or none are refused", "[recipe_file]") {
  const TempDir dir;
  const fs::path file = dir / "r.yaml";
  Recipe recipe = taught_recipe(1);
  recipe.clusters.resize(8, recipe.clusters[0]);
  write_recipe(file, recipe);
  CHECK(read_recipe(file).clusters.size() == 8);
  recipe.clusters.resize(9, recipe.clusters[0]);
  write_recipe(file, recipe);
  CHECK(contains(input_error([&] { return read_recipe(file); }), "9 clusters; expected 1 to 8"));
  recipe.clusters.clear();
  write_recipe(file, recipe);
  CHECK(contains(input_error([&] { return read_recipe(file); }), "0 clusters"));
}

TEST_CASE("A malformed recipe is refused by field", "[recipe_file]") {
  const TempDir dir;
  write_recipe(dir / "good.yaml", taught_recipe());
  const std::string good = text_of(dir / "good.yaml");
  struct Row {
    const char* from;
    const char* to;
    const char* complaint;
  };
  const Row rows[] = {
      {"brdfgate.recipe/2", "brdfgate.recipe/1", "schema"},
      {"id: 7", "id: 0", "id"},
      {"id: 7", "id: 65536", "id"},
      {"parts: 4", "parts: none", "parts"},
      {"channels: 3", "channels: 2", "channels"},
      {"channels: 3", "channels: 1", "clusters[0].mean"},
      {"components: 4", "components: 5", "clusters[0].mean"},
      {"components: 4", "components: 1000000", "components"},
      {"names: [\"diffuse level\", ", "names: [", "clusters[0].directions.response"},
      {"side: 5", "side: 6", "layout.label"},
      {"label: \"////", "label: \"AQkB", "layout.label"},
      {"look: \"", "look: \"AAAA", "layout.look"},
      {"pitch_m: ", "pitch_m: -", "layout.pitch_m"},
      {"light: [1, ", "light: [3, ", "clusters[0].directions.light"},
      {"light: [1, ", "light: [", "clusters[0].directions.light"},
      {"angles: \"", "angles: \"AAAA", "clusters[0].directions.angles"},
      {"weight: \"", "weight: \"AAAA", "clusters[0].directions.weight"},
      {"monitored_mean: [", "monitored_mean: [1, ", "clusters[0].monitored_mean"},
      {"false_reject_rate: 0.001", "false_reject_rate: 0.5", "settings.false_reject_rate"},
      {"min_bins: 33", "min_bins: 33\n  surplus: 1", "surplus"},
      {"min_bins: 33", "max_bins: 33", "min_bins"},
      {"bin_id: [10, 11", "bin_id: [11, 10", "clusters[0].bin_id"},
      {"bin_id: [10, 11", "bin_id: [10", "clusters[0].bin_residual"},
      {"bin_id: [10, 11", "bin_id: [-1, 11", "clusters[0].bin_id"},
      {"bin_id: [10, 11", "bin_id: [10.5, 11", "clusters[0].bin_id"},
      {"gloss_gu: [1.5, ", "gloss_gu: [", "clusters[0].gloss_gu"},
      {"lab: [40", "lab: [.nan", "clusters[0].lab"},
      {"area_share: 0.5", "area_share: 1.5", "clusters[0].area_share"},
      {"bin_residual_sigma:\n      - [", "bin_residual_sigma:\n      - [-", "bin_residual_sigma"},
      {"monitored_covariance:\n      - [", "monitored_covariance:\n      - [-",
       "monitored_covariance"},
      {"t2_limit: ", "t2_limit: -", "clusters[0].t2_limit"},
      {"spe_limit: ", "spe_limit: -", "clusters[0].spe_limit"},
      {"name: \"body\"", "name: \"body\"\n    name: \"body\"", "name"},
      {"  - name: \"body\"", "  - nome: \"body\"", "clusters[0]"},
      {"clusters:", "clusters: 3\nrest:", "clusters"},
  };
  for (const Row& row : rows) {
    const fs::path file = dir.write("bad.yaml", replaced(good, row.from, row.to));
    const std::string error = input_error([&] { return read_recipe(file); });
    CAPTURE(row.from, row.to, error);
    CHECK(contains(error, "bad.yaml:"));
    CHECK(contains(error, row.complaint));
  }
}

TEST_CASE("A recipe cut off anywhere is refused, never half read", "[recipe_file]") {
  const TempDir dir;
  write_recipe(dir / "good.yaml", taught_recipe(1));
  const std::string good = text_of(dir / "good.yaml");
  for (std::size_t length = 0; length + 2 < good.size(); length += 97) {
    const fs::path file = dir.write("cut.yaml", good.substr(0, length));
    CAPTURE(length);
    CHECK(input_error([&] { return read_recipe(file); }) != "(no error)");
  }
}

TEST_CASE("A recipe that cannot be written leaves the old one alone", "[recipe_file]") {
  const TempDir dir;
  const fs::path file = dir / "r.yaml";
  Recipe recipe = taught_recipe(1);
  write_recipe(file, recipe);
  const std::string before = text_of(file);
  recipe.clusters[0].mean(0, 0) = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(input_error([&] {
                   write_recipe(file, recipe);
                   return 0;
                 }),
                 "not finite"));
  CHECK(text_of(file) == before);
  CHECK(std::distance(fs::directory_iterator(dir.path()), fs::directory_iterator()) == 1);
  recipe = taught_recipe(1);
  CHECK(contains(input_error([&] {
                   write_recipe(dir / "no/such/folder/r.yaml", recipe);
                   return 0;
                 }),
                 "cannot be written"));
}
