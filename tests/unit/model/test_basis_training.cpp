#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <vector>

#include "catch.hpp"
#include "model/basis_training.hpp"
#include "model/mapped_file.hpp"
#include "model/mapping.hpp"
#include "model/merl.hpp"
#include "support/input_error.hpp"
#include "support/merl_files.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

/// The mapped observations by plain loops: m x cells above the basis' horizon, and those cells.
struct Direct {
  std::vector<HalfDiff> cells;
  Eigen::MatrixXd x;
  Eigen::VectorXd median;
};
Direct map_directly(const std::vector<NamedBrdf>& set, const BasisGrid& grid) {
  Direct direct;
  for (int h = 0; h < grid.theta_h; ++h) {
    for (int d = 0; d < grid.theta_d; ++d) {
      for (int p = 0; p < grid.phi_d; ++p) {
        const HalfDiff at = grid.centre(h, d, p);
        if (cosines(at).above_horizon(0.01)) direct.cells.push_back(at);
      }
    }
  }
  const auto n = static_cast<Eigen::Index>(direct.cells.size());
  const auto m = static_cast<Eigen::Index>(3 * set.size());
  direct.x.resize(m, n);
  direct.median.resize(n);
  for (Eigen::Index j = 0; j < n; ++j) {
    const HalfDiff& at = direct.cells[static_cast<std::size_t>(j)];
    std::vector<double> f;
    for (const NamedBrdf& material : set) {
      const Rgb v = material.brdf->eval(at);
      f.insert(f.end(), v.begin(), v.end());
    }
    std::vector<double> sorted = f;
    std::sort(sorted.begin(), sorted.end());
    const std::size_t half = sorted.size() / 2;
    direct.median[j] =
        sorted.size() % 2 == 1 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
    for (Eigen::Index i = 0; i < m; ++i) {
      direct.x(i, j) =
          to_mapped(f[static_cast<std::size_t>(i)], direct.median[j], cosine_weight(cosines(at)));
    }
  }
  return direct;
}

/// A BRDF that is wrong in one place.
class Wrong final : public Brdf {
 public:
  explicit Wrong(double value) : value_(value) {}
  Rgb diffuse(double) const override { return Rgb::Constant(0.1); }
  Rgb specular(const HalfDiff& a) const override {
    return Rgb::Constant(a.theta_h > 0.5 ? value_ : 0.0);
  }

 private:
  double value_;
};

std::string bytes_of(const std::filesystem::path& file) {
  const MappedFile mapped(file);
  return {reinterpret_cast<const char*>(mapped.bytes().data()), mapped.bytes().size()};
}

}  // namespace

TEST_CASE("a trained basis is the singular value decomposition of the mapped observations") {
  // An independent way: the SVD of the whole matrix instead of the Gram matrix in slabs. An even
  // and an odd number of observations: the median of an even number is the mean of the middle two.
  for (const std::size_t materials : {9, 8}) {
    auto set = test::small_training_set();
    set.resize(materials);
    auto options = test::small_training_options(10);
    options.grid = {10, 6, 6};
    const TempDir dir;
    train_basis(set, options, dir / "a.basis");
    const auto basis = Basis::open(dir / "a.basis");

    Direct direct = map_directly(set, options.grid);
    const Eigen::RowVectorXd mean = direct.x.colwise().mean();
    direct.x.rowwise() -= mean;
    const Eigen::BDCSVD<Eigen::MatrixXd> svd(direct.x, Eigen::ComputeThinU | Eigen::ComputeThinV);
    const BasisRows rows = basis->rows(direct.cells);
    CHECK(basis->info().valid_cells == direct.cells.size());
    CHECK((rows.mean - mean.transpose()).cwiseAbs().maxCoeff() < 1e-5);
    CHECK(((rows.median - direct.median).array() / direct.median.array()).abs().maxCoeff() < 1e-5);
    for (int i = 0; i < 10; ++i) {
      const double s = svd.singularValues()[i];
      CHECK(basis->singular_values()[i] == Approx(s).epsilon(1e-6).margin(1e-6));
      Eigen::VectorXd q = s * svd.matrixV().col(i);
      if (q.sum() < 0) q = -q;
      if (s < 1e-3) continue;                               // a direction of rounding only
      CHECK((rows.q.col(i) - q).norm() < 2e-3 * q.norm());  // half floats: 2^-11 each
    }
  }
}

