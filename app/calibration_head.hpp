// The YAML head of a calibration file: everything but the pixels.
#pragma once

#include <string>
#include <vector>

#include "model/calibration.hpp"

namespace brdfgate {

inline constexpr const char* kCalibrationSchema = "brdfgate.calibration/1";

struct CalibrationHead {
  Calibration calibration;          ///< without white
  std::vector<double> white_scale;  ///< per light: DN/s of 1.0 in its layers
  std::string checksum;             ///< of the head above its line and the layers, hex
};

/// Everything above the checksum's line.
std::string calibration_head_text(const Calibration& calibration,
                                  const std::vector<double>& white_scale);
/// The whole head.
std::string with_checksum(const std::string& head_text, const std::string& checksum);
/// The part of a whole head that the checksum covers.
std::string without_checksum(const std::string& head);

/// Throws InputError with `name`, line, column and field.
CalibrationHead parse_calibration_head(const std::string& head, const std::string& name);

}  // namespace brdfgate
