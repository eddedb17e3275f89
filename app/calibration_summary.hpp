// What a calibration found, for machines and for people.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

#include "app/calibration_work.hpp"

namespace brdfgate {

/// brdfgate.calibration_report/1.
nlohmann::json calibration_json(const CalibrationOutcome& outcome,
                                const CalibrationRecordings& from);

/// To stdout; `file` is where the calibration went.
void print_calibration(const CalibrationOutcome& outcome, const CalibrationRecordings& from,
                       const std::filesystem::path& file);

}  // namespace brdfgate