TEST_CASE("each component's sum over its cells is positive and its length its singular value") {
  const auto basis = test::small_basis();
  const BasisGrid grid = basis->info().grid;
  std::vector<HalfDiff> cells;
  for (int h = 0; h < grid.theta_h; ++h) {
    for (int d = 0; d < grid.theta_d; ++d) {
      for (int p = 0; p < grid.phi_d; ++p) {
        if (basis->row_of(h, d, p)) cells.push_back(grid.centre(h, d, p));
      }
    }
  }
  const Eigen::MatrixXd q = basis->rows(cells).q;
  for (Eigen::Index i = 0; i < q.cols(); ++i) {
    CHECK(q.col(i).sum() > 0);
    CHECK(q.col(i).norm() == Approx(basis->singular_values()[i]).epsilon(1e-3));
  }
  const Eigen::MatrixXd gram = q.transpose() * q;
  CHECK(std::abs(gram(0, 1)) < 1e-3 * gram(0, 0));
}

TEST_CASE("with all components a training material is reconstructed from its own weights") {
  const auto set = test::small_training_set();
  const auto basis = test::small_basis(26);
  const BasisGrid grid = basis->info().grid;
  std::vector<HalfDiff> cells;
  for (int h = 0; h < grid.theta_h; h += 2) {
    for (int d = 0; d < grid.theta_d; ++d) {
      if (basis->row_of(h, d, 5)) cells.push_back(grid.centre(h, d, 5));
    }
  }
  const BasisRows rows = basis->rows(cells);
  const auto& material = set[5].brdf;
  Eigen::VectorXd x(rows.q.rows());
  for (Eigen::Index j = 0; j < x.size(); ++j) {
    x[j] = to_mapped(material->eval(cells[static_cast<std::size_t>(j)])[1], rows.median[j],
                     rows.weight[j]) -
           rows.mean[j];
  }
  const Eigen::VectorXd c = rows.q.colPivHouseholderQr().solve(x);
  CHECK((rows.q * c - x).cwiseAbs().maxCoeff() < 0.02);
}

TEST_CASE("training is deterministic and tells its progress") {
  const TempDir dir;
  auto options = test::small_training_options();
  std::vector<double> told;
  options.progress = [&](double share) { told.push_back(share); };
  train_basis(test::small_training_set(), options, dir / "a.basis");
  train_basis(test::small_training_set(), options, dir / "b.basis");
  CHECK(bytes_of(dir / "a.basis") == bytes_of(dir / "b.basis"));
  REQUIRE(told.size() == 2 * 2 * 24);
  CHECK(std::is_sorted(told.begin(), told.begin() + 48));
  CHECK(told[47] == 1.0);
}

namespace {

/// Three materials as MERL files, and a second fit of the first: written once.
struct Files {
  TempDir dir;
  std::vector<TrainingMaterial> fits;
  Files() {
    const auto all = test::small_training_set();
    for (const std::size_t i : {1, 3, 8})
      fits.push_back(
          {all[i].name, test::write_merl_file(dir / (all[i].name + ".binary"), *all[i].brdf)});
    fits.push_back({all[1].name, test::write_merl_file(dir / "refit.binary", *all[2].brdf), 1});
  }
};
const std::vector<TrainingMaterial>& all_fits() {
  static const Files made;
  return made.fits;
}
std::vector<TrainingMaterial> first_fit() {
  return {all_fits().begin(), all_fits().begin() + 3};
}

TrainingOptions file_options() {
  auto options = test::small_training_options(5);
  options.grid = {12, 8, 8};
  return options;
}

struct Interrupted : std::runtime_error {
  Interrupted() : std::runtime_error("interrupted") {}
};

}  // namespace

