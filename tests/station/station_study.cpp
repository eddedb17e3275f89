// The accuracy table of docs/calibration.md: reflectance of known materials on a simulated station
// that was calibrated from its recordings alone, against the truth; and its sigma against the
// scatter of repeats.
#include <fmt/core.h>

#include <CLI/CLI.hpp>

#include "support/station_accuracy.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

std::string errors_text(const Accuracy::Errors& e) {
  return fmt::format("{:.2f} / {:.2f}", 100 * e.median, 100 * e.p95);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("station_study: the table of docs/calibration.md");
  double scale = 0.5;
  int repeats = 50;
  int whites = 4;
  app.add_option("--scale", scale, "of the shipped sensor's sides")->check(CLI::Range(0.1, 1.0));
  app.add_option("--repeats", repeats, "captures per line")->check(CLI::Range(1, 1000));
  app.add_option("--whites", whites, "recordings of the white reference")->check(CLI::Range(2, 64));
  std::vector<double> bracket_ms;
  app.add_option("--bracket-ms", bracket_ms, "exposures instead of the shipped four");
  CLI11_PARSE(app, argc, argv);
  if (!bracket_ms.empty()) bracket_s().clear();
  for (const double ms : bracket_ms)
    bracket_s().push_back(ms / 1000);
  CalibratedBench bench(scale, whites);
  const cv::Size cells = bench.settings.sensor.cells();
  fmt::print(
      "{} x {} cells, {} repeats, {} white recordings; errors in %: median / 95th "
      "percentile\n\n",
      cells.width, cells.height, repeats, whites);
  fmt::print(
      "| material | part | light | blocks of 8 x 8 | cells, {} captures | cells, one capture "
      "| masked % | observed / predicted sigma |\n| --- | --- | --- | --- | --- | --- | --- "
      "| --- |\n",
      repeats);
  const auto fresh = fresh_whites(bench, repeats, whites);
  for (const KnownMaterial& material : known_materials()) {
    for (const KnownPose& pose : known_poses()) {
      const auto lights = accuracy_of(bench, material.brdf, pose.pose, fresh);
      for (std::size_t l = 0; l < lights.size(); ++l) {
        const Accuracy& a = lights[l];
        fmt::print("| {} | {} | {} | {} | {} | {} | {:.2f} | {:.3f} |\n", material.name, pose.name,
                   l + 1, errors_text(a.blocks), errors_text(a.averaged), errors_text(a.one),
                   100 * a.masked, a.sigma_ratio);
        std::fflush(stdout);
      }
    }
  }
  return 0;
}
