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

/// A taught recipe and one more part, with what the stages need of it.
struct Setting {
  StationConfig config = read_station_config(test::shipped_file("station.yaml"));
  Inspector inspector = load_inspector(config);
  Capture part;
  RecipeInForce recipe;
  RadianceSet radiance;
  std::vector<Reflectance> reflectance;
  Inspection seen;

  Setting() {
    const auto station = open_station(config);
    Teacher teacher(inspector);
    for (std::uint32_t i = 0; i < 4; ++i) {
      station->next_part(1);
      part = capture_part(*station, config.camera);
      if (i < 3) teacher.add("part " + std::to_string(i), part);
    }
    recipe = inspector.bring_into_force(teacher.recipe("bench", 1));
    seen = inspector.inspect(part, &recipe);  // trains what is trained once
    radiance = to_radiance(part, inspector.calibration());
    reflectance = to_reflectance(radiance, inspector.calibration());
  }
};

using Stage = std::function<void(const char*, const std::function<void()>&)>;

void image_stages(const Setting& s, const Stage& stage) {
  const StationGeometry& geometry = s.inspector.calibration().geometry;
  const StationMap& map = s.inspector.map();
  const Regions& regions = s.seen.result.regions;
  PoseSamples samples;
  stage("  reflectance", [&] { to_reflectance(s.radiance, s.inspector.calibration()); });
  stage("  fixture", [&] { fixture_cells(s.reflectance, s.config.inspection.fixture); });
  stage("  pose samples",
        [&] { samples = pose_samples(s.reflectance, geometry, map.cells, regions.label == 0); });
  stage("  pose estimate",
        [&] { estimate_pose(s.inspector.basis(), samples, {0.3 * EIGEN_PI / 180, 0}); });
  stage("  bins averaged as taught", [&] { bin_all(s.reflectance, map, regions); });
  stage("  bins averaged in the part's pose",
        [&] { bin_all(s.reflectance, map, regions, {geometry, {0.002, 0.001, 0}}); });
  stage("  cell geometry in double (not in the cycle)",
        [&] { cell_geometry(geometry, s.inspector.calibration().sensor, {1, 1}); });
}

void cluster_stages(const Setting& s, const Stage& stage) {
  const Basis& basis = s.inspector.basis();
  const Weights& weights = s.seen.result.clusters[0].raw;
  const BrdfPtr brdf = make_brdf(s.inspector.shared_basis(), weights);
  stage("  ridge, one cluster", [&] { ridge(basis, s.seen.samples[0]); });
  stage("  estimator, one cluster", [&] { s.inspector.estimator().estimate(s.seen.samples[0]); });
  stage("  BRDF of a cluster", [&] { make_brdf(s.inspector.shared_basis(), weights); });
  stage("  gloss of it", [&] { gloss_gu(*brdf); });
  Weights values_alone;
  values_alone.c = weights.c;
  stage("  readings of a cluster without deviations, by rows",
        [&] { s.inspector.readings().read(values_alone, s.seen.samples[0]); });
  stage("  readings of a cluster with deviations, by rows",
        [&] { s.inspector.readings().read(weights, s.seen.samples[0]); });
  const JudgeSettings& settings = s.recipe.recipe.settings;
  stage("  local defects, evidence and search", [&] {
    find_defects(s.inspector.evidence_of(s.seen, s.recipe), s.inspector.defect_blocks(),
                 s.recipe.recipe.defects, s.recipe.defect_material, settings);
  });
}

}  // namespace

int main(int argc, char** argv) {
  const int repeats = argc > 1 ? std::max(1, std::stoi(argv[1])) : 7;
  const Setting s;
  const Time merge = least_time(repeats, [&] { to_radiance(s.part, s.inspector.calibration()); });
  const auto stage = [&](const char* name, const std::function<void()>& work) {
    const Time t = least_time(repeats, work);
    std::printf("%-52s %8.2f ms %8.2f ms of processor, %5.2f times the merge\n", name, t.wall_ms,
                t.cpu_ms, t.cpu_ms / merge.cpu_ms);
  };
  stage("brackets to radiance (the floor)",
        [&] { to_radiance(s.part, s.inspector.calibration()); });
  stage("inspection against a recipe", [&] { s.inspector.inspect(s.part, &s.recipe); });
  stage("inspection without a recipe", [&] { s.inspector.inspect(s.part, nullptr); });
  std::printf("stages\n");
  image_stages(s, stage);
  cluster_stages(s, stage);
  return merge.cpu_ms > 0 ? 0 : 1;
}