TEST_CASE("a basis from MERL files is that from the materials in them") {
  const TempDir dir;
  std::vector<NamedBrdf> opened;
  for (const TrainingMaterial& m : first_fit())
    opened.push_back({m.name, MerlBrdf::open(m.file)});
  train_basis(first_fit(), file_options(), dir / "files.basis");
  train_basis(opened, file_options(), dir / "opened.basis");
  const auto a = Basis::open(dir / "files.basis");
  const auto b = Basis::open(dir / "opened.basis");
  CHECK(a->info().checksum == b->info().checksum);
  CHECK(a->info().training_hash != b->info().training_hash);  // files' bytes; sampled values
}

TEST_CASE("a second fit adds three observations and another hash; twice in one fit is refused") {
  const TempDir dir;
  train_basis(first_fit(), file_options(), dir / "one.basis");
  train_basis(all_fits(), file_options(), dir / "two.basis");
  const auto one = Basis::open(dir / "one.basis")->info();
  const auto two = Basis::open(dir / "two.basis")->info();
  CHECK(one.observations == 9);
  CHECK(two.observations == 12);
  CHECK(two.training_set == one.training_set + "," + first_fit()[0].name);
  CHECK(two.training_hash != one.training_hash);
  auto twice = all_fits();
  twice.back().fit = 0;
  const std::string error =
      input_error([&] { train_basis(twice, file_options(), dir / "c.basis"); });
  CHECK(contains(error, "'" + twice.back().name + "'"));
  CHECK(contains(error, "once per fit"));
}

TEST_CASE("an interrupted training goes on to the same file and removes its checkpoint") {
  const TempDir dir;
  auto options = file_options();
  train_basis(first_fit(), options, dir / "whole.basis");
  options.checkpoint = dir / "a.basis.checkpoint";
  std::string message;
  options.message = [&](const std::string& m) { message += m; };
  for (const double share : {0.3, 0.7}) {  // in the first pass, in the second
    options.progress = [share](double done) {
      if (done > share) throw Interrupted();
    };
    CHECK_THROWS_AS(train_basis(first_fit(), options, dir / "a.basis"), Interrupted);
    CHECK(std::filesystem::exists(options.checkpoint));
    CHECK_FALSE(std::filesystem::exists(dir / "a.basis"));
  }
  options.progress = nullptr;
  // Other materials do not go on from it.
  message.clear();
  auto others = options;
  others.checkpoint = dir / "b.basis.checkpoint";
  std::filesystem::copy(options.checkpoint, others.checkpoint);
  train_basis(all_fits(), others, dir / "b.basis");
  CHECK(contains(message, "starts anew"));
  message.clear();
  train_basis(first_fit(), options, dir / "a.basis");
  CHECK(contains(message, "goes on after slab 12"));
  CHECK(bytes_of(dir / "a.basis") == bytes_of(dir / "whole.basis"));
  CHECK_FALSE(std::filesystem::exists(options.checkpoint));
}

TEST_CASE("unusable MERL files are refused by name, and nothing is written") {
  const TempDir dir;
  const std::size_t inside = MerlFormat::cell(40, 20, 90);
  const std::size_t below = MerlFormat::cell(89, 89, 90);
  // The values of a file, one of them replaced.
  const auto with_value = [&](std::size_t cell, double value) {
    const MappedFile whole(first_fit()[0].file);
    std::string bytes(reinterpret_cast<const char*>(whole.bytes().data()), whole.bytes().size());
    std::memcpy(bytes.data() + 12 + cell * sizeof value, &value, sizeof value);
    return bytes;
  };
  const auto error_with = [&](const std::string& bytes) {
    auto set = first_fit();
    set.push_back({"bad", dir.write("bad.binary", bytes)});
    const std::string error =
        input_error([&] { train_basis(set, file_options(), dir / "out.basis"); });
    CHECK(std::filesystem::remove(dir / "out.basis") == (error == "(no error)"));
    return error;
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const auto& [bytes, says] : std::vector<std::pair<std::string, std::string>>{
           {with_value(inside, nan), "nan"},
           {with_value(inside, -0.25), "-0.25"},
           {with_value(0, 1).substr(0, 1000000), "truncated"},
           {"", "no MERL"}}) {
    const std::string error = error_with(bytes);
    CHECK(contains(error, "bad.binary"));
    CHECK(contains(error, says));
  }
  CHECK(error_with(with_value(below, -7)) == "(no error)");   // below the horizon nobody looks
  CHECK(error_with(with_value(inside, -1)) == "(no error)");  // a missing cell
}

