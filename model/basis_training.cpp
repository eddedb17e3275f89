#include "model/basis_training.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cstring>
#include <span>
#include <system_error>

#include "model/basis_format.hpp"
#include "model/error.hpp"
#include "model/gram.hpp"
#include "model/hash.hpp"
#include "model/mapped_file.hpp"
#include "model/parallel.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

/// Before the files are opened; that there are too few of them is open_sources()'s to say.
void check_options(std::size_t materials, const TrainingOptions& options) {
  if (materials < 2) return;
  const int most = static_cast<int>(3 * materials) - 1;
  if (options.components < 1 || options.components > most) {
    throw InputError(
        "components", std::to_string(options.components),
        "1 to " + std::to_string(most) + " for " + std::to_string(materials) + " materials");
  }
  const BasisGrid& g = options.grid;
  const auto [least, largest] = std::minmax({g.theta_h, g.theta_d, g.phi_d});
  if (least < 2 || largest > 1024) {
    throw InputError(
        "grid",
        std::to_string(g.theta_h) + "," + std::to_string(g.theta_d) + "," + std::to_string(g.phi_d),
        "2 to 1024 cells on each axis");
  }
}

/// Eigenvectors and singular values of the m x m Gram matrix, falling.
struct Decomposition {
  Eigen::MatrixXd u;  ///< m x k
  Eigen::VectorXd s;  ///< k
};
Decomposition decompose(const Eigen::MatrixXd& gram, int components) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(gram);
  if (solver.info() != Eigen::Success) {
    throw InputError("training set", "its Gram matrix cannot be decomposed");
  }
  // Eigen's come rising.
  return {solver.eigenvectors().rightCols(components).rowwise().reverse(),
          solver.eigenvalues().tail(components).reverse().cwiseMax(0.0).cwiseSqrt()};
}

/// The arrays of the file while they grow slab by slab.
struct BasisArrays {
  Eigen::VectorXd singular_values;
  std::vector<std::uint8_t> validity;
  std::vector<float> mean;
  std::vector<float> median;
  std::vector<Eigen::half> components;  ///< row after row
  Eigen::MatrixXf training_weights;     ///< m x k
  std::vector<Exemplar> exemplars;
  Eigen::MatrixXf exemplar_weights;  ///< exemplars x k

  void append(const Slab& slab, const MappedSlab& mapped, const Eigen::MatrixXd& q) {
    for (const std::size_t cell : slab.cells)
      validity[cell] = 1;
    for (Index j = 0; j < q.rows(); ++j) {
      mean.push_back(static_cast<float>(mapped.mean[j]));
      median.push_back(static_cast<float>(mapped.median[j]));
      for (Index i = 0; i < q.cols(); ++i)
        components.push_back(Eigen::half(static_cast<float>(q(j, i))));
    }
  }
  /// A half float's sign is one bit, so turning a component afterwards is exact.
  void turn(const std::vector<bool>& negative) {
    for (std::size_t i = 0; i < components.size(); ++i) {
      if (negative[i % negative.size()]) components[i] = -components[i];
    }
    for (std::size_t i = 0; i < negative.size(); ++i) {
      if (negative[i]) training_weights.col(static_cast<Index>(i)) *= -1;
    }
  }
};

/// Tells the share of the work that is done: two passes over the slabs.
void tell(const TrainingOptions& options, int slabs) {
  if (options.progress) options.progress(slabs / (2.0 * options.grid.theta_h));
}

/// What a checkpoint must have been made from.
std::string checkpoint_key(const TrainingSources& sources, const BasisGrid& grid) {
  constexpr int kRecipe = 1;  // raised when sampling or mapping change
  return sha256_hex(std::to_string(kRecipe) + " " + std::to_string(grid.theta_h) + " " +
                    std::to_string(grid.theta_d) + " " + std::to_string(grid.phi_d) + " " +
                    sources.files_hash);
}

GramOptions gram_options(const TrainingSources& sources, const TrainingOptions& options) {
  GramOptions gram;
  if (!sources.files.empty()) {
    gram.checkpoint = {options.checkpoint, checkpoint_key(sources, options.grid)};
  }
  gram.progress = [&options](int slabs) { tell(options, slabs); };
  gram.message = options.message;
  return gram;
}

/// Rows of Q = X^T U at a slab's cells.
Eigen::MatrixXd project_slab(const Slab& slab, const Eigen::MatrixXd& u) {
  constexpr int kBlock = 256;
  Eigen::MatrixXd q(slab.f.cols(), u.cols());
  parallel_for_blocks(static_cast<int>(slab.f.cols()), kBlock, [&](int first, int length) {
    q.middleRows(first, length).noalias() = slab.f.middleCols(first, length).transpose() * u;
  });
  return q;
}

