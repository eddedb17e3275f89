// A fitted material in the syntax of a scene file.
#pragma once

#include <string>

#include "model/lobes.hpp"

namespace brdfgate {

/// One entry of a scene file's `materials`, without the list's dash:
///   name: cluster_0
///   ggx: {diffuse: [0.1, 0.2, 0.3], f0: [0.04, 0.04, 0.04], alpha: 0.2}
/// Every number reads back as the same double.
/// @pre `name` consists of letters, digits, '_' and '-'
std::string material_yaml(const std::string& name, const Lobe& lobe);

}  // namespace brdfgate
