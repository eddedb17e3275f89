#include "model/basis_training.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <set>
#include <span>

#include "model/basis_format.hpp"
#include "model/error.hpp"
#include "model/grid_stencil.hpp"
#include "model/hash.hpp"
#include "model/mapped_file.hpp"
#include "model/mapping.hpp"
#include "model/merl.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

/// Cells belong to the basis when both cosines at their centre exceed this. Nearer to the horizon
/// f is extrapolated in every source and the cosine weight hides it; 0 gives the same error.
constexpr double kLeastCosine = 0.01;

/// One theta_h of the grid: its cells above the horizon and every observation there.
struct Slab {
  std::vector<std::size_t> cells;
  Eigen::VectorXd weight;  ///< per cell
  Eigen::MatrixXd f;       ///< observations x cells, 1/sr
};

/// The training materials with what each source needs.
struct Sources {
  std::vector<NamedBrdf> materials;
  std::vector<std::shared_ptr<const MerlBrdf>> files;  ///< empty, or one per material

  Index observations() const { return 3 * static_cast<Index>(materials.size()); }
  void drop_pages() const {
    for (const auto& file : files)
      file->drop_pages();
  }
};

void check_name(const std::string& name) {
  const bool plain =
      std::none_of(name.begin(), name.end(), [](unsigned char c) { return c < 32 || c == ','; });
  if (name.empty() || !plain) {
    throw InputError("training material '" + name + "'", "is no usable name",
                     "text without commas and line breaks");
  }
}

