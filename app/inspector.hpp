// One part's way from frames to a verdict, composed from model/.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "config/station_config.hpp"
#include "model/basis.hpp"
#include "model/calibration.hpp"
#include "model/canonical.hpp"
#include "model/estimators.hpp"
#include "model/judge.hpp"
#include "model/local_defects.hpp"
#include "model/pose_estimate.hpp"
#include "model/recipe.hpp"
#include "model/verdict.hpp"

namespace brdfgate {

/// Everything that is known of one inspected part: what the tool exports and draws.
struct Inspection {
  PartResult result;
  std::vector<Reflectance> reflectance;  ///< [0] light 1
  std::vector<BinnedSamples> samples;    ///< per cluster
  std::vector<Weights> linear;           ///< per cluster: ridge, what deviations are told from
  std::vector<std::optional<ClusterObservation>> observed;  ///< per cluster with valid weights
  PartFacts facts;        ///< what is known of the part as a whole
  cv::Mat taught_labels;  ///< per cell, where the registered part has them; empty without a layout
  DefectEvidence evidence;  ///< residuals against the taught material; empty without a recipe
};

/// A recipe with what is derived from it once, when it comes into force.
struct RecipeInForce {
  Recipe recipe;
  std::vector<TaughtAppearance> appearance;  ///< per cluster
  std::vector<BinFrame> frames;              ///< per cluster; empty: a part's own bins
  std::vector<BrdfPtr> defect_material;      ///< per cluster: what local residuals are told from
  cv::Mat taught_labels;  ///< CV_8UC1 of the cells, where the parts were taught; empty: no layout
  /// Readings' deviations from noise alone, without the basis' error; nullptr: no rule has a
  /// tolerance.
  std::shared_ptr<const ReadingRows> repeat_rows;
};

/// Holds what is fixed while calibration and basis are: directions, bins, expected appearances.
/// Thread-compatible: const members may run concurrently.
class Inspector {
 public:
  /// Throws InputError where the calibration belongs to another station than `config`.
  Inspector(const StationConfig& config, std::shared_ptr<const Basis> basis,
            Calibration calibration);

  /// Throws InputError where the recipe belongs to another basis, calibration or part height, or
  /// has rules on colour where this station knows none.
  RecipeInForce bring_into_force(Recipe recipe) const;

  /// Measures: regions (taught ones with a recipe, else found), bins, weights, readings, defects;
  /// no verdict yet. Throws InputError for a capture that does not fit the calibration (sizes,
  /// missing light or ambient frame).
  Inspection measure(const Capture& capture, const RecipeInForce* recipe = nullptr) const;

  /// Fills verdict and findings of a measured part. Without a recipe the verdict is "not judged"
  /// for lack of one, and weights and readings stay valid.
  void judge(Inspection& part, const RecipeInForce* recipe) const;

  /// What is wrong with the lights, told from the frames; empty: they work.
  std::string light_fault(const Capture& capture) const;

  /// Both. Where a light does not work nothing is measured: "not judged", reason hardware. `age`:
  /// of the calibration on the day of the capture, where it is known.
  Inspection inspect(const Capture& capture, const RecipeInForce* recipe,
                     const CalibrationAge& age = {}) const;

  /// A measured part's residuals against a recipe's materials, whichever way it was measured.
  DefectEvidence evidence_of(const Inspection& part, const RecipeInForce& recipe) const;

  const Basis& basis() const { return *basis_; }
  std::shared_ptr<const Basis> shared_basis() const { return basis_; }
  const Calibration& calibration() const { return calibration_; }
  const StationMap& map() const { return map_; }
  /// Camera and lights in the frame that map() and the published places are in: on the surface of
  /// a part of the configured height.
  const StationGeometry& geometry() const { return geometry_; }
  /// A reconstruction in linear sRGB, D65, 2 degrees, which readings of colour take: by the
  /// calibration's chart where it has one, else as the camera says.
  BrdfPtr seen_colour(const Weights& weights) const;
  /// Whether seen_colour() is colour: a chart in the calibration, or a declared camera.
  bool colour_known() const;
  double part_height_mm() const { return settings_.part_height_mm; }
  const DefectBlocks& defect_blocks() const { return *blocks_; }
  /// In force without a recipe; a recipe brings its own.
  const JudgeSettings& judge_settings() const { return judge_; }
  double eta() const { return settings_.eta; }
  const Estimator& estimator() const { return *estimator_; }
  /// Readings of seen_colour(), without the whole BRDF.
  const ReadingRows& readings() const { return *readings_; }

 private:
  /// Reflectance, the lamps' drift taken out where a monitor patch tells it, within its limit.
  void to_reflectance(const RadianceSet& radiance, Inspection& part) const;
  /// Labels; with a recipe that has a layout also shift, rotation and what is wrong with them.
  Regions regions_of(Inspection& part, const RecipeInForce* recipe) const;
  cv::Mat place(Inspection& part, const cv::Mat& not_part, const Recipe& recipe) const;
  double ambient_level(const Radiance& ambient, const std::vector<Reflectance>& r,
                       const cv::Mat& on_part) const;
  const JudgeSettings& settings_for(const RecipeInForce* recipe) const;
  ClusterResult measure_cluster(const BinnedSamples& samples, int index, int min_bins) const;
  /// Fills the part's pose and returns it; light-1 cells of the largest cluster tell it.
  PartPose pose_of(Inspection& part) const;
  void measure_clusters(Inspection& part, const RecipeInForce* recipe) const;
  /// What noise alone lets the readings scatter, by the ridge's gain.
  ClusterReadings repeatability(const ReadingRows& rows, const Weights& weights,
                                const BinnedSamples& on_frame) const;

  InspectionConfig settings_;
  JudgeSettings judge_;
  std::shared_ptr<const Basis> basis_;
  Calibration calibration_;
  StationGeometry geometry_;  ///< in the frame of a part of the configured height
  StationMap map_;
  std::vector<cv::Point> patch_;  ///< cells of the monitor patch, where there is one
  std::vector<double> white_levels_;
  std::shared_ptr<const DefectBlocks> blocks_;
  std::shared_ptr<const Estimator> estimator_;
  std::shared_ptr<const ReadingRows> readings_;
};

}  // namespace brdfgate
