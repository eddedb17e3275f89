// Contradictions between a station file's sections: what the rig cannot do with the region.
#pragma once

#include <vector>

#include "config/station_config.hpp"
#include "config/yaml_reader.hpp"

namespace brdfgate {

/// Refuses a region that reaches beyond the image: the middle of each edge must be seen (the nearer
/// corners of a tilted view need not). Preconditions: the configuration's geometry is filled.
void check_region(const StationConfig& config, const YamlNode& region_mm);

/// Refuses lights in the wrong roles: light 1's highlight on a flat part lies inside the region,
/// light 2's outside of it.
void check_highlights(const StationConfig& config, const std::vector<YamlNode>& lights);

/// Refuses a monitor patch that reaches into the inspected region or out of the image.
/// Precondition: there is one.
void check_monitor(const StationConfig& config, const YamlNode& monitor);

}  // namespace brdfgate
