// A list of directions as a CSV file: what `design points` writes and `design path` reads.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "model/directions.hpp"

namespace brdfgate {

/// Lines "theta_h_deg,theta_d_deg,phi_d_deg" under a header line of these names. Empty lines and
/// those that begin with # are skipped. Throws InputError naming file and line: unreadable, another
/// header, not three numbers, below the horizon, no direction at all.
std::vector<HalfDiff> read_directions(const std::filesystem::path& file);
std::string directions_csv(const std::vector<HalfDiff>& directions);

}  // namespace brdfgate
