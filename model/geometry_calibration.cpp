#include "model/geometry_calibration.hpp"

#include "model/error.hpp"

namespace brdfgate {
namespace {

RadianceSet radiance_of(const NamedCapture& recording, const Calibration& calibration) {
  if (recording.capture.sensor.cells() != calibration.sensor.cells() ||
      recording.capture.sensor.mosaic != calibration.sensor.mosaic) {
    throw InputError(recording.name, "another sensor format than the dark recordings",
                     "recordings of one camera in one mode");
  }
  try {
    return to_radiance(recording.capture, calibration);
  } catch (const InputError& error) {
    throw InputError(recording.name, error.what());
  }
}

std::vector<Highlight> find_highlights(const GeometryInput& input, const Calibration& calibration) {
  std::vector<Highlight> found;
  for (const NamedCapture& mirror : input.mirrors) {
    const RadianceSet set = radiance_of(mirror, calibration);
    const std::size_t before = found.size();
    for (std::size_t l = 0; l < set.lights.size(); ++l) {
      const auto seen =
          find_highlight(set.lights[l], l, calibration.geometry.camera, calibration.sensor);
      if (seen) found.push_back(*seen);
    }
    if (found.size() == before) {
      throw InputError(mirror.name, "shows no highlight of any light, or only a clipped one",
                       "a mirror-like gauge in the nest, and an exposure that does not clip it");
    }
  }
  return found;
}

void place_lights(const GeometryInput& input, Calibration& calibration, GeometryResult& result) {
  const std::size_t lights = calibration.geometry.lights_W.size();
  const auto by_hand = [&](std::size_t l) {
    return l < input.by_hand.lights_W.size() ? input.by_hand.lights_W[l] : std::nullopt;
  };
  bool all_by_hand = true;
  for (std::size_t l = 0; l < lights; ++l) {
    all_by_hand = all_by_hand && by_hand(l);
    if (by_hand(l)) calibration.geometry.lights_W[l] = *by_hand(l);
  }
  const bool camera_known = calibration.quality.camera.source != GeometrySource::nominal;
  if (camera_known && !all_by_hand) {
    LightFitInput fit{.sensor = calibration.sensor,
                      .geometry = calibration.geometry,
                      .plate_m = input.plate_m,
                      .whites = {{0, calibration.white}},
                      .highlights = result.highlights = find_highlights(input, calibration)};
    for (const GeometryInput::Raised& raised : input.raised) {
      fit.whites.push_back({raised.height_m, radiance_of(raised.white, calibration).lights});
    }
    result.lights = fit_lights(fit);
  }
  for (std::size_t l = 0; l < lights; ++l) {
    PlaceQuality& quality = calibration.quality.lights[l];
    if (by_hand(l)) {
      quality = {GeometrySource::by_hand, input.by_hand.sigma_m, 0};
    } else if (result.lights) {
      const FittedLight& fitted = result.lights->lights[l];
      calibration.geometry.lights_W[l] = fitted.position_W;
      quality = {GeometrySource::fitted, fitted.relative_sigma() * fitted.position_W.norm(),
                 fitted.rms};
    }
  }
}

}  // namespace

std::optional<CameraFit> calibrate_camera(const GeometryInput& input, Calibration& calibration,
                                          double worst_rms) {
  GeometryQuality& quality = calibration.quality;
  if (input.by_hand.camera) {
    calibration.geometry.camera = *input.by_hand.camera;
    quality.camera = {GeometrySource::by_hand, input.by_hand.sigma_m, 0};
    return std::nullopt;
  }
  if (input.boards.empty()) return std::nullopt;
  std::vector<BoardView> views;
  std::vector<std::string> names;
  for (const NamedCapture& board : input.boards) {
    views.push_back(
        find_board(radiance_of(board, calibration), calibration.sensor, input.pattern, board.name));
    names.push_back(board.name);
  }
  CameraFit fit =
      fit_camera(views, calibration.sensor, calibration.geometry.camera, names, worst_rms);
  calibration.geometry.camera = fit.camera;
  quality.camera = {GeometrySource::fitted, fit.position_sigma_m.norm(), fit.rms_px};
  return fit;
}

GeometryResult calibrate_geometry(const GeometryInput& input, Calibration& calibration) {
  GeometryResult result;
  calibration.quality.lights.resize(calibration.geometry.lights_W.size());
  result.camera = calibrate_camera(input, calibration);
  place_lights(input, calibration, result);
  return result;
}

}  // namespace brdfgate
