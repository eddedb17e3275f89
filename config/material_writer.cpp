#include "config/material_writer.hpp"

#include "config/yaml_reader.hpp"

namespace brdfgate {
namespace {

std::string rgb_text(const Rgb& rgb) {
  return "[" + number_text(rgb[0]) + ", " + number_text(rgb[1]) + ", " + number_text(rgb[2]) + "]";
}

}  // namespace

std::string material_yaml(const std::string& name, const Lobe& lobe) {
  const LobeDescription& description = describe(lobe.model);
  std::string text = "name: " + name + "\n" + std::string(description.name) + ": ";
  if (lobe.model == LobeModel::lambert) return text + rgb_text(lobe.diffuse) + "\n";
  text += "{" + std::string(diffuse_parameter().name) + ": " + rgb_text(lobe.diffuse);
  text += ", " + std::string(description.specular.name) + ": " + rgb_text(lobe.specular);
  for (std::size_t i = 0; i < description.shape.size(); ++i)
    text += ", " + std::string(description.shape[i].name) + ": " + number_text(lobe.shape[i]);
  return text + "}\n";
}

}  // namespace brdfgate
