// What a station knows of itself, and how it is found from recordings of dark and white.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "model/frame.hpp"
#include "model/geometry.hpp"
#include "model/radiance.hpp"

namespace brdfgate {

/// Calibration of one station; every result carries its hash.
struct Calibration {
  SensorFormat sensor;  ///< black level as measured
  SensorNoise noise;    ///< as measured (read noise from darks, gain from white frame pairs)
  StationGeometry geometry;
  std::array<double, 3> white_reflectance{0.99, 0.99, 0.99};  ///< certified, per channel
  std::vector<Radiance>
      white;                 ///< reference plate under each light, ambient subtracted; [0] light 1
  std::string station_hash;  ///< of the station configuration it was made for
  std::string created;       ///< ISO 8601 date
  std::string hash;  ///< SHA-256 of the file's content, hex; set by the file reader and writer
};

/// From at least one dark capture (no light, several exposures) and at least one white capture
/// (brackets under every light and an ambient frame); two or more whites measure the gain
/// (photon transfer: variance of the difference of equal frames against their mean), one leaves
/// `nominal` in force. Whites are averaged. Leaves station_hash, created and hash empty: the caller
/// knows them.
/// Throws InputError: no darks or whites, other sensor format, a white that is dark under a light
/// (names the light), a dark that is not dark, clipped reference.
struct CalibrationInput {
  std::vector<Capture> darks;
  std::vector<Capture> whites;
  StationGeometry geometry;
  SensorNoise nominal;
  std::array<double, 3> white_reflectance{0.99, 0.99, 0.99};
};
Calibration calibrate(const CalibrationInput& input);

}  // namespace brdfgate
