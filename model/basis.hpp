// The PCA basis of mapped measured materials (thesis, C.IV section 3), as a read-only file.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "model/brdf.hpp"
#include "model/exemplars.hpp"

namespace brdfgate {

/// Cells along theta_h (spaced as its square root, like MERL), theta_d and phi_d (both even).
struct BasisGrid {
  int theta_h = 45;
  int theta_d = 45;
  int phi_d = 45;
  std::size_t cells() const { return std::size_t(theta_h) * theta_d * phi_d; }
  HalfDiff centre(int h, int d, int p) const;  ///< angles of a cell's centre
  bool operator==(const BasisGrid&) const = default;
};

/// What the file says of itself.
struct BasisInfo {
  int version = 0;
  BasisGrid grid;
  std::size_t valid_cells = 0;  ///< cells above the horizon: those that the file has values for
  int components = 0;           ///< k
  int observations = 0;         ///< m = 3 x materials x fits
  int exemplars = 0;            ///< materials derived from the training set (exemplars.hpp)
  double epsilon = 0;           ///< of the mapping
  std::string training_set;     ///< names of the materials, comma-separated
  std::string training_hash;    ///< SHA-256 over the training files' contents, hex
  std::string licence;
  std::string attribution;
  std::string checksum;  ///< SHA-256 of everything behind the header, hex
};

/// The basis at n directions: what an estimator needs.
struct BasisRows {
  Eigen::MatrixXd q;       ///< n x k, rows of Q = V S
  Eigen::VectorXd mean;    ///< n, mu
  Eigen::VectorXd median;  ///< n, f_ref in 1/sr
  Eigen::VectorXd weight;  ///< n, cosine weight
};

/// Maps the file read-only and keeps it mapped. Immutable, thread-safe.
///
/// Between cell centres the mapped quantities (components, mean) run linearly in the axis indices
/// and f_ref linearly in its logarithm.
class Basis {
 public:
  /// Where a direction lies among the grid's rows (valid cells, then poles): up to eight rows.
  struct Location {
    std::array<std::uint32_t, 8> row;
    std::array<double, 8> weight;  ///< sum 1; unused rows have weight 0
    double median;                 ///< f_ref there, 1/sr
    double cosine_weight;          ///< w there
  };

  /// Throws InputError naming the file and the field that is wrong: magic, version, grid,
  /// components, size, checksum, a non-finite singular value.
  static std::shared_ptr<const Basis> open(const std::filesystem::path& file);
  ~Basis();

  const BasisInfo& info() const;
  /// Singular values S, k of them, falling.
  const Eigen::VectorXd& singular_values() const;
  /// The training observations' own weights U, m x k: rows of U S V^T = X - mu. Three rows (R, G,
  /// B) for each name of info().training_set in turn.
  const Eigen::MatrixXd& training_weights() const;
  /// Derived materials, and their weights in this basis, info().exemplars x k.
  const std::vector<Exemplar>& exemplars() const;
  const Eigen::MatrixXd& exemplar_weights() const;
  /// Rows at directions above the horizon, interpolated linearly in the axis indices over the valid
  /// neighbours (phi_d periodic over pi); where none is valid, the nearest valid cell toward the
  /// peak.
  BasisRows rows(const std::vector<HalfDiff>& directions) const;
  /// f in 1/sr at these directions for k weights c (C.IV eq. 10 and the inverse mapping).
  Eigen::VectorXd reconstruct(const Eigen::VectorXd& c,
                              const std::vector<HalfDiff>& directions) const;

  /// For looking up one material at very many directions: its mapped values at every row of the
  /// grid, rows x channels, for weights c of k x channels.
  Eigen::MatrixXf mapped_rows(const Eigen::MatrixXd& c) const;
  Location locate(const HalfDiff& direction) const;
  /// Row of a grid cell in mapped_rows(); none for a cell below the horizon.
  std::optional<std::size_t> row_of(int h, int d, int p) const;
  double median_of_row(std::size_t row) const;  ///< f_ref, 1/sr

 private:
  struct Mapping;
  explicit Basis(std::unique_ptr<Mapping> mapping);
  std::unique_ptr<Mapping> mapping_;
};

}  // namespace brdfgate
