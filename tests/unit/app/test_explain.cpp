#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "app/checked_values.hpp"
#include "app/explain.hpp"
#include "app/html_page.hpp"
#include "app/pictures.hpp"
#include "app/reading_words.hpp"
#include "app/session.hpp"
#include "catch.hpp"
#include "support/shipped.hpp"

using namespace brdfgate;

namespace {

/// The shipped station; opened once: its basis takes a moment.
struct Shipped {
  StationConfig config = read_station_config(test::shipped_file("station.yaml"));
  Inspector inspector = load_inspector(config);
};
const Shipped& shipped() {
  static const Shipped station;
  return station;
}

cv::Mat label_of(const StationMap& map) {
  cv::Mat label(map.cells.inside.size(), CV_8U, cv::Scalar(kNotPart));
  label(cv::Rect(label.cols / 4, label.rows / 4, label.cols / 2, label.rows / 2)) = cv::Scalar(0);
  return label;
}

/// A part of one material, as an inspection without a recipe leaves it.
Inspection seen_part() {
  const Inspector& inspector = shipped().inspector;
  Inspection part;
  part.result.calibration_hash = inspector.calibration().hash;
  part.result.regions = {label_of(inspector.map()), 1, 0.25};
  for (int light = 0; light < 2; ++light) {
    Reflectance r;
    r.value = cv::Mat(part.result.regions.label.size(), CV_32FC3, cv::Scalar(0.1, 0.2, 0.3));
    r.variance = cv::Mat(r.value.size(), CV_32FC3, cv::Scalar::all(1e-8));
    r.mask = cv::Mat::zeros(r.value.size(), CV_8U);
    part.reflectance.push_back(r);
  }
  ClusterResult cluster;
  cluster.name = "<body>";
  cluster.present = true;
  cluster.bins = 300;
  cluster.raw.c = inspector.basis().training_weights().topRows(3).transpose();
  const Eigen::Index k = cluster.raw.c.rows();
  cluster.raw.covariance.assign(3, Eigen::MatrixXd::Identity(k, k) * 1e-6);
  cluster.readings = inspector.readings().read(cluster.raw);
  cluster.readings.gloss[1].measured = true;
  cluster.validity.mahalanobis_ratio = cluster.validity.misfit_ratio = Eigen::Vector3d::Zero();
  cluster.valid = {true, true, true, true, true};
  for (std::size_t i = 0; i < 3; ++i)
    cluster.gloss_gu[i] = cluster.readings.gloss[i].value;
  part.result.clusters.push_back(cluster);
  part.observed.emplace_back();
  return part;
}

/// A recipe that this part meets; two named changes.
RecipeInForce recipe_for(const Inspection& part) {
  RecipeInForce force;
  force.recipe.name = "R&D";
  TaughtCluster taught;
  taught.name = "<body>";
  taught.parts = 12;
  taught.mean = part.result.clusters[0].raw.c *
                std::sqrt(double(shipped().inspector.basis().info().observations));
  taught.area_share = 0.9;
  taught.gloss_gu = part.result.clusters[0].gloss_gu;
  taught.directions.names = {"gloss level", "roughness"};
  taught.monitored_mean = Eigen::Vector2d::Zero();
  taught.monitored_covariance = Eigen::Matrix2d::Identity() * 1e-4;
  taught.bin_residual = taught.bin_residual_sigma = Eigen::MatrixXd::Zero(0, 3);
  force.recipe.clusters.push_back(taught);
  return force;
}

ClusterObservation observation(double gloss, double roughness) {
  ClusterObservation seen;
  seen.monitored = Eigen::Vector2d(gloss, roughness);
  seen.monitored_noise = Eigen::Matrix2d::Zero();
  seen.residual = seen.residual_noise = Eigen::MatrixXd::Zero(0, 3);
  return seen;
}

ExplainSource source(const Inspection& part, const RecipeInForce* recipe) {
  return {part, shipped().inspector, recipe, "part <1>", "station", "recipe", {0, 12}};
}

const CheckedValue& named(const std::vector<CheckedValue>& values, const std::string& name) {
  for (const CheckedValue& v : values)
    if (v.name == name) return v;
  FAIL("no value named " << name);
  return values.front();
}

bool says(const std::string& page, const std::string& words) {
  return page.find(words) != std::string::npos;
}

}  // namespace

