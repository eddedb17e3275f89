#include "model/training_sources.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "model/error.hpp"
#include "model/grid_stencil.hpp"
#include "model/hash.hpp"
#include "model/mapping.hpp"
#include "model/parallel.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

/// Cells belong to the basis when both cosines at their centre exceed this. Nearer to the horizon
/// f is extrapolated in every source and the cosine weight hides it; 0 gives the same error.
constexpr double kLeastCosine = 0.01;
/// A table that lacks more of its cells above the horizon is interpolation rather than measurement.
constexpr double kMostMissing = 0.1;

void check_name(const std::string& name) {
  const bool plain =
      std::none_of(name.begin(), name.end(), [](unsigned char c) { return c < 32 || c == ','; });
  if (name.empty() || !plain) {
    throw InputError("training material '" + name + "'", "is no usable name",
                     "text without commas and line breaks");
  }
}

template <typename Material>
void check_names(const std::vector<Material>& materials) {
  if (materials.size() < 2) {
    throw InputError("training set", std::to_string(materials.size()) + " material(s)",
                     "at least 2");
  }
  std::set<std::pair<int, std::string>> seen;
  for (const Material& m : materials) {
    check_name(m.name);
    if (!seen.insert({m.fit, m.name}).second) {
      throw InputError("training set", "two materials of the name '" + m.name + "'",
                       "each material once per fit");
    }
  }
}

/// Which MERL cells have both directions well above the horizon.
std::vector<bool> cells_above_horizon() {
  std::vector<bool> above(MerlFormat::kCells);
  for (int h = 0; h < MerlFormat::kThetaH; ++h) {
    for (int d = 0; d < MerlFormat::kThetaD; ++d) {
      for (int p = 0; p < MerlFormat::kPhiD; ++p) {
        above[MerlFormat::cell(h, d, p)] =
            cosines(MerlFormat::centre(h, d, p)).above_horizon(kLeastCosine);
      }
    }
  }
  return above;
}

void check_table(const std::filesystem::path& file, const MerlBrdf& table) {
  static const std::vector<bool> above = cells_above_horizon();
  static const auto cells = std::count(above.begin(), above.end(), true);
  for (int channel = 0; channel < 3; ++channel) {
    std::ptrdiff_t missing = 0;
    for (std::size_t i = 0; i < MerlFormat::kCells; ++i) {
      if (!above[i]) continue;
      const double v = table.raw(channel, i);
      if (v >= 0) continue;
      ++missing;
      if (v == MerlFormat::kMissing) continue;
      throw InputError(file,
                       "channel " + std::to_string(channel) + ", cell " + std::to_string(i) +
                           " above the horizon is " + std::to_string(v),
                       "a value of 0 or more, or -1 where missing");
    }
    const double share = static_cast<double>(missing) / static_cast<double>(cells);
    if (share > kMostMissing) {
      throw InputError(file,
                       "channel " + std::to_string(channel) + " lacks " +
                           std::to_string(std::lround(100 * share)) +
                           " % of its cells above the horizon",
                       "at most 10 %");
    }
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

/// Median of a column; the mean of the middle two where their number is even.
double median_of(std::vector<double>& column) {
  const auto middle = column.begin() + static_cast<std::ptrdiff_t>(column.size() / 2);
  std::nth_element(column.begin(), middle, column.end());
  return column.size() % 2 == 1 ? *middle
                                : (*middle + *std::max_element(column.begin(), middle)) / 2;
}

}  // namespace

void TrainingSources::drop_pages() const {
  for (const auto& file : files)
    file->drop_pages();
}

std::string TrainingSources::names() const {
  std::string list;
  for (const NamedBrdf& m : materials)
    list += (list.empty() ? "" : ",") + m.name;
  return list;
}

TrainingSources open_sources(const std::vector<TrainingMaterial>& materials) {
  check_names(materials);
  TrainingSources sources;
  sources.files.resize(materials.size());
  std::vector<std::string> hashes(materials.size());
  parallel_for_each(static_cast<int>(materials.size()), [&](int number) {
    const auto i = static_cast<std::size_t>(number);
    const auto table = MerlBrdf::open(materials[i].file);
    check_table(materials[i].file, *table);
    hashes[i] = sha256_hex(table->bytes());
    table->drop_pages();
    sources.files[i] = table;
  });
  std::string listing;
  for (std::size_t i = 0; i < materials.size(); ++i) {
    const TrainingMaterial& m = materials[i];
    sources.materials.push_back({m.name, sources.files[i], m.fit});
    // The first fit's line is as before there were several: the hash of a set is unchanged.
    listing += m.name + " " + hashes[i];
    if (m.fit != 0) listing += " fit " + std::to_string(m.fit);
    listing += "\n";
  }
  sources.files_hash = sha256_hex(listing);
  return sources;
}

TrainingSources open_sources(const std::vector<NamedBrdf>& materials) {
  check_names(materials);
  for (const NamedBrdf& m : materials) {
    if (m.brdf == nullptr) throw InputError("training material '" + m.name + "'", "has no BRDF");
  }
  TrainingSources sources;
  sources.materials = materials;
  return sources;
}

Slab sample_slab(const TrainingSources& sources, const BasisGrid& grid, int theta_h) {
  const HalfDiffGrid cells{grid.theta_h, grid.theta_d, grid.phi_d};
  Slab slab;
  std::vector<HalfDiff> angles;
  std::vector<double> weights;
  for (int d = 0; d < grid.theta_d; ++d) {
    for (int p = 0; p < grid.phi_d; ++p) {
      const HalfDiff at = cells.centre(theta_h, d, p);
      const Cosines c = cosines(at);
      if (!c.above_horizon(kLeastCosine)) continue;
      slab.cells.push_back(cells.cell(theta_h, d, p));
      angles.push_back(at);
      weights.push_back(cosine_weight(c));
    }
  }
  const auto n = static_cast<Index>(angles.size());
  slab.weight = Eigen::VectorXd::Map(weights.data(), n);
  slab.f.resize(sources.observations(), n);
  parallel_for_each(static_cast<int>(sources.materials.size()), [&](int i) {
    const NamedBrdf& material = sources.materials[static_cast<std::size_t>(i)];
    for (Index j = 0; j < n; ++j) {
      slab.f.block<3, 1>(3 * static_cast<Index>(i), j) =
          sample(material, angles[static_cast<std::size_t>(j)]);
    }
  });
  return slab;
}

MappedSlab map_slab(Slab& slab) {
  constexpr int kBlock = 256;
  MappedSlab mapped;
  mapped.median.resize(slab.f.cols());
  mapped.mean.resize(slab.f.cols());
  parallel_for_blocks(static_cast<int>(slab.f.cols()), kBlock, [&](int first, int length) {
    std::vector<double> column(static_cast<std::size_t>(slab.f.rows()));
    for (Index j = first; j < first + length; ++j) {
      Eigen::VectorXd::Map(column.data(), slab.f.rows()) = slab.f.col(j);
      const double reference = mapped.median[j] = median_of(column);
      const double w = slab.weight[j];
      slab.f.col(j) = slab.f.col(j).unaryExpr([=](double f) { return to_mapped(f, reference, w); });
      mapped.mean[j] = slab.f.col(j).mean();
      slab.f.col(j).array() -= mapped.mean[j];
    }
  });
  return mapped;
}

}  // namespace brdfgate
