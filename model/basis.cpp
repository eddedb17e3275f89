#include "model/basis.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>

#include "model/basis_format.hpp"
#include "model/error.hpp"
#include "model/grid_stencil.hpp"
#include "model/hash.hpp"
#include "model/mapped_file.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

static_assert(std::endian::native == std::endian::little, "the format is little-endian");

constexpr std::uint32_t kNoRow = std::numeric_limits<std::uint32_t>::max();
/// Under this f_ref the logarithm is held, 1/sr: a black hundred times darker than epsilon.
constexpr float kLeastMedian = 1e-5F;

HalfDiffGrid lookup_grid(const BasisGrid& g) {
  return {g.theta_h, g.theta_d, g.phi_d};
}

template <typename T>
std::span<const T> array_at(std::span<const std::byte> payload, std::size_t offset,
                            std::size_t count) {
  return {reinterpret_cast<const T*>(payload.data() + offset), count};
}

}  // namespace

HalfDiff BasisGrid::centre(int h, int d, int p) const {
  return lookup_grid(*this).centre(h, d, p);
}

struct Basis::Mapping {
  explicit Mapping(const std::filesystem::path& path);

  std::size_t rows() const { return mean.size(); }
  /// Adds weight * row of Q to `sum`.
  void add_row(std::size_t row, double weight, Eigen::Ref<Eigen::RowVectorXd> sum) const;
  Eigen::RowVectorXf row(std::size_t row) const;

  std::filesystem::path name;
  MappedFile file;
  BasisInfo info;
  HalfDiffGrid grid;
  Eigen::VectorXd singular;
  std::span<const Eigen::half> components;  ///< valid cells x k
  // Per row: the valid cells, then the poles.
  std::vector<float> mean;
  std::vector<float> log_median;
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> pole_components;
  std::vector<std::uint32_t> row_of_node;
  Eigen::MatrixXd training_weights;
  std::vector<Exemplar> exemplars;
  Eigen::MatrixXd exemplar_weights;

 private:
  std::span<const std::byte> read_header();
  void read_singular_values(std::span<const double> values);
  void read_validity(std::span<const std::uint8_t> validity);
  void read_values(std::span<const float> means, std::span<const float> medians);
  void read_weights(Eigen::MatrixXd& weights, std::span<const float> values, const char* field);
  void read_exemplars(std::span<const ExemplarRecord> records);
  void make_poles();
};

std::span<const std::byte> Basis::Mapping::read_header() {
  BasisHeader header = decode_basis_header(name, file.bytes());
  const std::span<const std::byte> payload = file.bytes().subspan(header.payload_start);
  info = std::move(header.info);
  grid = lookup_grid(info.grid);
  const std::string computed = sha256_hex(payload);
  if (computed != info.checksum) {
    refuse_basis_field(name, "checksum", "is not that of the file's values: the file is damaged",
                       computed);
  }
  return payload;
}

void Basis::Mapping::read_singular_values(std::span<const double> values) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!(std::isfinite(values[i]) && values[i] >= 0 && (i == 0 || values[i] <= values[i - 1]))) {
      refuse_basis_field(name, "singular values",
                         "number " + std::to_string(i) + " is " + std::to_string(values[i]),
                         "finite, falling values");
    }
  }
  singular =
      Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

void Basis::Mapping::read_validity(std::span<const std::uint8_t> validity) {
  row_of_node.assign(grid.nodes(), kNoRow);
  std::uint32_t row = 0;
  for (std::size_t i = 0; i < validity.size(); ++i) {
    if (validity[i] > 1) refuse_basis_field(name, "validity", "has values other than 0 and 1");
    if (validity[i] == 1) row_of_node[i] = row++;
  }
  if (row != info.valid_cells) {
    refuse_basis_field(name, "validity", "marks " + std::to_string(row) + " cells",
                       std::to_string(info.valid_cells) + " (field 'valid_cells')");
  }
  // Every lookup ends at theta_h = theta_d = 0, if nowhere else.
  const auto ring = validity.first(static_cast<std::size_t>(grid.phi_d));
  if (std::find(ring.begin(), ring.end(), 0) != ring.end()) {
    refuse_basis_field(name, "validity",
                       "marks a cell at the smallest theta_h, theta_d as invalid");
  }
}