TEST_CASE("every value stands beside its limit, and says which side it is on", "[explain]") {
  Inspection part = seen_part();
  RecipeInForce recipe = recipe_for(part);
  ClusterResult& cluster = part.result.clusters[0];
  cluster.deviation = {8, 10, 3, 2};
  cluster.delta_e00 = std::numeric_limits<double>::quiet_NaN();
  cluster.area_share = 0.85;
  part.facts.ambient = 0.01;
  part.facts.in_place = {0.95};
  const auto values = checked_values(part, &recipe, shipped().inspector);
  using State = CheckedValue::State;
  CHECK(named(values, "T2").state == State::within);
  CHECK(named(values, "T2").ratio == Approx(0.8));
  CHECK(named(values, "SPE").state == State::beyond);
  CHECK(named(values, "colour").state == State::unknown);
  CHECK(named(values, "colour").value == "not known");
  CHECK(named(values, "loss of area").ratio == Approx(0.05 / 0.03));
  CHECK(named(values, "ambient light").ratio == Approx(0.2));
  CHECK(named(values, "not in its place").ratio == Approx(0.1));
  CHECK(named(values, "T2").cluster == 0);
  CHECK(named(values, "ambient light").cluster == kWholePart);
  const std::string page = explain_page(source(part, &recipe));
  CHECK(says(page, "<div class=\"bar\"><i style=\"left:0;width:40.0%\">"));
  CHECK(says(page, "<div class=\"bar over\"><i style=\"left:0;width:75.0%\">"));
  const std::string text = explain_text(source(part, &recipe));
  CHECK(says(text, "[########  |          ] ok"));
  CHECK(says(text, "[##########|#####     ] BEYOND"));
  CHECK(says(text, "[?         |          ] NOT KNOWN"));
}

TEST_CASE("a verdict is said in words", "[explain]") {
  CHECK(verdict_words(Verdict::pass) == "pass");
  CHECK(verdict_words(Verdict::reject) == "reject");
  CHECK(verdict_words(Verdict::not_judged) == "not judged");
  CHECK(verdict_words(Verdict::none) == "measured");
}

TEST_CASE("named changes show how far and how much of T2 each is", "[explain]") {
  Inspection part = seen_part();
  const RecipeInForce recipe = recipe_for(part);
  part.observed[0] = observation(0.03, -0.01);
  const std::string page = explain_page(source(part, &recipe));
  CHECK(says(page, "gloss level"));
  CHECK(says(page, "+3.05 %"));
  const auto shifts = monitored_shifts(recipe.recipe.clusters[0], *part.observed[0]);
  REQUIRE(shifts.size() == 2);
  CHECK(shifts[0].sigmas == Approx(0.03 / std::sqrt(1e-4 * 13 / 12)));
  CHECK(shifts[0].part + shifts[1].part ==
        Approx(deviation(recipe.recipe.clusters[0], *part.observed[0]).t2));
  CHECK(largest_shift(recipe.recipe.clusters[0], *part.observed[0]).name == "gloss level");
}

TEST_CASE("names and reasons cannot become markup", "[explain]") {
  Inspection part = seen_part();
  const RecipeInForce recipe = recipe_for(part);
  part.result.verdict = Verdict::reject;
  part.result.findings = {{Reason::t2, "T2 > 5 \"&\" <script>"}};
  const std::string page = explain_page(source(part, &recipe));
  CHECK(says(page, "T2 &gt; 5 &quot;&amp;&quot; &lt;script&gt;"));
  CHECK(says(page, "&lt;body&gt;"));
  CHECK(says(page, "R&amp;D"));
  CHECK(says(page, "part &lt;1&gt;"));
  for (const char* bad : {"<script", "<body>&", "http://", "https://", "src=\"/"})
    CHECK_FALSE(says(page, bad));
}

TEST_CASE("readings carry their interval and where they are from", "[explain]") {
  const Inspection part = seen_part();
  const RecipeInForce recipe = recipe_for(part);
  const auto words = reading_words(part.result.clusters[0], &recipe.recipe.clusters[0]);
  REQUIRE(words.size() >= 3);
  CHECK(words[1].name == "gloss 60 deg");
  CHECK(words[1].measured);
  CHECK_FALSE(words[0].measured);
  CHECK(says(words[1].interval, " to "));
  CHECK(words[1].taught == words[1].value.substr(0, words[1].value.size() - 3));
  const std::string page = explain_page(source(part, &recipe));
  CHECK(says(page, words[1].interval));
  CHECK(says(page, "good\">measured"));
  CHECK(says(page, "odd\">extrapolated"));
  ClusterResult blank = part.result.clusters[0];
  blank.valid.weights = false;
  CHECK(reading_words(blank, nullptr).empty());
}

