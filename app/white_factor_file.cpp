#include "app/white_factor_file.hpp"

#include <cmath>

#include "app/csv_table.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr double kDegree = EIGEN_PI / 180;
constexpr double kLeast = 0.5;
constexpr double kMost = 2;

}  // namespace

WhiteFactorTable read_white_factor(const std::filesystem::path& file, std::size_t lights) {
  const CsvTable table(file, {"light", "theta_h_deg", "factor"});
  WhiteFactorTable out;
  out.name = file.filename().string();
  out.lights.resize(lights);
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const double light = table.number(row, "light");
    const double angle = table.number(row, "theta_h_deg");
    const double factor = table.number(row, "factor");
    if (light != std::floor(light) || light < 1 || light > static_cast<double>(lights)) {
      throw InputError(table.where(row), "light " + table.text(row, "light"),
                       "1 to " + std::to_string(lights));
    }
    if (angle < 0 || angle > 90) {
      throw InputError(table.where(row), "theta_h_deg " + table.text(row, "theta_h_deg"),
                       "0 to 90");
    }
    if (factor < kLeast || factor > kMost) {
      throw InputError(table.where(row), "factor " + table.text(row, "factor"),
                       "0.5 to 2, 1 for a Lambertian plate");
    }
    auto& figures = out.lights[static_cast<std::size_t>(light) - 1];
    if (!figures.empty() && !(angle * kDegree > figures.back().first)) {
      throw InputError(table.where(row), "theta_h_deg does not rise within its light",
                       "rising angles, each once");
    }
    figures.emplace_back(angle * kDegree, factor);
  }
  for (std::size_t l = 0; l < lights; ++l) {
    if (out.lights[l].empty()) {
      throw InputError(file.string(), "no figure for light " + std::to_string(l + 1),
                       "one or more for each light");
    }
  }
  return out;
}

}  // namespace brdfgate
