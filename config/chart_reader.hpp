// A colour chart's file: what is printed where, and its colours as measured by its maker.
#pragma once

#include <filesystem>

#include "model/colour_chart.hpp"

namespace brdfgate {

/// schema: brdfgate.chart/1; name; illuminant: D50 or D65; observer_deg: 2; columns, rows 1..100;
/// pitch_mm, patch_mm (0, 1000); patches: [{name, lab: [L, a, b]} or {name, xyz: [X, Y, Z]} (Y = 1
/// for the perfect diffuser)], row by row. D50 is adapted to D65 by Bradford. Throws InputError
/// with file:line:column and the field's path.
ColourChart read_chart(const std::filesystem::path& file);

}  // namespace brdfgate
