#include <opencv2/core/utility.hpp>
#include <set>

#include "app/basis_validation.hpp"
#include "catch.hpp"
#include "model/analytic.hpp"
#include "support/input_error.hpp"
#include "support/merl_files.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

/// Four lobes as MERL files and a second fit of one, a little off: written once.
struct Lobes {
  TempDir dir;
  std::vector<TrainingMaterial> training;
  std::vector<TestMaterial> tests;
  Lobes() {
    for (const double alpha : {0.1, 0.2, 0.3, 0.45})
      add("lobe-" + std::to_string(training.size()), alpha, 0);
    add("lobe-0", 0.11, 1);
    for (std::size_t i = 0; i < 4; ++i)
      tests.push_back({training[i].name, training[i].file});
  }
  void add(const std::string& name, double alpha, int fit) {
    GgxParameters p;
    p.alpha = alpha;
    p.diffuse = Rgb(0.1, 0.2, 0.3) * (1 + alpha);
    const auto file = dir / (name + "-" + std::to_string(fit) + ".binary");
    training.push_back({name, test::write_merl_file(file, *make_brdf(p)), fit});
  }
};
const Lobes& lobes() {
  static const Lobes made;
  return made;
}

CrossValidation small_folds() {
  CrossValidation options;
  options.folds = 2;
  options.training.components = 4;
  options.training.grid = {16, 8, 8};
  options.training.licence = "none";
  options.methods.names = {"ridge"};
  return options;
}

}  // namespace

TEST_CASE("Fold bases are not trained on what they are tested on, in any fit") {
  std::vector<double> told;
  const BasisValidation v = cross_validate(lobes().training, lobes().tests, small_folds(),
                                           [&](double share) { told.push_back(share); });
  REQUIRE(v.materials.size() == 4);
  CHECK(v.methods == std::vector<std::string>{"ridge"});
  std::set<int> folds;
  for (const MaterialErrors& m : v.materials) {
    CHECK_FALSE(m.seen);
    CHECK(m.errors[0].mapped_rms > 0.001);
    folds.insert(m.fold);
  }
  CHECK(folds == std::set<int>{0, 1});
  CHECK(std::is_sorted(told.begin(), told.end()));
  CHECK(told.back() == Approx(1.0));
  // Each fold's figure is that of a basis trained by hand without its materials.
  const TempDir dir;
  std::vector<TrainingMaterial> without;
  for (const TrainingMaterial& t : lobes().training) {
    const auto tested = std::find_if(v.materials.begin(), v.materials.end(),
                                     [&](const MaterialErrors& m) { return m.name == t.name; });
    if (tested->fold == 1) without.push_back(t);
  }
  train_basis(without, small_folds().training, dir / "a.basis");
  const BasisValidation held_out =
      validate_basis(Basis::open(dir / "a.basis"), lobes().tests, small_folds().methods);
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(held_out.materials[i].seen == (v.materials[i].fold == 1));
    if (v.materials[i].fold == 0) {
      CHECK(held_out.materials[i].errors[0].mapped_rms == v.materials[i].errors[0].mapped_rms);
    }
  }
}

TEST_CASE("A fold that leaves too few materials for the components is refused") {
  auto options = small_folds();
  options.training.components = 12;
  CHECK(contains(
      input_error([&] { return cross_validate(lobes().training, lobes().tests, options); }),
      "components"));
  options.folds = 5;
  CHECK(contains(
      input_error([&] { return cross_validate(lobes().training, lobes().tests, options); }),
      "folds"));
}

TEST_CASE("The table and the picture hold every material and method") {
  BasisValidation v;
  v.methods = {"ridge", "other"};
  for (const double error : {0.2, 0.5, 0.3}) {
    MaterialErrors m;
    m.name = "m" + std::to_string(v.materials.size());
    m.seen = v.materials.empty();
    m.fold = v.materials.empty() ? -1 : 2;
    m.errors = {{error, {error, error, error}, 1}, {error / 2, {0, 0, 0}, 1}};
    v.materials.push_back(m);
  }
  CHECK(v.worst_first(0) == std::vector<std::size_t>{1, 2, 0});
  CHECK(v.errors_of(1)[1] == 0.25);
  const std::string csv = to_csv(v);
  CHECK(std::count(csv.begin(), csv.end(), '\n') == 7);
  CHECK(contains(csv, "m0,1,,ridge,0.200000,"));
  CHECK(contains(csv, "m1,0,2,other,0.250000,"));
  const TempDir dir;
  draw_errors(v, "Errors", dir / "errors.png");
  CHECK(std::filesystem::file_size(dir / "errors.png") > 1000);
}

TEST_CASE("Unknown methods are refused by name") {
  auto options = small_folds();
  options.methods.names = {"guess"};
  CHECK(contains(
      input_error([&] { return cross_validate(lobes().training, lobes().tests, options); }),
      "guess"));
}
