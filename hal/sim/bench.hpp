// The state that the simulated camera, lights and trigger share.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "hal/sim/optics.hpp"
#include "hal/sim/part.hpp"
#include "hal/sim/sensor.hpp"
#include "hal/sim/sim_station.hpp"

namespace brdfgate {

/// The trigger line: edges are counted, none is lost. Safe between threads.
class TriggerLine {
 public:
  void fire();
  /// Takes one edge; waits real time for it.
  bool wait(std::chrono::milliseconds timeout);

 private:
  std::mutex mutex_;
  std::condition_variable fired_;
  std::uint64_t edges_ = 0;
};

/// Not thread-safe but for the trigger line: the thread that runs the station uses it.
class SimBench {
 public:
  /// Throws InputError naming the setting that is not physical.
  explicit SimBench(const SimBenchSettings& settings);
  SimBench(const SimBench&) = delete;
  SimBench& operator=(const SimBench&) = delete;

  /// A scene that throws leaves what was there before.
  void place(const Scene& scene, std::uint64_t seed, std::uint64_t index);
  bool occupied() const { return placed_ != nullptr; }
  /// Precondition: occupied.
  const PartDraw& draw() const { return placed_->draw; }

  const SimBenchSettings& settings() const { return settings_; }
  int lights() const { return static_cast<int>(settings_.geometry.lights_W.size()); }
  /// One light by number, or kNoLight. Precondition: it exists.
  void switch_to(LightIndex light);
  std::int64_t switched_at_ns() const { return switched_ns_; }

  /// Lets time pass on the bench's clock up to `ns`; nothing when that is past.
  void advance_to(std::int64_t ns) { clock_ns_ = std::max(clock_ns_, ns); }
  /// Frames taken of the part in place. Precondition: occupied.
  std::uint64_t frames_of_part() const { return placed_->frames; }
  double applied_exposure_s(double asked_s) const { return sensor_.applied_exposure_s(asked_s); }
  /// Time on the bench's clock that a frame of this exposure takes, readout included.
  double frame_time_s(double asked_s) const;
  /// Exposes whatever glows now and moves the clock on. Precondition: occupied.
  RawFrame expose(double asked_s, double gain);

  TriggerLine trigger_line;

 private:
  struct Placed {
    PartSurface surface;
    Eigen::Isometry3d X_WP;
    PartDraw draw;
    bool lights_on;
    std::vector<double> intensity;  ///< per light, relative
    double ambient;
    double defocus_px;
    bool noise;
    std::uint64_t seed;
    std::uint64_t frames = 0;         ///< taken of this part
    std::vector<cv::Mat> rate_e_s{};  ///< by light, [0] ambient alone; empty until needed
  };

  /// A light's output over its steady one, when it was last switched and in the mean over an
  /// exposure that starts now.
  double level_now(std::size_t light) const;
  double mean_level(std::size_t light, double exposure_s) const;
  /// Electrons per second under all that glows during an exposure that starts now.
  cv::Mat rate_now(double exposure_s);
  const cv::Mat& rate_image(LightIndex light);
  cv::Mat render(LightIndex light);

  SimBenchSettings settings_;
  SimOptics optics_;
  SimSensor sensor_;
  std::unique_ptr<Placed> placed_;
  LightIndex burning_ = kNoLight;
  std::vector<double> level_at_switch_;  ///< by light, [0] is light 1
  std::int64_t switched_ns_ = 0;
  std::int64_t clock_ns_ = 0;
};

}  // namespace brdfgate
