// The white reference's radiance factor as a CSV file: columns light, theta_h_deg, factor.
#pragma once

#include <filesystem>

#include "model/white_factor.hpp"

namespace brdfgate {

/// Named after the file. Lights count from 1, as everywhere people read; every one of `lights` must
/// have figures. Throws InputError with file and line.
WhiteFactorTable read_white_factor(const std::filesystem::path& file, std::size_t lights);

}  // namespace brdfgate
