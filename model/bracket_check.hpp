// Frames of one bracket against each other: what a camera cannot have seen.
//
// A driver that reports exposures truthfully may still deliver a frozen, black or wrongly exposed
// picture. Under one light a linear sensor's signal is proportional to exposure and gain (EMVA
// 1288), which a few rows of pixels show. Cheap: every eighth row is looked at.
#pragma once

#include <optional>
#include <span>
#include <string>

#include "model/frame.hpp"

namespace brdfgate {

/// The first contradiction between frames of one bracket, for people; nothing: there is none. A
/// scene too dark or too bright to tell contradicts nothing. `linear`: counts are proportional to
/// light; else only that more exposure is not darker is asked.
/// Precondition: all frames have the sensor's size.
std::optional<std::string> bracket_contradiction(std::span<const RawFrame> frames,
                                                 const SensorFormat& sensor, bool linear);

}  // namespace brdfgate