void check_options(const std::vector<std::string>& names, const TrainingOptions& options) {
  if (names.size() < 2) {
    throw InputError("training set", std::to_string(names.size()) + " material(s)", "at least 2");
  }
  std::set<std::string> seen;
  for (const std::string& name : names) {
    check_name(name);
    if (!seen.insert(name).second) {
      throw InputError("training set", "two materials of the name '" + name + "'",
                       "each material once");
    }
  }
  const int most = static_cast<int>(3 * names.size()) - 1;
  if (options.components < 1 || options.components > most) {
    throw InputError(
        "components", std::to_string(options.components),
        "1 to " + std::to_string(most) + " for " + std::to_string(names.size()) + " materials");
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

Rgb sample(const NamedBrdf& material, const HalfDiff& at) {
  constexpr double kRounding = 1e-9;
  const Rgb f = material.brdf->diffuse(at.theta_d) + material.brdf->specular(at);
  if (!(f.isFinite().all() && (f > -kRounding).all())) {
    throw InputError("training material '" + material.name + "'",
                     "is " + std::to_string(f[0]) + ", " + std::to_string(f[1]) + ", " +
                         std::to_string(f[2]) + " at theta_h " + std::to_string(at.theta_h) +
                         ", theta_d " + std::to_string(at.theta_d) + ", phi_d " +
                         std::to_string(at.phi_d) + " rad",
                     "finite values, none negative");
  }
  return f.max(0.0);
}

Slab sample_slab(const Sources& sources, const HalfDiffGrid& grid, int h) {
  Slab slab;
  std::vector<HalfDiff> angles;
  for (int d = 0; d < grid.theta_d; ++d) {
    for (int p = 0; p < grid.phi_d; ++p) {
      const HalfDiff at = grid.centre(h, d, p);
      if (!cosines(at).above_horizon(kLeastCosine)) continue;
      slab.cells.push_back(grid.cell(h, d, p));
      angles.push_back(at);
    }
  }
  const auto n = static_cast<Index>(angles.size());
  slab.weight.resize(n);
  slab.f.resize(sources.observations(), n);
  for (Index j = 0; j < n; ++j)
    slab.weight[j] = cosine_weight(cosines(angles[static_cast<std::size_t>(j)]));
  for (std::size_t i = 0; i < sources.materials.size(); ++i) {
    for (Index j = 0; j < n; ++j) {
      slab.f.block<3, 1>(3 * static_cast<Index>(i), j) =
          sample(sources.materials[i], angles[static_cast<std::size_t>(j)]);
    }
  }
  return slab;
}

/// Median of each column; the mean of the middle two where their number is even.
Eigen::VectorXd column_medians(const Eigen::MatrixXd& values) {
  Eigen::VectorXd medians(values.cols());
  std::vector<double> column(static_cast<std::size_t>(values.rows()));
  const auto middle = column.begin() + values.rows() / 2;
  for (Index j = 0; j < values.cols(); ++j) {
    Eigen::VectorXd::Map(column.data(), values.rows()) = values.col(j);
    std::nth_element(column.begin(), middle, column.end());
    medians[j] = *middle;
    if (column.size() % 2 == 0)
      medians[j] = (*middle + *std::max_element(column.begin(), middle)) / 2;
  }
  return medians;
}

/// Turns a slab's reflectances into mapped values less their mean, in place (C.IV eq. 1, 2).
struct MappedSlab {
  Eigen::VectorXd median;
  Eigen::VectorXd mean;
};
MappedSlab map_slab(Slab& slab) {
  MappedSlab mapped;
  mapped.median = column_medians(slab.f);
  for (Index j = 0; j < slab.f.cols(); ++j) {
    const double reference = mapped.median[j];
    const double w = slab.weight[j];
    slab.f.col(j) = slab.f.col(j).unaryExpr([=](double f) { return to_mapped(f, reference, w); });
  }
  mapped.mean = slab.f.colwise().mean();
  slab.f.rowwise() -= mapped.mean.transpose();
  return mapped;
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
struct Arrays {
  Eigen::VectorXd singular_values;
  std::vector<std::uint8_t> validity;
  std::vector<float> mean;
  std::vector<float> median;
  std::vector<Eigen::half> components;  ///< row after row

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
  }
};

/// Tells the share of the work that is done: two passes over the slabs.
struct PassProgress {
  const TrainingOptions& options;
  int pass;
  void done(int h) const {
    const int all = options.grid.theta_h;
    if (options.progress) options.progress((pass * all + h + 1) / (2.0 * all));
  }
};

Eigen::MatrixXd gram_matrix(const Sources& sources, const HalfDiffGrid& grid,
                            const PassProgress& progress, std::string& values_hash) {
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(sources.observations(), sources.observations());
  for (int h = 0; h < grid.theta_h; ++h) {
    Slab slab = sample_slab(sources, grid, h);
    if (sources.files.empty()) {
      const std::span<const double> values(slab.f.data(), static_cast<std::size_t>(slab.f.size()));
      values_hash += sha256_hex(std::as_bytes(values));
      values_hash = sha256_hex(values_hash);
    }
    map_slab(slab);
    gram.selfadjointView<Eigen::Lower>().rankUpdate(slab.f);
    sources.drop_pages();
    progress.done(h);
  }
  return gram.selfadjointView<Eigen::Lower>();
}

Arrays project(const Sources& sources, const HalfDiffGrid& grid, const Decomposition& basis,
               const PassProgress& progress) {
  Arrays arrays;
  arrays.singular_values = basis.s;
  arrays.validity.assign(grid.cells(), 0);
  arrays.components.reserve(grid.cells() * static_cast<std::size_t>(basis.s.size()));
  Eigen::RowVectorXd sums = Eigen::RowVectorXd::Zero(basis.s.size());
  for (int h = 0; h < grid.theta_h; ++h) {
    Slab slab = sample_slab(sources, grid, h);
    const MappedSlab mapped = map_slab(slab);
    const Eigen::MatrixXd q = slab.f.transpose() * basis.u;
    sums += q.colwise().sum();
    arrays.append(slab, mapped, q);
    sources.drop_pages();
    progress.done(h);
  }
  std::vector<bool> negative(static_cast<std::size_t>(sums.size()));
  for (Index i = 0; i < sums.size(); ++i)
    negative[static_cast<std::size_t>(i)] = sums[i] < 0;
  arrays.turn(negative);
  return arrays;
}

std::vector<std::byte> payload_of(const Arrays& arrays, const BasisInfo& info) {
  const BasisLayout at = basis_layout(info);
  std::vector<std::byte> payload(at.size);
  const auto put = [&](std::size_t offset, const auto* values, std::size_t count) {
    std::memcpy(payload.data() + offset, values, count * sizeof *values);
  };
  put(at.singular_values, arrays.singular_values.data(), arrays.singular_values.size());
  put(at.validity, arrays.validity.data(), arrays.validity.size());
  put(at.mean, arrays.mean.data(), arrays.mean.size());
  put(at.median, arrays.median.data(), arrays.median.size());
  put(at.components, arrays.components.data(), arrays.components.size());
  return payload;
}

/// Trains and writes. `training_hash` empty: the hash is over the sampled values.
void train(const Sources& sources, const TrainingOptions& options, const std::string& training_hash,
           const std::filesystem::path& out) {
  AtomicFile file(out);  // before the work: an unwritable place is known at once
  const HalfDiffGrid grid{options.grid.theta_h, options.grid.theta_d, options.grid.phi_d};
  std::string values_hash;
  const Eigen::MatrixXd gram = gram_matrix(sources, grid, {options, 0}, values_hash);
  const Arrays arrays = project(sources, grid, decompose(gram, options.components), {options, 1});
  BasisInfo info;
  info.grid = options.grid;
  info.valid_cells = arrays.mean.size();
  info.components = options.components;
  info.observations = static_cast<int>(sources.observations());
  for (const NamedBrdf& m : sources.materials) {
    if (!info.training_set.empty()) info.training_set += ',';
    info.training_set += m.name;
  }
  info.training_hash = training_hash.empty() ? values_hash : training_hash;
  info.licence = options.licence;
  info.attribution = options.attribution;
  const std::vector<std::byte> payload = payload_of(arrays, info);
  info.checksum = sha256_hex(payload);
  const std::string header = encode_basis_header(info);
  file.write(std::as_bytes(std::span(header)));
  file.write(payload);
  file.commit();
}

template <typename Material>
std::vector<std::string> names_of(const std::vector<Material>& materials) {
  std::vector<std::string> names;
  names.reserve(materials.size());
  for (const Material& m : materials)
    names.push_back(m.name);
  return names;
}

}  // namespace

void train_basis(const std::vector<TrainingMaterial>& materials, const TrainingOptions& options,
                 const std::filesystem::path& out) {
  check_options(names_of(materials), options);
  Sources sources;
  std::string listing;
  for (const TrainingMaterial& m : materials) {
    sources.files.push_back(MerlBrdf::open(m.file));
    sources.materials.push_back({m.name, sources.files.back()});
    listing += m.name + " " + sha256_hex(sources.files.back()->bytes()) + "\n";
    sources.files.back()->drop_pages();
  }
  train(sources, options, sha256_hex(listing), out);
}

void train_basis(const std::vector<NamedBrdf>& materials, const TrainingOptions& options,
                 const std::filesystem::path& out) {
  check_options(names_of(materials), options);
  for (const NamedBrdf& m : materials) {
    if (m.brdf == nullptr) throw InputError("training material '" + m.name + "'", "has no BRDF");
  }
  train({materials, {}}, options, "", out);
}

}  // namespace brdfgate
