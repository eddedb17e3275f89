// What a station knows of itself, and how it is found from recordings of dark and white.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "model/colour_model.hpp"
#include "model/frame.hpp"
#include "model/geometry.hpp"
#include "model/radiance.hpp"
#include "model/response.hpp"

namespace brdfgate {

/// Standard uncertainty of f where nothing is known of the reference's own radiance factor: it is
/// taken to lie within 5 % of a Lambertian's, all values alike (rectangular: 5 % / sqrt(3)).
inline constexpr double kUnknownWhiteSigma = 0.029;

/// Where a figure of the geometry comes from.
enum class GeometrySource { nominal, fitted, by_hand };

struct PlaceQuality {
  GeometrySource source = GeometrySource::nominal;
  double sigma_m = 0;   ///< of the position; 0: not known
  double residual = 0;  ///< camera: rms reprojection error in px; light: rms of ln(seen / fitted)
  bool operator==(const PlaceQuality&) const = default;
};

struct GeometryQuality {
  PlaceQuality camera;
  std::vector<PlaceQuality> lights;  ///< one per light, or empty: all nominal
};

/// The white reference's certificate; dates ISO 8601 (YYYY-MM-DD), empty where not given.
struct WhiteCertificate {
  std::string number;
  std::string date;
  std::string due;
  bool operator==(const WhiteCertificate&) const = default;
};

/// Calibration of one station; every result carries its hash.
struct Calibration {
  SensorFormat sensor;  ///< black level as measured; full well too, where a sweep measured it
  SensorNoise noise;    ///< as measured (read noise from darks, gain from white frame pairs)
  /// Of a camera with a tone curve, in whose chain sensor noise has no part; empty: linear counts.
  Response response;
  StationGeometry geometry;
  GeometryQuality quality;
  std::array<double, 3> white_reflectance{0.99, 0.99, 0.99};  ///< certified, per channel
  WhiteCertificate certificate;
  /// Per light: radiance of a black gauge over the white reference's, as measured, channels'
  /// largest; what it lies over the gauge's own reflectance is stray light. Empty: not measured.
  std::vector<double> stray_share;
  /// Per light: what the monitor patch reflects, 1/sr per channel, as measured beside the white
  /// reference. Empty: not measured, its maker's albedo counts.
  std::vector<Eigen::Array3d> patch_f;
  /// Camera RGB to XYZ, from a chart; none: no reading of colour is valid but a declared one.
  std::optional<CameraColour> colour;
  /// Name of the table of the reference's own radiance factor that `white` was freed of; empty:
  /// none, it is taken for Lambertian.
  std::string white_factor;
  /// Relative standard uncertainty of f that all its values have in common, from what is not known
  /// of the reference (model/white_factor.hpp).
  double white_sigma = kUnknownWhiteSigma;
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
  std::optional<double> gain_dn_per_e;  ///< of a photon-transfer sweep, instead of the whites'
  std::optional<double> full_well_dn;   ///< of the same; the lower of it and the sensor's counts
  Response response;                    ///< of a camera with a tone curve; no gain is measured then
};
Calibration calibrate(const CalibrationInput& input);

/// What the darks tell, checked as calibrate() does: the sensor with its black level, and its read
/// noise.
struct DarkLevels {
  double black_level_dn = 0;
  double read_noise_dn = 0;
};
DarkLevels measure_darks(const CalibrationInput& input);

/// A capture with the sensor as calibrated: its recording holds the datasheet's black level and
/// full well. Frames share their pixels. Throws InputError for another format than the
/// calibration's.
Capture levelled(const Capture& capture, const Calibration& calibration);

/// A capture to radiance with what the calibration knows of the sensor: black level, full well, and
/// noise or tone curve. Throws InputError for another sensor format than the calibration's, and as
/// to_radiance(capture, noise, lights) does.
RadianceSet to_radiance(const Capture& capture, const Calibration& calibration);

}  // namespace brdfgate