void Basis::Mapping::read_values(std::span<const float> means, std::span<const float> medians) {
  const auto finite = [](float v) { return std::isfinite(v); };
  if (!std::all_of(means.begin(), means.end(), finite)) {
    refuse_basis_field(name, "mean", "has non-finite values");
  }
  if (!std::all_of(medians.begin(), medians.end(),
                   [](float v) { return std::isfinite(v) && v >= 0; })) {
    refuse_basis_field(name, "median", "has negative or non-finite values");
  }
  const auto is_finite_half = [](Eigen::half h) { return (Eigen::numext::isfinite)(h); };
  if (!std::all_of(components.begin(), components.end(), is_finite_half)) {
    refuse_basis_field(name, "components", "has non-finite values");
  }
  mean.assign(means.begin(), means.end());
  log_median.resize(medians.size());
  std::transform(medians.begin(), medians.end(), log_median.begin(),
                 [](float v) { return std::log(std::max(v, kLeastMedian)); });
}

void Basis::Mapping::read_weights(Eigen::MatrixXd& weights, std::span<const float> values,
                                  const char* field) {
  using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  weights = Eigen::Map<const Rows>(values.data(),
                                   static_cast<Eigen::Index>(values.size()) / info.components,
                                   info.components)
                .cast<double>();
  if (!weights.allFinite()) refuse_basis_field(name, field, "has non-finite values");
}

void Basis::Mapping::read_exemplars(std::span<const ExemplarRecord> records) {
  for (const ExemplarRecord& record : records) {
    const auto whole = [](float v) { return std::isfinite(v) && std::abs(v) < 1e9F; };
    if (!whole(record[0]) || !is_valid(from_record(record), info.observations)) {
      refuse_basis_field(name, "exemplars",
                         "number " + std::to_string(exemplars.size()) + " is out of range");
    }
    exemplars.push_back(from_record(record));
  }
}

void Basis::Mapping::make_poles() {
  const int k = info.components;
  const std::size_t poles = grid.nodes() - grid.cells();
  pole_components.setZero(static_cast<Eigen::Index>(poles), k);
  // Components, mean and log median of a row, side by side.
  const auto row_values = [&](std::size_t cell) {
    const std::uint32_t r = row_of_node[cell];
    Eigen::RowVectorXd values(k + 2);
    values << row(r).cast<double>(), mean[r], log_median[r];
    return values;
  };
  std::size_t pole = 0;
  fill_poles(
      grid, Eigen::RowVectorXd(Eigen::RowVectorXd::Zero(k + 2)), row_values,
      [&](std::size_t cell) { return row_of_node[cell] != kNoRow; },
      [&](std::size_t node, const Eigen::RowVectorXd& average, int valid) {
        if (valid > 0) row_of_node[node] = static_cast<std::uint32_t>(info.valid_cells + pole);
        pole_components.row(static_cast<Eigen::Index>(pole)) = average.head(k).cast<float>();
        mean.push_back(static_cast<float>(average[k]));
        log_median.push_back(static_cast<float>(average[k + 1]));
        ++pole;
      });
}

Basis::Mapping::Mapping(const std::filesystem::path& path) : name(path), file(path) {
  const std::span<const std::byte> payload = read_header();
  const BasisLayout at = basis_layout(info);
  const auto k = static_cast<std::size_t>(info.components);
  components = array_at<Eigen::half>(payload, at.components, info.valid_cells * k);
  read_singular_values(array_at<double>(payload, at.singular_values, k));
  read_validity(array_at<std::uint8_t>(payload, at.validity, info.grid.cells()));
  read_values(array_at<float>(payload, at.mean, info.valid_cells),
              array_at<float>(payload, at.median, info.valid_cells));
  const auto m = static_cast<std::size_t>(info.observations);
  const auto derived = static_cast<std::size_t>(info.exemplars);
  read_weights(training_weights, array_at<float>(payload, at.training_weights, m * k),
               "training weights");
  read_exemplars(array_at<ExemplarRecord>(payload, at.exemplars, derived));
  read_weights(exemplar_weights, array_at<float>(payload, at.exemplar_weights, derived * k),
               "exemplar weights");
  make_poles();
}

Eigen::RowVectorXf Basis::Mapping::row(std::size_t row) const {
  if (row >= info.valid_cells) {
    return pole_components.row(static_cast<Eigen::Index>(row - info.valid_cells));
  }
  const auto k = static_cast<std::size_t>(info.components);
  return Eigen::Map<const Eigen::Matrix<Eigen::half, 1, Eigen::Dynamic>>(
             components.data() + row * k, info.components)
      .cast<float>();
}

