// From calibration recordings to a calibration: what `brdfgate calibrate` composes from model/.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "app/recording.hpp"
#include "config/station_config.hpp"
#include "model/calibration.hpp"
#include "model/camera_colour.hpp"
#include "model/geometry_calibration.hpp"
#include "model/linearity.hpp"

namespace brdfgate {

/// What a technician says besides the recordings.
struct CalibrationRequest {
  std::array<double, 3> white_reflectance{0.99, 0.99, 0.99};
  WhiteCertificate certificate;
  BoardPattern board;
  std::filesystem::path geometry;    ///< poses measured by hand; empty: none
  std::filesystem::path last;        ///< the calibration before this one; empty: none
  double black_reflectance = 0.005;  ///< of the black gauge itself
  std::filesystem::path chart;       ///< file of another chart than the classic one
  ColourModel colour_model = ColourModel::matrix;
  std::filesystem::path white_factor;  ///< table of the plate's radiance factor; empty: none
  double white_factor_sigma = 0.005;
  double max_stray = 0.01;  ///< stray light, share of white; beyond: refused (method.md section 5)
};

/// Stray light from which the summary warns: 0.1 % of white is harmless, 1 % moves the mean
/// reconstruction error from 0.295 to 0.394 (method.md section 5, pilot).
inline constexpr double kStrayToMention = 0.002;

/// Everything that was recorded, by what it is for.
struct CalibrationRecordings {
  CalibrationInput levels;  ///< darks and whites
  GeometryInput geometry;   ///< boards, mirrors, raised whites
  std::vector<NamedCapture> blacks;
  std::vector<NamedCapture> charts;
  std::vector<NamedCapture> nests;  ///< open, or a part in it: the monitor patch is in view
  std::vector<Capture> sweep;       ///< photon transfer, or the bracket that tells a tone curve

  /// Sorts one recording in by its role; a part shows the nest.
  void add(const std::string& name, Recording&& recording);
};

/// Empty recordings for this station and request. Throws InputError: no possible board, an unusable
/// geometry file.
CalibrationRecordings start_recordings(const CalibrationRequest& request,
                                       const StationConfig& config);

/// What the chart's patches looked like to the camera.
struct ChartSeen {
  ColourChart chart;
  std::vector<Eigen::Array3d> rgb;  ///< mean over the recordings
};

struct CalibrationOutcome {
  Calibration calibration;
  std::optional<PhotonTransfer> sweep;
  GeometryResult geometry;
  std::optional<ChartSeen> chart;
  std::vector<double> drift;  ///< per light against the last calibration; empty: none given
  std::optional<int> days_until_due;
  std::vector<std::string> warnings;
};

/// Throws InputError naming the recording and what is wrong with it. station_hash, created and
/// certificate are filled in; the hash comes with writing the file.
CalibrationOutcome make_calibration(const CalibrationRecordings& recordings,
                                    const CalibrationRequest& request, const StationConfig& config);

/// What the darks and the sweep so far tell of the sensor, the rest as configured: enough to find
/// boards by. Throws as make_calibration does.
CalibrationOutcome sensor_calibration(const CalibrationRecordings& recordings,
                                      const StationConfig& config);

/// A recording of this station, whatever its role. Throws InputError where it is another's.
Recording read_station_recording(const std::filesystem::path& dir, const StationConfig& config);

}  // namespace brdfgate
