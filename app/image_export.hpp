// One part's images as OpenEXR, for other programs: what the camera measured and what it makes of
// it.
#pragma once

#include <filesystem>

#include "app/inspector.hpp"
#include "app/layered_exr.hpp"

namespace brdfgate {

/// Layers light<n>.R/G/B (mono: .Y), light<n>.variance.*, light<n>.mask (model/radiance.hpp's
/// MaskBit), the same of `ambient`: radiance in DN/s at gain 1.
LayeredExr radiance_image(const RadianceSet& radiance);
/// The same of reflectance, 1/sr, and `region`: cluster 0..7, 254 unknown, 255 not the part. Plain
/// R, G, B (mono: Y), what a viewer shows first, are pi f under light 2: a white is 1.
LayeredExr reflectance_image(const Inspection& part);

/// radiance.exr and reflectance.exr, with the hash of the calibration in their headers. Throws
/// InputError where the capture does not fit the calibration or the folder cannot be written.
void export_images(const std::filesystem::path& dir, const Capture& capture, const Inspection& part,
                   const Inspector& inspector);

}  // namespace brdfgate
