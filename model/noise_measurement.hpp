// The sensor's black level, read noise and gain from recordings (EMVA Standard 1288).
#pragma once

#include <vector>

#include "model/frame.hpp"

namespace brdfgate {

/// Mean count of all frames of the dark captures.
double measure_black_level(const std::vector<Capture>& darks);

/// Standard deviation of a dark count at analogue gain 1 from pairs of equal dark frames (without
/// pairs: from the shortest frame's pixels), hot pixels left out, quantisation's 1/12 taken off.
/// Where the counts vary by less than 0.24 DN^2 quantisation hides the read noise (EMVA 1288):
/// then `nominal` stays.
double measure_read_noise(const std::vector<Capture>& darks, const SensorNoise& nominal);

/// Photon transfer: DN per electron at analogue gain 1 from pairs of equal frames of different
/// captures, var(difference) against the mean, by sensor rows, their median. Only pixels between 5
/// and 80 % of full well count. The captures' black level and `noise.read_noise_dn` are as
/// measured. Throws InputError where no two captures share a usable frame.
double measure_gain(const std::vector<Capture>& whites, const SensorNoise& noise);

}  // namespace brdfgate
