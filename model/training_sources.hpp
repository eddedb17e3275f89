// The materials a basis is trained on, and their reflectance sampled slab by slab.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "model/basis.hpp"
#include "model/merl.hpp"

namespace brdfgate {

/// A material may be there once per fit: two independent fits of one measurement are two
/// observations of each of its colours, and what they differ by is the fits' own error.
struct TrainingMaterial {
  std::string name;
  std::filesystem::path file;  ///< MERL .binary
  int fit = 0;
};

/// A material that is not a file: an analytic model, another basis' reconstruction.
struct NamedBrdf {
  std::string name;
  BrdfPtr brdf;
  int fit = 0;
};

/// Opened and checked materials: three observations (R, G, B) each, in this order.
struct TrainingSources {
  std::vector<NamedBrdf> materials;
  std::vector<std::shared_ptr<const MerlBrdf>> files;  ///< empty, or one per material
  std::string files_hash;  ///< SHA-256 over names, fits and contents of the files; empty without

  Eigen::Index observations() const { return 3 * static_cast<Eigen::Index>(materials.size()); }
  /// Gives the files' mapped pages back.
  void drop_pages() const;
  /// Names separated by commas, in the order of the observations.
  std::string names() const;
};

/// Throws InputError naming the material: fewer than 2 of them, two of one name in one fit, a name
/// with a comma or a control character, an unusable file; in a file, NaN or negative values above
/// the horizon (-1 there means missing) and more than a tenth of the cells above the horizon
/// missing.
TrainingSources open_sources(const std::vector<TrainingMaterial>& materials);
/// The same for BRDF objects, whose values are checked where they are sampled.
TrainingSources open_sources(const std::vector<NamedBrdf>& materials);

/// One theta_h of the grid: its cells above the horizon and every observation there.
struct Slab {
  std::vector<std::size_t> cells;  ///< numbers in the grid
  Eigen::VectorXd weight;          ///< per cell, the cosine weight
  Eigen::MatrixXd f;               ///< observations x cells, 1/sr
};

/// Samples every material at the centres of the grid's cells of one theta_h, on all cores. Throws
/// InputError naming the material where a value is negative or not finite.
Slab sample_slab(const TrainingSources& sources, const BasisGrid& grid, int theta_h);

/// Turns a slab's reflectances into mapped values less their mean, in place (C.IV eq. 1, 2).
struct MappedSlab {
  Eigen::VectorXd median;  ///< per cell over the observations, 1/sr
  Eigen::VectorXd mean;    ///< per cell, of the mapped values
};
MappedSlab map_slab(Slab& slab);

}  // namespace brdfgate
