// The drawing of a camera-and-lights rig that a technician builds from: SVG, to scale.
#pragma once

#include <string>
#include <vector>

#include "model/design_layouts.hpp"

namespace brdfgate {

/// Something that stands over the sample.
struct RigPart {
  std::string label;
  bool camera = false;
  PolarDirection at;      ///< from the sample's centre
  double distance_m = 0;  ///< 0: directional light, drawn at the edge of the view
  std::string note;       ///< last column of the table
};

struct RigDrawing {
  std::string title;
  std::string note;          ///< a line under the title
  double disc_radius_m = 0;  ///< what of the sample is measured
  double fov = 0;            ///< of the cameras, radians
  std::vector<RigPart> parts;
};

/// An A4 page in millimetres: side view (x, z), top view (x, y), a table of positions. Both views
/// have the scale printed on the page, so that a ruler works on paper printed at 100 %.
std::string draw_rig_svg(const RigDrawing& drawing);

}  // namespace brdfgate