TEST_CASE("MERL files with nothing, or too little, above the horizon are refused") {
  const TempDir dir;
  MerlTable table = test::merl_table(*test::small_training_set()[1].brdf);
  const auto error = [&] {
    write_merl(dir / "bad.binary", table);
    auto set = first_fit();
    set.push_back({"bad", dir / "bad.binary"});
    return input_error([&] { train_basis(set, file_options(), dir / "out.basis"); });
  };
  std::fill_n(table.f[1].begin(), MerlFormat::kCells / 5, -1.0);
  CHECK(contains(error(), "channel 1 lacks"));
  table.f[1].assign(MerlFormat::kCells, -1.0);
  CHECK(contains(error(), "channel 1 has no valid cell"));
  const std::string gone = input_error([&] {
    auto set = first_fit();
    set.push_back({"gone", dir / "gone.binary"});
    train_basis(set, file_options(), dir / "out.basis");
  });
  CHECK(contains(gone, "gone.binary"));
  CHECK_FALSE(std::filesystem::exists(dir / "out.basis"));
}

TEST_CASE("a basis with cells up to the horizon opens again and has rows there") {
  const TempDir dir;
  auto options = test::small_training_options();
  options.grid = {4, 120, 2};  // the last theta_d centre is 0.4 degrees off the horizon
  train_basis(test::small_training_set(), options, dir / "a.basis");
  const auto basis = Basis::open(dir / "a.basis");
  CHECK_FALSE(basis->row_of(0, 119, 0).has_value());
  CHECK(basis->rows({{0.0, 1.5704, 0.0}, {1.0, 1.5704, 1.5708}}).q.allFinite());
}

TEST_CASE("training sets that give no basis are refused by name") {
  const TempDir dir;
  const auto set = test::small_training_set();
  const auto error_with = [&](std::vector<NamedBrdf> materials, const TrainingOptions& options) {
    const std::string error =
        input_error([&] { train_basis(materials, options, dir / "a.basis"); });
    CHECK(std::filesystem::is_empty(dir.path()));
    return error;
  };
  const auto with = [&](const std::string& name, BrdfPtr brdf) {
    auto more = set;
    more.push_back({name, std::move(brdf)});
    return more;
  };
  const TrainingOptions good = test::small_training_options();
  CHECK(contains(error_with({set[0]}, good), "1 material"));
  CHECK(contains(error_with(with("material-3", set[0].brdf), good), "'material-3'"));
  CHECK(contains(error_with(with("a,b", set[0].brdf), good), "a,b"));
  CHECK(contains(error_with(with("none", nullptr), good), "'none'"));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(contains(error_with(with("broken", std::make_shared<Wrong>(nan)), good), "'broken'"));
  CHECK(contains(error_with(with("dark", std::make_shared<Wrong>(-0.2)), good), "'dark'"));
  CHECK(contains(error_with(set, test::small_training_options(27)), "components"));
  CHECK(contains(error_with(set, test::small_training_options(0)), "components"));
  auto flat = good;
  flat.grid.theta_d = 1;
  CHECK(contains(error_with(set, flat), "grid"));
  auto broken_line = good;
  broken_line.licence = "two\nlines";
  CHECK(contains(error_with(set, broken_line), "licence"));
}
