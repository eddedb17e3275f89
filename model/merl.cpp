#include "model/merl.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <numbers>
#include <span>
#include <string>

#include "model/error.hpp"
#include "model/grid_stencil.hpp"
#include "model/mapped_file.hpp"

namespace brdfgate {
namespace {

static_assert(std::endian::native == std::endian::little, "the format is little-endian");

constexpr HalfDiffGrid kGrid{MerlFormat::kThetaH, MerlFormat::kThetaD, MerlFormat::kPhiD};
constexpr std::size_t kHeaderBytes = 3 * sizeof(std::int32_t);
constexpr std::size_t kFileBytes = kHeaderBytes + 3 * MerlFormat::kCells * sizeof(double);
constexpr double kMissing = MerlFormat::kMissing;
/// The diffuse part is the minimum over theta_h below this (scene file definition).
constexpr double kDiffuseBelow = std::numbers::pi / 3;

bool is_value(double v) {
  return v >= 0 && v <= std::numeric_limits<double>::max();
}

std::string describe(int channel, int h, int d, int p) {
  return "channel " + std::to_string(channel) + ", cell (" + std::to_string(h) + ", " +
         std::to_string(d) + ", " + std::to_string(p) + ")";
}

void check_size(const std::filesystem::path& file, std::span<const std::byte> bytes) {
  if (bytes.size() < kHeaderBytes) {
    throw InputError(file, std::to_string(bytes.size()) + " bytes is no MERL .binary file",
                     std::to_string(kFileBytes) + " bytes");
  }
  std::array<std::int32_t, 3> dims{};
  std::memcpy(dims.data(), bytes.data(), kHeaderBytes);
  if (dims != std::array<std::int32_t, 3>{kGrid.theta_h, kGrid.theta_d, kGrid.phi_d}) {
    throw InputError(file,
                     "dimensions " + std::to_string(dims[0]) + " x " + std::to_string(dims[1]) +
                         " x " + std::to_string(dims[2]),
                     "90 x 90 x 180 (MERL .binary)");
  }
  if (bytes.size() != kFileBytes) {
    throw InputError(file,
                     std::to_string(bytes.size()) + " bytes" +
                         (bytes.size() < kFileBytes ? ", truncated" : ", too long"),
                     std::to_string(kFileBytes) + " bytes");
  }
}

}  // namespace

HalfDiff MerlFormat::centre(int h, int d, int p) {
  return kGrid.centre(h, d, p);
}

struct MerlBrdf::Mapping {
  explicit Mapping(const std::filesystem::path& path) : name(path), file(path) {
    check_size(name, file.bytes());
    values = file.bytes().data() + kHeaderBytes;
    for (auto& plane : poles)
      plane.resize(kGrid.nodes() - kGrid.cells());
  }

  /// As on file. Doubles start at byte 12, so they are not aligned.
  double raw(int channel, std::size_t index) const {
    double v = 0;
    std::memcpy(&v, values + (channel * MerlFormat::kCells + index) * sizeof(double), sizeof v);
    return v;
  }
  double at_node(int channel, std::size_t node) const {
    return node < MerlFormat::kCells ? raw(channel, node)
                                     : poles[channel][node - MerlFormat::kCells];
  }

  /// Refuses non-finite cells above the horizon and files without a single value.
  void check_values() const;
  void make_poles();
  Rgb diffuse_of_cell(int d) const;
  /// One channel by itself: the slow way of table(), where a neighbourhood has no valid node.
  double channel_value(int channel, const HalfDiff& angles) const;

  std::filesystem::path name;
  MappedFile file;
  const std::byte* values = nullptr;
  std::array<std::vector<double>, 3>
      poles;  ///< in the file's scale; kMissing where nothing is valid
};

void MerlBrdf::Mapping::check_values() const {
  std::array<std::size_t, 3> count{};
  for (int channel = 0; channel < 3; ++channel) {
    for (std::size_t i = 0; i < MerlFormat::kCells; ++i) {
      const double v = raw(channel, i);
      if (is_value(v)) {
        ++count[channel];
      } else if (!std::isfinite(v)) {
        const int p = static_cast<int>(i % kGrid.phi_d);
        const int d = static_cast<int>(i / kGrid.phi_d % kGrid.theta_d);
        const int h = static_cast<int>(i / kGrid.phi_d / kGrid.theta_d);
        if (cosines(kGrid.centre(h, d, p)).above_horizon()) {
          throw InputError(name, describe(channel, h, d, p) + " is " + std::to_string(v),
                           "a finite value above the horizon (negative where missing)");
        }
      }
    }
    if (count[channel] == 0) {
      throw InputError(name, "channel " + std::to_string(channel) + " has no valid cell",
                       "reflectance values of 0 or more");
    }
  }
}

void MerlBrdf::Mapping::make_poles() {
  for (int channel = 0; channel < 3; ++channel) {
    fill_poles(
        kGrid, 0.0, [&](std::size_t i) { return raw(channel, i); },
        [&](std::size_t i) { return is_value(raw(channel, i)); },
        [&](std::size_t node, double mean, int valid) {
          poles[channel][node - MerlFormat::kCells] = valid > 0 ? mean : kMissing;
        });
  }
}

Rgb MerlBrdf::Mapping::diffuse_of_cell(int d) const {
  Rgb least = Rgb::Constant(std::numeric_limits<double>::infinity());
  for (int h = 0; h < kGrid.theta_h && kGrid.centre(h, d, 0).theta_h < kDiffuseBelow; ++h) {
    for (int p = 0; p < kGrid.phi_d; ++p) {
      const std::size_t i = kGrid.cell(h, d, p);
      for (int channel = 0; channel < 3; ++channel) {
        const double v = raw(channel, i);
        if (is_value(v)) least[channel] = std::min(least[channel], v);
      }
    }
  }
  return least;
}

double MerlBrdf::Mapping::channel_value(int channel, const HalfDiff& angles) const {
  const GridStencil s = valid_stencil(
      kGrid, angles, [&](std::size_t node) { return is_value(at_node(channel, node)); });
  double sum = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    if (s.weight[i] > 0) sum += s.weight[i] * at_node(channel, s.node[i]);
  }
  return sum;
}

