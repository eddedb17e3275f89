// The materials of a scene file.
#pragma once

#include <filesystem>
#include <vector>

#include "config/yaml_reader.hpp"
#include "hal/sim/scene.hpp"

namespace brdfgate {

/// Reads the list `materials`: each has a name of its own and exactly one of brdf
/// (a MERL .binary), abc, sgd, or a model of model/lobes.hpp (lambert, phong, blinn_phong, ward,
/// ggx, beckmann, blend). MERL files are relative to `folder`; one that did not change since it was
/// last read is not read again. Throws InputError.
std::vector<SceneMaterial> read_materials(const YamlNode& list,
                                          const std::filesystem::path& folder);

/// Three numbers, one per colour channel.
Rgb read_rgb(const YamlNode& node, std::string_view key, YamlRange range);

}  // namespace brdfgate
