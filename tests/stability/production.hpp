// Simulated production for the stability study: kinds of parts, what goes wrong with them, and the
// line that captures and measures them in memory.
#pragma once

#include <string>
#include <vector>

#include "app/inspector.hpp"
#include "app/station.hpp"
#include "hal/sim/sim_station.hpp"

namespace brdfgate::stability {

/// One kind of part, as produced when all is well.
struct Kind {
  std::string name;
  Scene good;
};

/// One way to go wrong, at one size.
struct Fault {
  std::string name;  ///< of the way
  double size = 0;   ///< of the change, in the unit of `name`
  Scene scene;
  /// Where part n has the scene's one defect, in turn, mm; empty: where the scene says.
  std::vector<std::array<double, 2>> places = {};
};

/// Places of a part that the camera sees with room around, and where the specular share is at least
/// `share` under one of the lights, shuffled; 0: all.
std::vector<std::array<double, 2>> places_of(const Scene& scene, const StationGeometry& geometry,
                                             const SensorFormat& sensor, double share);

/// Matte, satin and gloss Cook-Torrance materials and a part of all three.
std::vector<Kind> kinds();

/// Every fault of a kind, sizes rising.
std::vector<Fault> faults(const Kind& kind, const StationConfig& config);

/// What a part is judged by, kept of its measurement.
struct MeasuredPart {
  std::vector<ClusterResult> clusters;
  std::vector<std::optional<ClusterObservation>> observed;
  std::vector<BinnedSamples> samples;
  std::vector<Weights> linear;
  PartFacts facts;
  std::array<double, 2> tilt_deg{};
  std::array<double, 2> tilt_sigma_deg{};
};

/// Parts 0 to count - 1 of a seed.
struct Batch {
  std::uint64_t seed = 0;
  int count = 0;
};

/// A batch of parts with one fault, rendered, captured and measured.
std::vector<MeasuredPart> produce(const Fault& fault, const StationConfig& config,
                                  const Inspector& inspector, const RecipeInForce* recipe,
                                  const Batch& batch);

/// Standard deviation of each lamp's level from part to part, relative; the monitor patch sees it.
constexpr double kLampDrift = 0.01;

/// A capture of one part on a bench of its own, its lamps drifted.
Capture capture(const Scene& good, const StationConfig& config, std::uint64_t seed, int index);

}  // namespace brdfgate::stability
