#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "catch.hpp"
#include "model/basis.hpp"
#include "model/basis_format.hpp"
#include "model/hash.hpp"
#include "model/mapped_file.hpp"
#include "model/mapping.hpp"
#include "support/input_error.hpp"
#include "support/mutate.hpp"
#include "support/small_basis.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

const std::shared_ptr<const Basis>& shared_small_basis() {
  static const auto basis = test::small_basis();
  return basis;
}

/// Bytes of a small file, to be damaged.
const std::string& small_file() {
  static const std::string bytes = [] {
    const TempDir dir;
    train_basis(test::small_training_set(), test::small_training_options(), dir / "a.basis");
    const MappedFile file(dir / "a.basis");
    return std::string(reinterpret_cast<const char*>(file.bytes().data()), file.bytes().size());
  }();
  return bytes;
}

BasisHeader header_of(const std::string& bytes) {
  return decode_basis_header("a.basis", std::as_bytes(std::span(bytes)));
}

/// A file whose header and payload are changed but whose checksums are right: a hostile one.
std::string resealed(const std::function<void(BasisInfo&, std::string&)>& change) {
  BasisHeader header = header_of(small_file());
  std::string payload = small_file().substr(header.payload_start);
  change(header.info, payload);
  header.info.checksum = sha256_hex(payload);
  return encode_basis_header(header.info) + payload;
}

/// A file with one header line replaced and the header's checksum made right again.
std::string with_line(const std::string& field, const std::string& value) {
  const std::size_t payload_start = header_of(small_file()).payload_start;
  std::string lines = small_file().substr(8, small_file().find("header_checksum") - 8);
  const std::size_t start = lines.find(field + ": ");
  lines.replace(start, lines.find('\n', start) - start, field + ": " + value);
  std::string head =
      small_file().substr(0, 8) + lines + "header_checksum: " + sha256_hex(lines) + "\n\n";
  head.resize((head.size() + 63) / 64 * 64, '\0');
  return head + small_file().substr(payload_start);
}

std::string refusal(const std::string& bytes) {
  const TempDir dir;
  const auto file = dir.write("bad.basis", bytes);
  return input_error([&] { return Basis::open(file); });
}

template <typename T>
void put(std::string& payload, std::size_t offset, T value) {
  std::memcpy(payload.data() + offset, &value, sizeof value);
}

}  // namespace

TEST_CASE("a basis file says what it was made of") {
  const BasisInfo& info = shared_small_basis()->info();
  CHECK(info.version == 2);
  CHECK(info.grid == BasisGrid{24, 12, 12});
  CHECK(info.components == 12);
  CHECK(info.observations == 27);
  CHECK(info.epsilon == kMappingEpsilon);
  CHECK(contains(info.training_set, "material-0,material-1"));
  CHECK(info.licence == "none: made by a test");
  CHECK(info.attribution == "analytic models");
  CHECK(info.checksum.size() == 64);
  CHECK(info.training_hash.size() == 64);
  CHECK(shared_small_basis()->singular_values().size() == 12);
}

TEST_CASE("at cell centres rows are those of the file, and linear in the index between them") {
  const auto& basis = shared_small_basis();
  const BasisGrid grid = basis->info().grid;
  const HalfDiff a = grid.centre(5, 4, 3);
  const HalfDiff b = grid.centre(5, 5, 3);
  HalfDiff between = a;
  between.theta_d = 0.75 * a.theta_d + 0.25 * b.theta_d;
  const BasisRows rows = basis->rows({a, b, between});
  CHECK((rows.q.row(2) - (0.75 * rows.q.row(0) + 0.25 * rows.q.row(1))).norm() ==
        Approx(0).margin(1e-9 * rows.q.norm()));
  CHECK(rows.mean[2] == Approx(0.75 * rows.mean[0] + 0.25 * rows.mean[1]));
  CHECK(std::log(rows.median[2]) ==
        Approx(0.75 * std::log(rows.median[0]) + 0.25 * std::log(rows.median[1])));
  CHECK(rows.weight[2] == Approx(cosine_weight(cosines(between))));
}

TEST_CASE("where phi_d is undefined the basis does not depend on it") {
  const auto& basis = shared_small_basis();
  for (const double theta : {0.0, 0.4, 1.2}) {
    const BasisRows rows =
        basis->rows({{0, theta, 0}, {0, theta, 2}, {theta, 0, 0}, {theta, 0, 2}});
    for (const int j : {0, 2}) {
      CHECK((rows.q.row(j) - rows.q.row(j + 1)).norm() < 1e-12 * rows.q.row(j).norm());
      CHECK(rows.mean[j] == Approx(rows.mean[j + 1]).epsilon(1e-12));
      CHECK(rows.median[j] == Approx(rows.median[j + 1]).epsilon(1e-12));
    }
  }
}

TEST_CASE("directions at the horizon have finite rows") {
  const BasisRows rows = shared_small_basis()->rows(
      {{1.57, 0, 0}, {0, 1.57, 0}, {0.7, 0.86, 0}, {1.5, 1.5, 1.5707}, {1.5, 1.5, 0}});
  CHECK(rows.q.allFinite());
  CHECK(rows.mean.allFinite());
  CHECK((rows.median.array() > 0).all());
  CHECK((rows.weight.array() >= kMappingEpsilon).all());
}

