#include "tests/stability/production.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <random>

#include "model/analytic.hpp"
#include "model/colour.hpp"
#include "model/parallel.hpp"
#include "model/readings.hpp"

namespace brdfgate::stability {
namespace {

BrdfPtr ggx(const Rgb& diffuse, double f0, double alpha) {
  return make_brdf(GgxParameters{diffuse, Rgb::Constant(f0), alpha});
}
SceneMaterial matte() {
  return {"matte", ggx({0.35, 0.22, 0.12}, 0.04, 0.45)};
}
SceneMaterial satin() {
  return {"satin", ggx({0.12, 0.20, 0.30}, 0.04, 0.20)};
}
SceneMaterial gloss() {
  return {"gloss", ggx({0.25, 0.06, 0.05}, 0.045, 0.08)};
}

Scene production_of(std::vector<SceneMaterial> materials) {
  Scene scene;
  scene.materials = std::move(materials);
  scene.variation = {0.005, 0.01, 0.01};
  scene.jitter.tilt_deg = {0.3, 0.3};
  scene.jitter.shift_mm = {0.5, 0.5};
  return scene;
}

/// A matte band over the middle third and a glossy disc on the satin rest.
cv::Mat three_regions() {
  cv::Mat mask(400, 400, CV_8UC1, cv::Scalar(0));
  cv::rectangle(mask, {0, 130, 400, 120}, cv::Scalar(1), cv::FILLED);
  cv::circle(mask, {200, 320}, 60, cv::Scalar(2), cv::FILLED);
  return mask;
}

Scene with_change(const Scene& good, const BrdfChange& change) {
  Scene scene = good;
  scene.changes.push_back({good.materials.front().name, change});
  return scene;
}

/// The turn of hue that gives this colour difference at 45:0.
double hue_deg_of(const BrdfPtr& brdf, double delta_e) {
  const Lab taught = lab_45_0(*brdf);
  double low = 0, high = 90;
  for (int i = 0; i < 40; ++i) {
    const double middle = (low + high) / 2;
    const BrdfChange change{.hue_deg = middle};
    (delta_e00(taught, lab_45_0(*changed(brdf, change))) < delta_e ? low : high) = middle;
  }
  return high;
}

Scene with_defect(const Scene& good, DefectKind kind, double area_share, std::array<double, 2> at,
                  double strength) {
  Scene scene = good;
  const double area = area_share * good.part_size_mm[0] * good.part_size_mm[1];
  scene.defects.push_back({kind, at, 2 * std::sqrt(area / M_PI), strength});
  return scene;
}

int material_at(const Scene& scene, const Eigen::Vector3d& p) {
  if (scene.regions.empty()) return 0;
  const auto index = [](double p_mm, double size_mm, int cells) {
    return std::clamp(static_cast<int>((p_mm / size_mm + 0.5) * cells), 0, cells - 1);
  };
  return scene.regions.at<unsigned char>(
      index(-1e3 * p.y(), scene.part_size_mm[1], scene.regions.rows),
      index(1e3 * p.x(), scene.part_size_mm[0], scene.regions.cols));
}

/// The larger of both lights', channels' mean.
double specular_share(const Scene& scene, const StationGeometry& geometry,
                      const Eigen::Vector3d& p) {
  const Brdf& brdf = *scene.materials[static_cast<std::size_t>(material_at(scene, p))].brdf;
  double most = 0;
  for (const Eigen::Vector3d& light : geometry.lights_W) {
    const HalfDiff angles =
        to_half_diff({(light - p).normalized(), (geometry.camera.position() - p).normalized()});
    most = std::max(most, (brdf.specular(angles) / brdf.eval(angles)).mean());
  }
  return most;
}

void add_regions(std::vector<Fault>& out, const Scene& good) {
  Scene missing = good;
  missing.regions = good.regions.clone();
  missing.regions.setTo(0, good.regions == 2);
  out.push_back({"missing cluster", 1, missing});
  Scene swapped = good;
  std::swap(swapped.materials[1], swapped.materials[2]);
  out.push_back({"swapped clusters", 1, swapped});
}

}  // namespace

std::vector<Kind> kinds() {
  Scene three = production_of({satin(), matte(), gloss()});
  three.regions = three_regions();
  return {{"matte", production_of({matte()})},
          {"satin", production_of({satin()})},
          {"gloss", production_of({gloss()})},
          {"three", three}};
}

std::vector<std::array<double, 2>> places_of(const Scene& scene, const StationGeometry& geometry,
                                             const SensorFormat& sensor, double share) {
  constexpr double kMargin = 0.05;  // of the image
  std::vector<std::array<double, 2>> places;
  for (double x = -34; x <= 34; x += 1) {
    for (double y = -34; y <= 34; y += 1) {
      const Eigen::Vector3d p(1e-3 * x, 1e-3 * y, 0);
      const Eigen::Vector2d px = geometry.camera.project(p);
      const Eigen::Vector2d at(px.x() / sensor.width, px.y() / sensor.height);
      if (at.minCoeff() < kMargin || at.maxCoeff() > 1 - kMargin) continue;
      if (specular_share(scene, geometry, p) >= share) places.push_back({x, y});
    }
  }
  std::mt19937 random(5);
  std::shuffle(places.begin(), places.end(), random);
  return places;
}

std::vector<Fault> faults(const Kind& kind, const StationConfig& config) {
  const auto places = [&](double share) {
    return places_of(kind.good, config.simulator.geometry, config.camera.sensor, share);
  };
  std::vector<Fault> out;
  for (const double r : {0.03, 0.06, 0.10, 0.15})
    out.push_back({"roughness", r, with_change(kind.good, {.roughness = 1 + r})});
  for (const double a : {0.01, 0.02, 0.03, 0.05})
    out.push_back({"albedo", a, with_change(kind.good, {.albedo = 1 - a})});
  const BrdfPtr body = kind.good.materials.front().brdf;
  for (const double e : {0.1, 0.2, 0.5, 1.5})
    out.push_back({"hue", e, with_change(kind.good, {.hue_deg = hue_deg_of(body, e)})});
  for (const double s : {0.0005, 0.001})
    out.push_back(
        {"stain", s, with_defect(kind.good, DefectKind::stain, s, {0, 0}, 0.5), places(0)});
  const auto shiny = places(0.3);
  for (const double s : {0.001, 0.002})
    if (!shiny.empty())
      out.push_back({"dull", s, with_defect(kind.good, DefectKind::dull, s, {0, 0}, 1.0), shiny});
  if (!kind.good.regions.empty()) add_regions(out, kind.good);
  Scene moved = kind.good;
  moved.jitter.shift_mm = {3.4, 3.4};
  moved.jitter.rotation_deg = 4.8;
  out.push_back({"(good, moved within range)", 1, moved});
  return out;
}

Capture capture(const Scene& good, const StationConfig& config, std::uint64_t seed, int index) {
  Scene scene = good;
  std::seed_seq draw{seed, static_cast<std::uint64_t>(index), std::uint64_t{99}};
  std::mt19937 random(draw);
  std::normal_distribution<double> drift(0, kLampDrift);
  for (double& lamp : scene.light.drift)
    lamp = drift(random);
  SimStation station(config.simulator);
  station.place(scene, seed, static_cast<std::uint64_t>(index));
  Capture out{station.camera().format(), {}};
  const auto bracket = [&](LightIndex light, const std::vector<double>& times) {
    for (const double ms : times) {
      station.camera().arm({{.exposure_s = ms * 1e-3, .gain = config.camera.gain}});
      out.frames.push_back(station.camera().next_frame(std::chrono::seconds(10)));
      out.frames.back().light = light;
    }
  };
  bracket(kNoLight, config.camera.ambient_ms);
  for (LightIndex light = station.lights().count(); light >= 1; --light) {
    station.lights().on(light);
    bracket(light, config.camera.bracket_ms);
  }
  return out;
}

std::vector<MeasuredPart> produce(const Fault& fault, const StationConfig& config,
                                  const Inspector& inspector, const RecipeInForce* recipe,
                                  const Batch& batch) {
  std::vector<MeasuredPart> parts(static_cast<std::size_t>(batch.count));
  parallel_for_each(batch.count, [&](int i) {
    Scene scene = fault.scene;
    if (!fault.places.empty())
      scene.defects.at(0).at_mm = fault.places[std::size_t(i) % fault.places.size()];
    Inspection seen = inspector.measure(capture(scene, config, batch.seed, i), recipe);
    MeasuredPart& part = parts[static_cast<std::size_t>(i)];
    part.clusters = std::move(seen.result.clusters);
    part.observed = std::move(seen.observed);
    part.samples = std::move(seen.samples);
    part.linear = std::move(seen.linear);
    part.facts = std::move(seen.facts);
    part.tilt_deg = seen.result.tilt_deg;
    part.tilt_sigma_deg = seen.result.tilt_sigma_deg;
  });
  return parts;
}

}  // namespace brdfgate::stability
