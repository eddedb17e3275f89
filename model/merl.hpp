// Tabulated BRDFs in the MERL .binary format (Matusik et al. 2003).
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <span>
#include <vector>

#include "model/brdf.hpp"

namespace brdfgate {

/// The format's grid and colour scales: value on file = f / scale; axes theta_h (index =
/// sqrt(theta_h / 90 deg) * 90), theta_d (1 deg), phi_d (1 deg over 0..180); values at cell
/// centres.
struct MerlFormat {
  static constexpr int kThetaH = 90;
  static constexpr int kThetaD = 90;
  static constexpr int kPhiD = 180;
  static constexpr std::size_t kCells = std::size_t{kThetaH} * kThetaD * kPhiD;
  static constexpr std::array<double, 3> kScale{1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0};
  static constexpr double kMissing = -1.0;  ///< on file, where there is no value
  static std::size_t cell(int h, int d, int p) {
    return (static_cast<std::size_t>(h) * kThetaD + d) * kPhiD + p;
  }
  /// Angles of a cell's centre.
  static HalfDiff centre(int h, int d, int p);
};

/// A MERL file, memory-mapped read-only. f is interpolated linearly in the three axis indices over
/// the valid neighbours (phi_d periodic over pi by reciprocity); a cell is missing where the file
/// has a negative or non-finite value.
class MerlBrdf final : public Brdf {
 public:
  /// Throws InputError: unreadable, truncated or over-long file, foreign dimensions, no valid cell,
  /// NaN cells above the horizon.
  static std::shared_ptr<const MerlBrdf> open(const std::filesystem::path& file);

  Rgb diffuse(double theta_d) const override;
  Rgb specular(const HalfDiff& angles) const override;
  /// The interpolated table itself.
  Rgb table(const HalfDiff& angles) const;
  /// One cell in 1/sr; negative where missing.
  double cell(int channel, std::size_t index) const;
  /// One cell as on file, without the colour scale.
  double raw(int channel, std::size_t index) const;
  /// The file as mapped.
  std::span<const std::byte> bytes() const;
  /// Gives mapped pages back; they are read again when touched (training streams many files).
  void drop_pages() const;

  ~MerlBrdf() override;

 private:
  struct Mapping;
  explicit MerlBrdf(std::unique_ptr<Mapping> mapping);
  std::unique_ptr<Mapping> mapping_;
  std::array<Rgb, MerlFormat::kThetaD> diffuse_;
};

/// Three channels of f in 1/sr on the MERL grid, -1 below the horizon: what write_merl puts on
/// disk.
struct MerlTable {
  std::array<std::vector<double>, 3> f;
  MerlTable();
};

/// Writes atomically (temporary file, then rename). Throws InputError where it cannot write.
void write_merl(const std::filesystem::path& file, const MerlTable& table);

}  // namespace brdfgate
