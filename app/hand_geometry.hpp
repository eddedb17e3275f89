// A station's geometry as a technician measured it by hand (docs/calibration.md), from YAML.
#pragma once

#include <filesystem>

#include "model/geometry_calibration.hpp"

namespace brdfgate {

/// schema: brdfgate.geometry/1; sigma_mm; camera (optional): position_mm, look_at_mm [x, y],
/// roll_deg, and optionally focal_px, centre_px, distortion over `nominal`'s; lights (optional): a
/// list with one entry per light, `position_mm` or nothing. Throws InputError with
/// file:line:column and field.
GeometryByHand read_hand_geometry(const std::filesystem::path& file,
                                  const StationGeometry& nominal);

}  // namespace brdfgate