BasisArrays project(const TrainingSources& sources, const Decomposition& basis,
                    const TrainingOptions& options) {
  const BasisGrid& grid = options.grid;
  BasisArrays arrays;
  arrays.singular_values = basis.s;
  arrays.training_weights = basis.u.cast<float>();
  arrays.validity.assign(grid.cells(), 0);
  arrays.components.reserve(grid.cells() * static_cast<std::size_t>(basis.s.size()));
  Eigen::RowVectorXd sums = Eigen::RowVectorXd::Zero(basis.s.size());
  for (int h = 0; h < grid.theta_h; ++h) {
    Slab slab = sample_slab(sources, grid, h);
    const MappedSlab mapped = map_slab(slab);
    const Eigen::MatrixXd q = project_slab(slab, basis.u);
    sums += q.colwise().sum();
    arrays.append(slab, mapped, q);
    sources.drop_pages();
    tell(options, grid.theta_h + h + 1);
  }
  std::vector<bool> negative(static_cast<std::size_t>(sums.size()));
  for (Index i = 0; i < sums.size(); ++i)
    negative[static_cast<std::size_t>(i)] = sums[i] < 0;
  arrays.turn(negative);
  return arrays;
}

/// Row after row, as the file has them.
using FileRows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

std::vector<std::byte> payload_of(const BasisArrays& arrays, const BasisInfo& info) {
  const BasisLayout at = basis_layout(info);
  std::vector<std::byte> payload(at.size);
  const auto put = [&](std::size_t offset, const auto* values, std::size_t count) {
    if (count > 0) std::memcpy(payload.data() + offset, values, count * sizeof *values);
  };
  const auto put_rows = [&put](std::size_t offset, const FileRows& rows) {
    put(offset, rows.data(), static_cast<std::size_t>(rows.size()));
  };
  put(at.singular_values, arrays.singular_values.data(), arrays.singular_values.size());
  put(at.validity, arrays.validity.data(), arrays.validity.size());
  put(at.mean, arrays.mean.data(), arrays.mean.size());
  put(at.median, arrays.median.data(), arrays.median.size());
  put(at.components, arrays.components.data(), arrays.components.size());
  put_rows(at.training_weights, arrays.training_weights);
  std::vector<ExemplarRecord> records;
  for (const Exemplar& e : arrays.exemplars)
    records.push_back(to_record(e));
  put(at.exemplars, records.data(), records.size());
  put_rows(at.exemplar_weights, arrays.exemplar_weights);
  return payload;
}

void write_basis(const BasisArrays& arrays, BasisInfo info, const std::filesystem::path& out) {
  info.exemplars = static_cast<int>(arrays.exemplars.size());
  const std::vector<std::byte> payload = payload_of(arrays, info);
  info.checksum = sha256_hex(payload);
  const std::string header = encode_basis_header(info);
  AtomicFile file(out);
  file.write(std::as_bytes(std::span(header)));
  file.write(payload);
  file.commit();
}

/// Exemplars are derived from the basis as a reader of the file sees it: half floats and grid
/// included. So the basis is written and read once without them.
void add_exemplars(BasisArrays& arrays, const BasisInfo& info, const ExemplarCounts& counts,
                   const std::filesystem::path& out) {
  if (counts.total() == 0) return;
  const std::filesystem::path draft = out.string() + ".draft";
  write_basis(arrays, info, draft);
  const auto basis = Basis::open(draft);
  std::filesystem::remove(draft);
  arrays.exemplars = draw_exemplars(*basis, counts);
  arrays.exemplar_weights = project_exemplars(*basis, arrays.exemplars).cast<float>();
}

void train(const TrainingSources& sources, const TrainingOptions& options,
           const std::filesystem::path& out) {
  static_cast<void>(AtomicFile(out));  // an unwritable place is known before the work
  const GramState gram = accumulate_gram(sources, options.grid, gram_options(sources, options));
  BasisArrays arrays = project(sources, decompose(gram.gram, options.components), options);
  BasisInfo info;
  info.grid = options.grid;
  info.valid_cells = arrays.mean.size();
  info.components = options.components;
  info.observations = static_cast<int>(sources.observations());
  info.training_set = sources.names();
  info.training_hash = sources.files_hash.empty() ? gram.values_hash : sources.files_hash;
  info.licence = options.licence;
  info.attribution = options.attribution;
  add_exemplars(arrays, info, options.exemplars, out);
  write_basis(arrays, info, out);
  if (!options.checkpoint.empty()) {
    std::error_code none;  // as a rule there is one
    std::filesystem::remove(options.checkpoint, none);
  }
}

}  // namespace

void train_basis(const std::vector<TrainingMaterial>& materials, const TrainingOptions& options,
                 const std::filesystem::path& out) {
  check_options(materials.size(), options);
  train(open_sources(materials), options, out);
}

void train_basis(const std::vector<NamedBrdf>& materials, const TrainingOptions& options,
                 const std::filesystem::path& out) {
  check_options(materials.size(), options);
  train(open_sources(materials), options, out);
}

}  // namespace brdfgate
