// Time of merge_bracket for the default station's bracket (1456 x 1088, RGGB, four exposures)
// against the plain double-precision definition.
//
//   build target bench_merge, then: bench_merge [repeats]
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#include "model/radiance.hpp"
#include "support/merge_oracle.hpp"
#include "support/photons.hpp"

using namespace brdfgate;

namespace {

struct Time {
  double wall_ms = 0, cpu_ms = 0;  ///< processor time of all threads: right on a busy machine too
};

Time time_of(const std::function<void()>& work) {
  const std::clock_t cpu = std::clock();
  const auto wall = std::chrono::steady_clock::now();
  work();
  const std::chrono::duration<double, std::milli> passed = std::chrono::steady_clock::now() - wall;
  return {passed.count(), 1e3 * static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC};
}

/// The least of each: what the work takes when nothing disturbs it.
Time least_time(int repeats, const std::function<void()>& work) {
  Time best{HUGE_VAL, HUGE_VAL};
  for (int i = 0; i < repeats; ++i) {
    const Time t = time_of(work);
    best = {std::min(best.wall_ms, t.wall_ms), std::min(best.cpu_ms, t.cpu_ms)};
  }
  return best;
}

/// Radiance from the noise floor at the left to the shortest exposure's full well at the right.
cv::Mat ramp(const SensorFormat& sensor) {
  cv::Mat radiance(sensor.height, sensor.width, CV_32FC1);
  for (int x = 0; x < sensor.width; ++x)
    radiance.col(x).setTo(std::pow(10.0, 2.0 + 5.4 * x / sensor.width));
  return radiance;
}

}  // namespace

int main(int argc, char** argv) {
  const int repeats = argc > 1 ? std::max(1, std::stoi(argv[1])) : 21;
  const test::BenchSensor bench;
  const auto frames = test::expose(bench, ramp(bench.sensor), {0.03e-3, 0.4e-3, 5e-3, 60e-3}, 1);
  const auto merge = [&] { merge_bracket(bench.sensor, bench.noise, frames); };
  double cpu_ms = 0;
  for (const int threads : {2, 1}) {
    cv::setNumThreads(threads);
    const Time t = least_time(repeats, merge);
    cpu_ms = t.cpu_ms;
    std::printf("merge, %d thread(s): %.1f ms, %.1f ms of processor\n", threads, t.wall_ms,
                t.cpu_ms);
  }
  double checksum = 0;
  const cv::Size cells = bench.sensor.cells();
  const Time oracle = least_time(3, [&] {
    checksum = 0;
    for (int v = 0; v < cells.height; ++v) {
      for (int u = 0; u < cells.width; ++u) {
        const auto rgb = test::merge_cell_oracle(bench.sensor, bench.noise, frames, "rggb", u, v);
        checksum += rgb[1].value;
      }
    }
  });
  std::printf("definition in double, 1 thread: %.0f ms of processor, %.1f times the merge's\n",
              oracle.cpu_ms, oracle.cpu_ms / cpu_ms);
  return checksum > 0 ? 0 : 1;
}
