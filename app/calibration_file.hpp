// One calibration file: an OpenEXR image whose layers hold the white reference, with a YAML head in
// its header attribute "brdfgate.calibration".
#pragma once

#include <filesystem>

#include "model/calibration.hpp"

namespace brdfgate {

/// Layers light<n>.white.<R|G|B|Y> and light<n>.sigma.<...> as half floats (scaled to DN/s by the
/// head), light<n>.mask. Written atomically; returns the calibration's hash.
std::string write_calibration(const std::filesystem::path& file, const Calibration& calibration);
/// Throws InputError naming file and field: not an EXR, not a calibration, schema version, missing
/// layer, sizes, checksum.
Calibration read_calibration(const std::filesystem::path& file);

}  // namespace brdfgate
