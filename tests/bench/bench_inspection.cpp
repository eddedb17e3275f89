// Where the time of an inspection goes: the shipped station and demo part, without files. Each
// stage's share of the whole, and the whole against touching every pixel once (the floor of
// method.md section 10: merging the brackets).
//
//   build target bench_inspection, then: bench_inspection [repeats]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

#include "app/inspector.hpp"
#include "app/session.hpp"
#include "app/station.hpp"
#include "app/teacher.hpp"
#include "model/radiance.hpp"
#include "model/readings.hpp"
#include "model/reconstruction.hpp"
#include "model/reflectance.hpp"
#include "support/shipped.hpp"

using namespace brdfgate;

namespace {

struct Time {
  double wall_ms = 0, cpu_ms = 0;  ///< processor time of all threads: right on a busy machine too
};

Time least_time(int repeats, const std::function<void()>& work) {
  Time best{1e300, 1e300};
  for (int i = 0; i < repeats; ++i) {
    const std::clock_t cpu = std::clock();
    const auto wall = std::chrono::steady_clock::now();
    work();
    const std::chrono::duration<double, std::milli> passed =
        std::chrono::steady_clock::now() - wall;
    best = {std::min(best.wall_ms, passed.count()),
            std::min(best.cpu_ms, 1e3 * double(std::clock() - cpu) / CLOCKS_PER_SEC)};
  }
  return best;
}

}  // namespace

int main(int argc, char** argv) {
  const int repeats = argc > 1 ? std::max(1, std::stoi(argv[1])) : 7;
  const StationConfig config = read_station_config(test::shipped_file("station.yaml"));
  const Inspector inspector = load_inspector(config);
  const auto station = open_station(config);
  Teacher teacher(inspector);
  Capture part;
  for (std::uint32_t i = 0; i < 4; ++i) {
    station->next_part(1);
    part = capture_part(*station, config.camera);
    if (i < 3) teacher.add("part " + std::to_string(i), part);
  }
  const RecipeInForce recipe = inspector.bring_into_force(teacher.recipe("bench", 1));
  inspector.inspect(part, &recipe);  // trains what is trained once

  const RadianceSet radiance = to_radiance(part, inspector.calibration().noise, 2);
  const auto reflectance = to_reflectance(radiance, inspector.calibration());
  const Time merge =
      least_time(repeats, [&] { to_radiance(part, inspector.calibration().noise, 2); });
  const Time whole = least_time(repeats, [&] { inspector.inspect(part, &recipe); });
  const Time unknown = least_time(repeats, [&] { inspector.inspect(part, nullptr); });
  const auto report = [&](const char* name, const Time& t) {
    std::printf("%-42s %8.1f ms %8.1f ms of processor, %5.2f times the merge\n", name, t.wall_ms,
                t.cpu_ms, t.cpu_ms / merge.cpu_ms);
  };
  report("brackets to radiance (the floor)", merge);
  report("inspection against a recipe", whole);
  report("inspection without a recipe", unknown);
  std::printf("stages\n");
  const Inspection seen = inspector.inspect(part, &recipe);
  const StationGeometry& geometry = inspector.calibration().geometry;
  const SensorFormat& sensor = inspector.calibration().sensor;
  const cv::Mat body = seen.result.regions.label == 0;
  const PosePrior prior{0.3 * EIGEN_PI / 180, 0};
  PoseSamples samples;
  const auto stage = [&](const char* name, const std::function<void()>& work) {
    report(name, least_time(repeats, work));
  };
  stage("  reflectance", [&] { to_reflectance(radiance, inspector.calibration()); });
  stage("  fixture", [&] { fixture_cells(reflectance, config.inspection.fixture); });
  const cv::Mat not_part = seen.result.regions.label == kNotPart;
  stage("  assignment to taught regions", [&] {
    assign_regions(reflectance, inspector.map().bins, not_part, recipe.appearance, 0.45);
  });
  stage("  pose samples",
        [&] { samples = pose_samples(reflectance, geometry, inspector.map().cells, body); });
  stage("  pose estimate", [&] { estimate_pose(inspector.basis(), samples, prior); });
  stage("  bins averaged as taught",
        [&] { bin_all(reflectance, inspector.map(), seen.result.regions); });
  stage("  bins averaged in the part's pose", [&] {
    bin_all(reflectance, inspector.map(), seen.result.regions, {geometry, {0.002, 0.001, 0}});
  });
  stage("  cell geometry in double (not in the cycle)",
        [&] { cell_geometry(geometry, sensor, {1, 1}); });
  stage("  ridge, one cluster", [&] { ridge(inspector.basis(), seen.samples[0]); });
  stage("  estimator, one cluster", [&] { inspector.estimator().estimate(seen.samples[0]); });
  const BrdfPtr brdf = make_brdf(inspector.shared_basis(), seen.result.clusters[0].raw);
  stage("  make_brdf", [&] { make_brdf(inspector.shared_basis(), seen.result.clusters[0].raw); });
  stage("  gloss", [&] { gloss_gu(*brdf); });
  stage("  defects", [&] {
    find_defects(reflectance, inspector.map(), seen.result.regions, recipe.appearance,
                 recipe.recipe.settings);
  });
  return whole.cpu_ms > 0 ? 0 : 1;
}
