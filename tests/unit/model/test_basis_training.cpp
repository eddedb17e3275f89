#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "catch.hpp"
#include "model/basis_training.hpp"
#include "model/mapped_file.hpp"
#include "model/mapping.hpp"
#include "model/merl.hpp"
#include "support/input_error.hpp"
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

TEST_CASE("a basis from MERL files is that from the materials in them") {
  const TempDir dir;
  const auto all = test::small_training_set();
  std::vector<NamedBrdf> opened;
  std::vector<TrainingMaterial> files;
  for (const std::size_t i : {1, 3, 8}) {
    MerlTable table;
    for (int h = 0; h < 90; ++h) {
      for (int d = 0; d < 90; ++d) {
        for (int p = 0; p < 180; ++p) {
          const HalfDiff at = MerlFormat::centre(h, d, p);
          if (!cosines(at).above_horizon()) continue;
          const Rgb f = all[i].brdf->eval(at);
          for (std::size_t c = 0; c < 3; ++c)
            table.f[c][MerlFormat::cell(h, d, p)] = f[static_cast<Eigen::Index>(c)];
        }
      }
    }
    const auto file = dir / (all[i].name + ".binary");
    write_merl(file, table);
    files.push_back({all[i].name, file});
    opened.push_back({all[i].name, MerlBrdf::open(file)});
  }
  auto options = test::small_training_options(5);
  options.grid = {12, 8, 8};
  train_basis(files, options, dir / "files.basis");
  train_basis(opened, options, dir / "opened.basis");
  const auto a = Basis::open(dir / "files.basis");
  const auto b = Basis::open(dir / "opened.basis");
  CHECK(a->info().checksum == b->info().checksum);
  CHECK(a->info().training_hash != b->info().training_hash);  // files' bytes; sampled values
  files.push_back(files.front());
  CHECK(
      contains(input_error([&] { train_basis(files, options, dir / "c.basis"); }), files[0].name));
  files.back() = {"gone", dir / "gone.binary"};
  CHECK(
      contains(input_error([&] { train_basis(files, options, dir / "c.basis"); }), "gone.binary"));
  CHECK_FALSE(std::filesystem::exists(dir / "c.basis"));
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