TEST_CASE("weights zero reconstruct the training set's centre") {
  const auto& basis = shared_small_basis();
  const std::vector<HalfDiff> at{{0.1, 0.3, 1.0}, {0.5, 0.9, 2.0}};
  const BasisRows rows = basis->rows(at);
  const Eigen::VectorXd f = basis->reconstruct(Eigen::VectorXd::Zero(12), at);
  for (int j = 0; j < 2; ++j)
    CHECK(to_mapped(f[j], rows.median[j], rows.weight[j]) == Approx(rows.mean[j]).margin(1e-9));
  CHECK(contains(input_error([&] { return basis->reconstruct(Eigen::VectorXd::Zero(3), at); }),
                 "3 components"));
}

TEST_CASE("the rows of a whole grid agree with rows at directions") {
  const auto& basis = shared_small_basis();
  Eigen::MatrixXd c = Eigen::MatrixXd::Zero(12, 2);
  c(0, 0) = 0.1;
  c(3, 1) = -0.2;
  const Eigen::MatrixXf x = basis->mapped_rows(c);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(0, 1);
  for (int i = 0; i < 200; ++i) {
    const HalfDiff at{1.5 * u(random), 1.5 * u(random), 3.1 * u(random)};
    if (!cosines(at).above_horizon()) continue;
    const BasisRows rows = basis->rows({at});
    const Basis::Location place = basis->locate(at);
    Eigen::RowVectorXd mapped = Eigen::RowVectorXd::Zero(2);
    for (std::size_t j = 0; j < 8; ++j)
      mapped += place.weight[j] * x.row(place.row[j]).cast<double>();
    const Eigen::RowVectorXd expected = (rows.q * c).array() + rows.mean[0];
    CHECK((mapped - expected).norm() == Approx(0).margin(1e-5));
    CHECK(place.median == rows.median[0]);
  }
}

TEST_CASE("a damaged or foreign basis file is refused by the field that is wrong") {
  const std::string& good = small_file();
  const std::size_t start = header_of(good).payload_start;
  struct Damage {
    const char* field;
    std::string bytes;
  };
  std::string flipped = good;
  flipped[start + 5000] ^= 1;
  std::string edited = good;
  edited.replace(edited.find("analytic models"), 8, "measured");
  const std::vector<Damage> damages{
      {"magic", ""},
      {"magic", "PNG" + good},
      {"header", good.substr(0, 100)},
      {"header_checksum", edited},
      {"size", good.substr(0, good.size() - 1)},
      {"size", good + '\0'},
      {"checksum", flipped},
      {"version", with_line("version", "1")},
      {"grid", with_line("grid", "24 12")},
      {"grid", with_line("grid", "24 12 x")},
      {"grid", with_line("grid", "24 12 -12")},
      {"grid", with_line("grid", "99999999999 12 12")},
      {"grid", with_line("grid", "1024 1024 1024")},
      {"size", with_line("grid", "24 12 13")},
      {"valid_cells", with_line("valid_cells", "0")},
      {"valid_cells", with_line("valid_cells", "18446744073709551615")},
      {"components", with_line("components", "27")},
      {"components", with_line("components", "4294967308")},
      {"observations", with_line("observations", "1")},
      {"epsilon", with_line("epsilon", "0.01")},
      {"epsilon", with_line("epsilon", "nan")},
      {"licence", with_line("licence", "x\nlicence: y")},
      {"colour", with_line("licence", "x\ncolour: y")},
      {"licence", with_line("licence", "x\nlicence: ")},
  };
  for (const Damage& damage : damages) {
    const std::string error = refusal(damage.bytes);
    INFO(error);
    CHECK(contains(error, "bad.basis"));
    CHECK(contains(error, "field '" + std::string(damage.field) + "'"));
  }
}

TEST_CASE("values that no training makes are refused even under a right checksum") {
  const BasisLayout at = basis_layout(header_of(small_file()).info);
  const double infinite = std::numeric_limits<double>::infinity();
  struct Forgery {
    const char* field;
    std::function<void(BasisInfo&, std::string&)> change;
  };
  const std::vector<Forgery> forgeries{
      {"singular values",
       [&](BasisInfo&, std::string& p) { put(p, at.singular_values, infinite); }},
      {"singular values", [&](BasisInfo&, std::string& p) { put(p, at.singular_values + 8, 1e9); }},
      {"validity", [&](BasisInfo&, std::string& p) { p[at.validity] = 0; }},
      {"validity", [&](BasisInfo&, std::string& p) { p[at.validity + 5] = 7; }},
      {"validity",  // the same count, but the peak's ring has a hole
       [&](BasisInfo&, std::string& p) {
         p[at.validity] = 0;
         p[p.find('\0', at.validity + 1)] = 1;
       }},
      {"mean", [&](BasisInfo&, std::string& p) { put(p, at.mean, std::nanf("")); }},
      {"median", [&](BasisInfo&, std::string& p) { put(p, at.median + 4, -1.0F); }},
      {"components",
       [&](BasisInfo&, std::string& p) { put(p, at.components, std::uint16_t{0x7C00}); }},
  };
  for (const Forgery& forgery : forgeries) {
    const std::string error = refusal(resealed(forgery.change));
    INFO(error);
    CHECK(contains(error, "field '" + std::string(forgery.field) + "'"));
  }
}

TEST_CASE("no mutation of a header crashes the reader, and none is taken for the file") {
  const std::size_t start = header_of(small_file()).payload_start;
  const std::string head = small_file().substr(0, start);
  const std::string payload = small_file().substr(start);
  std::mt19937_64 random(11);
  for (int i = 0; i < 300; ++i) {
    const std::string other = test::mutated(head, random);
    // Only the padding may differ unnoticed.
    const std::string text = head.substr(0, head.find("\n\n") + 2);
    const std::string error = refusal(other + payload);
    if (error == "(no error)") {
      CHECK(other.substr(0, text.size()) == text);
    } else {
      CHECK(contains(error, "field '"));
    }
  }
}
