// The station's geometry from its calibration recordings: board, white reference, mirror gauge.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "model/calibration.hpp"
#include "model/camera_calibration.hpp"
#include "model/light_fit.hpp"

namespace brdfgate {

/// A recording with the name that an error shall give it.
struct NamedCapture {
  std::string name;
  Capture capture;
};

/// What a technician measured by hand; it replaces what would be fitted.
struct GeometryByHand {
  std::optional<PinholeCamera> camera;
  std::vector<std::optional<Eigen::Vector3d>> lights_W;  ///< empty, or one entry per light
  double sigma_m = 0;                                    ///< of every length
};

struct GeometryInput {
  BoardPattern pattern;
  std::vector<NamedCapture> boards;   ///< the first flat in the nest; it defines W
  std::vector<NamedCapture> mirrors;  ///< a mirror-like gauge in the inspected plane
  struct Raised {
    double height_m = 0;
    NamedCapture white;
  };
  std::vector<Raised> raised;  ///< the white reference at other heights
  cv::Size2d plate_m;          ///< what the white reference is sure to cover
  GeometryByHand by_hand;
};

struct GeometryResult {
  std::optional<CameraFit> camera;
  std::optional<LightFit> lights;
  std::vector<Highlight> highlights;
};

/// The camera alone, from the boards or by hand, into `calibration` (of which sensor, noise or
/// response and the nominal geometry are used); nothing where there is neither, or by hand.
/// worst_rms: reprojection error in px, as fit_camera's.
std::optional<CameraFit> calibrate_camera(const GeometryInput& input, Calibration& calibration,
                                          double worst_rms = kWorstRms);

/// Fits what the input allows and writes it into `calibration` (geometry and its quality): the
/// camera with at least one board, the lights from calibration.white once the camera is known by
/// board or by hand; the rest stays as it was. Throws InputError as find_board, fit_camera and
/// fit_lights do, and for a mirror without a highlight.
/// Precondition: `calibration` as calibrate() makes it.
GeometryResult calibrate_geometry(const GeometryInput& input, Calibration& calibration);

}  // namespace brdfgate
