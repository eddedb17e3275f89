// The calibration's report: one HTML page with its pictures in it, to file with the certificate.
#pragma once

#include <filesystem>
#include <string>

#include "app/calibration_work.hpp"

namespace brdfgate {

/// Figures, warnings, and pictures of the reference's uniformity, the falloff's residuals, the
/// reprojection errors and the noise curve (or the tone curve), each where it was measured. Written
/// whole or not at all. Throws InputError: gnuplot not installed, a place that cannot be written.
void write_calibration_report(const std::filesystem::path& file, const CalibrationOutcome& outcome,
                              const CalibrationRecordings& from);

}  // namespace brdfgate