void Basis::Mapping::add_row(std::size_t r, double weight,
                             Eigen::Ref<Eigen::RowVectorXd> sum) const {
  if (r >= info.valid_cells) {
    sum += weight *
           pole_components.row(static_cast<Eigen::Index>(r - info.valid_cells)).cast<double>();
    return;
  }
  const auto k = static_cast<std::size_t>(info.components);
  sum += weight * Eigen::Map<const Eigen::Matrix<Eigen::half, 1, Eigen::Dynamic>>(
                      components.data() + r * k, info.components)
                      .cast<float>()
                      .cast<double>();
}

Basis::Basis(std::unique_ptr<Mapping> mapping) : mapping_(std::move(mapping)) {}
Basis::~Basis() = default;

std::shared_ptr<const Basis> Basis::open(const std::filesystem::path& file) {
  // The constructor is private, so no make_shared.
  return std::shared_ptr<const Basis>(new Basis(std::make_unique<Mapping>(file)));
}

const BasisInfo& Basis::info() const {
  return mapping_->info;
}

const Eigen::VectorXd& Basis::singular_values() const {
  return mapping_->singular;
}

const Eigen::MatrixXd& Basis::training_weights() const {
  return mapping_->training_weights;
}

const std::vector<Exemplar>& Basis::exemplars() const {
  return mapping_->exemplars;
}

const Eigen::MatrixXd& Basis::exemplar_weights() const {
  return mapping_->exemplar_weights;
}

Basis::Location Basis::locate(const HalfDiff& direction) const {
  const Mapping& m = *mapping_;
  const GridStencil s = valid_stencil(
      m.grid, direction, [&](std::size_t node) { return m.row_of_node[node] != kNoRow; });
  Location at{};
  double log_median = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    if (!(s.weight[i] > 0)) continue;
    at.row[i] = m.row_of_node[s.node[i]];
    at.weight[i] = s.weight[i];
    log_median += s.weight[i] * m.log_median[at.row[i]];
  }
  at.median = std::exp(log_median);
  at.cosine_weight = cosine_weight(cosines(direction));
  return at;
}

BasisRows Basis::rows(const std::vector<HalfDiff>& directions) const {
  const auto n = static_cast<Eigen::Index>(directions.size());
  BasisRows rows;
  rows.q.resize(n, info().components);
  rows.mean.setZero(n);
  rows.median.resize(n);
  rows.weight.resize(n);
  Eigen::RowVectorXd q(info().components);
  for (Eigen::Index j = 0; j < n; ++j) {
    const Location at = locate(directions[static_cast<std::size_t>(j)]);
    q.setZero();
    for (std::size_t i = 0; i < 8; ++i) {
      if (!(at.weight[i] > 0)) continue;
      mapping_->add_row(at.row[i], at.weight[i], q);
      rows.mean[j] += at.weight[i] * mapping_->mean[at.row[i]];
    }
    rows.q.row(j) = q;
    rows.median[j] = at.median;
    rows.weight[j] = at.cosine_weight;
  }
  return rows;
}

Eigen::VectorXd Basis::reconstruct(const Eigen::VectorXd& c,
                                   const std::vector<HalfDiff>& directions) const {
  if (c.size() != info().components) {
    throw InputError("weights", std::to_string(c.size()) + " components",
                     std::to_string(info().components));
  }
  const BasisRows r = rows(directions);
  Eigen::VectorXd f = r.q * c + r.mean;
  for (Eigen::Index j = 0; j < f.size(); ++j)
    f[j] = from_mapped(f[j], r.median[j], r.weight[j]);
  return f;
}

Eigen::MatrixXf Basis::mapped_rows(const Eigen::MatrixXd& c) const {
  if (c.rows() != info().components) {
    throw InputError("weights", std::to_string(c.rows()) + " components",
                     std::to_string(info().components));
  }
  const Eigen::MatrixXf weights = c.cast<float>();
  const auto n = static_cast<Eigen::Index>(mapping_->rows());
  Eigen::MatrixXf x(n, c.cols());
  for (Eigen::Index r = 0; r < n; ++r) {
    x.row(r).noalias() = mapping_->row(static_cast<std::size_t>(r)) * weights;
    x.row(r).array() += mapping_->mean[static_cast<std::size_t>(r)];
  }
  return x;
}

std::optional<std::size_t> Basis::row_of(int h, int d, int p) const {
  const std::uint32_t row = mapping_->row_of_node[mapping_->grid.cell(h, d, p)];
  return row == kNoRow ? std::nullopt : std::optional<std::size_t>(row);
}

double Basis::median_of_row(std::size_t row) const {
  return std::exp(mapping_->log_median[row]);
}

}  // namespace brdfgate
