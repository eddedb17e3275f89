// Lists of single reflectance measurements from a goniometer, as text.
//
// The Cornell format: '#' starts a comment; the number of wavelengths n; n wavelengths (nm, rising,
// over as many lines as it takes); then one measurement per line: theta_i phi_i theta_o phi_o in
// radians, from the normal and around it, and n values of f_r in 1/sr. A list without wavelengths
// begins with its first measurement; its columns are then R, G, B or a single channel.
#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "model/basis.hpp"
#include "model/samples.hpp"

namespace brdfgate {

struct GoniometricList {
  std::vector<double> wavelengths_nm;  ///< rising; empty where the list names none
  std::vector<HalfDiff> angles;        ///< per measurement
  Eigen::MatrixXd f;                   ///< measurements x columns, 1/sr
};

/// Throws InputError with file:line: a word that is no number, a line of another length, an angle
/// out of range (theta 0 to below 90 degrees; phi within two turns), a value that is negative or
/// not finite, wavelengths that do not rise, no measurement at all, an unreadable or huge file.
GoniometricList read_goniometric(const std::filesystem::path& file);
/// The same from text; `name` is the file in messages.
GoniometricList parse_goniometric(std::string_view text, const std::string& name);

/// As samples: one bin per measurement, no variance. With wavelengths: linear between the two
/// neighbours of each band (R, G, B; nm). Without: the columns, 3 or 1.
/// Throws InputError for a band outside the list's wavelengths, or other than 1 or 3 columns.
BinnedSamples to_samples(const GoniometricList& list, const std::array<double, 3>& bands_nm);

/// Which directions to measure when only a few can be: chosen by the basis alone, before any value
/// is known, one after the other.
enum class DirectionCriterion {
  expected_error,  ///< least mean posterior variance over all candidates (I-optimal)
  determinant      ///< largest det(Q^T Q + eta I) (D-optimal)
};
/// `count` different candidates, in the order chosen; a tie goes to the first. Throws InputError
/// for a count below 1 or over the number of candidates.
std::vector<std::size_t> choose_directions(const Basis& basis,
                                           const std::vector<HalfDiff>& candidates, int count,
                                           DirectionCriterion criterion);

}  // namespace brdfgate
