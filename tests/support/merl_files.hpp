// MERL .binary files of analytic materials, made by a test.
#pragma once

#include <filesystem>

#include "model/brdf.hpp"
#include "model/merl.hpp"

namespace brdfgate::test {

/// Every cell above the horizon filled, -1 below it.
inline MerlTable merl_table(const Brdf& brdf) {
  MerlTable table;
  for (int h = 0; h < MerlFormat::kThetaH; ++h) {
    for (int d = 0; d < MerlFormat::kThetaD; ++d) {
      for (int p = 0; p < MerlFormat::kPhiD; ++p) {
        const HalfDiff at = MerlFormat::centre(h, d, p);
        if (!cosines(at).above_horizon()) continue;
        const Rgb f = brdf.eval(at);
        for (std::size_t c = 0; c < 3; ++c)
          table.f[c][MerlFormat::cell(h, d, p)] = f[static_cast<Eigen::Index>(c)];
      }
    }
  }
  return table;
}

inline std::filesystem::path write_merl_file(const std::filesystem::path& file, const Brdf& brdf) {
  std::filesystem::create_directories(file.parent_path());
  write_merl(file, merl_table(brdf));
  return file;
}

}  // namespace brdfgate::test