TEST_CASE("what is missing is said: a highlight, colour, weights, a cluster, all of it",
          "[explain]") {
  const Inspector& inspector = shipped().inspector;
  Inspection part = seen_part();
  const RecipeInForce recipe = recipe_for(part);
  const auto missing = [&](const RecipeInForce* r) {
    std::string all;
    for (const std::string& line : missing_evidence(part, r, inspector))
      all += line + "\n";
    return all;
  };
  CHECK(says(missing(nullptr), "no recipe"));
  ClusterResult& cluster = part.result.clusters[0];
  cluster.valid.highlight = false;
  CHECK(says(missing(&recipe), "no highlight stands out"));
  cluster.valid.gloss = false;
  CHECK(says(missing(&recipe), "mirror direction was not in view"));
  cluster.validity.misfit_ratio[0] = 1.5;
  CHECK(says(missing(&recipe), "unlike those that the basis"));
  cluster.valid.weights = false;
  cluster.bins = 7;
  CHECK(says(missing(&recipe), "7 angular bins"));
  CHECK(says(explain_page(source(part, &recipe)), "Found: not reconstructed"));
  cluster.present = false;
  CHECK(says(missing(&recipe), "nothing of the part was measured"));
  const Inspection blind;
  const std::string page = explain_page(source(blind, nullptr));
  CHECK(says(page, "nothing was measured"));
  CHECK(says(page, "</html>"));
  CHECK(says(explain_text(source(blind, nullptr)), "nothing was measured"));
}

TEST_CASE("a defect is ringed where it lies", "[explain]") {
  const DefectBlocks& blocks = shipped().inspector.defect_blocks();
  const cv::Size size = blocks.size();
  cv::Mat1f scores(size, 0.0F);
  scores(2, 3) = 100;
  scores(4, 5) = NAN;
  const cv::Vec2f at = blocks.position_m().at<cv::Vec2f>(size.height / 2, size.width / 2);
  const std::vector<Defect> defects{{"darker", {at[0] * 1e3, at[1] * 1e3}, 4, 2, -0.1}};
  const cv::Mat plain = draw_defect_scores(scores, 10, blocks, {}, 4 * size.width);
  const cv::Mat ringed = draw_defect_scores(scores, 10, blocks, defects, 4 * size.width);
  CHECK(plain.at<cv::Vec3b>(4 * 2 + 2, 4 * 3 + 2) == cv::Vec3b(0, 0, 255));
  CHECK(plain.at<cv::Vec3b>(4 * 4 + 2, 4 * 5 + 2) == cv::Vec3b(205, 205, 205));
  CHECK(plain.at<cv::Vec3b>(0, 0) == cv::Vec3b(255, 255, 255));
  cv::Mat1b changed;
  cv::cvtColor(plain != ringed, changed, cv::COLOR_BGR2GRAY);
  const cv::Rect box = cv::boundingRect(changed);
  const cv::Point centre(4 * (size.width / 2) + 2, 4 * (size.height / 2) + 2);
  CHECK(box.contains(centre));
  CHECK(std::abs(box.y + box.height / 2 - centre.y) <= 3);
  CHECK(changed(centre) == 0);  // the ring leaves the defect free
}

TEST_CASE(
    "the recipe's rules stand beside their limits, instead of the station's on the same reading",
    "[explain]") {
  Inspection part = seen_part();
  RecipeInForce recipe = recipe_for(part);
  const auto has = [&](const std::string& name) {
    const auto values = checked_values(part, &recipe, shipped().inspector);
    return std::any_of(values.begin(), values.end(),
                       [&](const CheckedValue& v) { return v.name == name; });
  };
  const std::vector<std::pair<RuleReading, std::string>> instead{
      {RuleReading::gloss_60_gu, "change of gloss 60"},
      {RuleReading::delta_e00, "colour"},
      {RuleReading::area_share, "loss of area"},
      {RuleReading::unknown_share, "of no taught material"},
      {RuleReading::tilt_deg, "tilt"}};
  for (const auto& [reading, name] : instead) {
    CAPTURE(name);
    recipe.recipe.rules.rules.clear();
    CHECK(has(name));
    Rule rule;
    rule.reading = reading;
    recipe.recipe.rules.rules = {rule};
    CHECK_FALSE(has(name));
  }
  RuleOutcome outcome;
  outcome.rule.reading = RuleReading::gloss_60_gu;
  outcome.cluster = 0;
  outcome.cluster_name = "<body>";
  outcome.value = 1.5;
  outcome.low = 1;
  outcome.high = 1.4;
  outcome.verdict = Verdict::reject;
  part.result.rules = {outcome};
  const std::string name = "rule: gloss_60_gu";
  const auto values = checked_values(part, &recipe, shipped().inspector);
  CHECK(named(values, name).state == CheckedValue::State::beyond);
  CHECK(named(values, name).ratio == Approx(1.5));  // of the way from the middle to the limit
  CHECK(named(values, name).cluster == 0);
  CHECK(says(explain_page(source(part, &recipe)), name));
  CHECK(says(explain_text(source(part, &recipe)), name));
}
