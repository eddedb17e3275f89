#include "app/image_export.hpp"

namespace brdfgate {
namespace {

constexpr const char* kHashAttribute = "brdfgate.calibration_hash";

/// Value, variance and mask of one image under its name.
template <typename Image>
void add_measured(LayeredExr& exr, const std::string& layer, const Image& image) {
  exr.add(layer, image.value);
  exr.add(layer + ".variance", image.variance);
  exr.add_channel(layer + ".mask", image.mask);
}

std::string layer_of(std::size_t light) {
  return "light" + std::to_string(light + 1);
}

}  // namespace

LayeredExr radiance_image(const RadianceSet& radiance) {
  LayeredExr exr;
  add_measured(exr, "ambient", radiance.ambient);
  for (std::size_t l = 0; l < radiance.lights.size(); ++l)
    add_measured(exr, layer_of(l), radiance.lights[l]);
  exr.attribute("brdfgate.quantity", "radiance, DN/s at gain 1, ambient light subtracted");
  return exr;
}

LayeredExr reflectance_image(const Inspection& part) {
  LayeredExr exr;
  exr.add("", part.reflectance.back().value * EIGEN_PI);
  for (std::size_t l = 0; l < part.reflectance.size(); ++l)
    add_measured(exr, layer_of(l), part.reflectance[l]);
  exr.add_channel("region", part.result.regions.label);
  exr.attribute("brdfgate.quantity", "BRDF value, 1/sr; plain R, G, B: pi f under the last light");
  return exr;
}

void export_images(const std::filesystem::path& dir, const Capture& capture, const Inspection& part,
                   const Inspector& inspector) {
  const Calibration& calibration = inspector.calibration();
  LayeredExr radiance = radiance_image(to_radiance(capture, calibration));
  LayeredExr reflectance = reflectance_image(part);
  for (LayeredExr* exr : {&radiance, &reflectance})
    exr->attribute(kHashAttribute, calibration.hash);
  radiance.write(dir / "radiance.exr");
  reflectance.write(dir / "reflectance.exr");
}

}  // namespace brdfgate