MerlBrdf::MerlBrdf(std::unique_ptr<Mapping> mapping) : mapping_(std::move(mapping)) {
  Rgb last = Rgb::Zero();  // a theta_d without any valid cell takes its neighbour's
  for (int d = 0; d < kGrid.theta_d; ++d) {
    const Rgb least = mapping_->diffuse_of_cell(d);
    for (int channel = 0; channel < 3; ++channel) {
      if (std::isfinite(least[channel])) {
        last[channel] = least[channel] * MerlFormat::kScale[channel];
      }
    }
    diffuse_[d] = last;
  }
}

MerlBrdf::~MerlBrdf() = default;

std::shared_ptr<const MerlBrdf> MerlBrdf::open(const std::filesystem::path& file) {
  auto mapping = std::make_unique<Mapping>(file);
  mapping->check_values();
  mapping->make_poles();
  // The constructor is private, so no make_shared.
  return std::shared_ptr<const MerlBrdf>(new MerlBrdf(std::move(mapping)));
}

Rgb MerlBrdf::diffuse(double theta_d) const {
  const double at =
      std::clamp(theta_d * (2 / std::numbers::pi) * kGrid.theta_d - 0.5, 0.0, kGrid.theta_d - 1.0);
  const int d = std::min(static_cast<int>(at), kGrid.theta_d - 2);
  const double share = at - d;
  return (1 - share) * diffuse_[d] + share * diffuse_[d + 1];
}

Rgb MerlBrdf::specular(const HalfDiff& angles) const {
  return table(angles) - diffuse(angles.theta_d);
}

Rgb MerlBrdf::table(const HalfDiff& angles) const {
  const GridStencil s =
      grid_stencil(kGrid, theta_h_index(kGrid, angles.theta_h), angles.theta_d, angles.phi_d);
  Rgb sum = Rgb::Zero();
  Rgb weight = Rgb::Zero();
  for (std::size_t i = 0; i < 8; ++i) {
    for (int channel = 0; channel < 3; ++channel) {
      const double v = mapping_->at_node(channel, s.node[i]);
      const double w = is_value(v) ? s.weight[i] : 0.0;
      sum[channel] += w > 0 ? w * v : 0.0;
      weight[channel] += w;
    }
  }
  Rgb f;
  for (int channel = 0; channel < 3; ++channel) {
    const double v = weight[channel] > 0 ? sum[channel] / weight[channel]
                                         : mapping_->channel_value(channel, angles);
    f[channel] = v * MerlFormat::kScale[channel];
  }
  return f;
}

double MerlBrdf::cell(int channel, std::size_t index) const {
  const double v = mapping_->raw(channel, index);
  return is_value(v) ? v * MerlFormat::kScale[channel] : kMissing;
}

double MerlBrdf::raw(int channel, std::size_t index) const {
  return mapping_->raw(channel, index);
}

std::span<const std::byte> MerlBrdf::bytes() const {
  return mapping_->file.bytes();
}

void MerlBrdf::drop_pages() const {
  mapping_->file.drop_pages();
}

MerlTable::MerlTable() {
  for (auto& channel : f)
    channel.assign(MerlFormat::kCells, kMissing);
}

void write_merl(const std::filesystem::path& file, const MerlTable& table) {
  AtomicFile out(file);
  const std::array<std::int32_t, 3> dims{kGrid.theta_h, kGrid.theta_d, kGrid.phi_d};
  out.write(std::as_bytes(std::span(dims)));
  std::vector<double> scaled(MerlFormat::kCells);
  for (int channel = 0; channel < 3; ++channel) {
    const std::vector<double>& f = table.f[channel];
    if (f.size() != MerlFormat::kCells) {
      throw InputError(file,
                       std::to_string(f.size()) + " cells in channel " + std::to_string(channel),
                       std::to_string(MerlFormat::kCells));
    }
    std::transform(f.begin(), f.end(), scaled.begin(), [&](double v) {
      return is_value(v) ? v / MerlFormat::kScale[channel] : kMissing;
    });
    out.write(std::as_bytes(std::span(scaled)));
  }
  out.commit();
}

}  // namespace brdfgate
