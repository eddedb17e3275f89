// The taught reference material and the limits it sets.
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "model/colour.hpp"
#include "model/estimator.hpp"
#include "model/monitored.hpp"
#include "model/observation.hpp"
#include "model/reading_rows.hpp"
#include "model/registration.hpp"
#include "model/rules.hpp"
#include "model/samples.hpp"

namespace brdfgate {

/// Settings of teaching and judging; from YAML, with these defaults.
struct JudgeSettings {
  double false_reject_rate = 0.001;    ///< per part, all clusters and statistics, (0, 0.5)
  double change_floor = 0.002;         ///< part-to-part deviation never taken smaller, ln units
  double colour_limit_de00 = 1.5;      ///< CIEDE2000 to the taught colour
  double gloss_limit_gu = 8;           ///< |gloss 60 - taught|
  double area_share_limit = 0.03;      ///< change of a cluster's share of the part
  double unknown_share_limit = 0.002;  ///< share of the part that no taught cluster explains
  double assign_tolerance = 0.45;      ///< ln f; farther from every taught cluster is unknown
  double defect_log_threshold = 0.03;  ///< |ln(f / expected)| of the smallest local defect
  double defect_min_mm2 = 1.0;         ///< smaller blobs are not reported
  double max_ambient = 0.05;           ///< share of white; beyond: not judged
  double max_clipped = 0.02;           ///< share of the part's cells; beyond: not judged
  double min_coverage = 0.05;          ///< of the inspected region; a smaller part is absent
  int min_bins = 20;                   ///< per cluster; fewer: not judged (coverage)
  double max_shift_mm = 5;             ///< from the taught place; beyond: not judged (pose)
  double max_rotation_deg = 5;         ///< in the plane; beyond: not judged (pose)
  double max_tilt_deg = 1.5;           ///< about either axis; beyond: not judged (tilt)
};

/// One taught cluster. Weights are in prior sigmas, channel by channel; monitored changes in ln
/// units.
struct TaughtCluster {
  std::string name;
  int parts = 0;                         ///< N: taught from; 0 in a draft without limits
  Eigen::MatrixXd mean;                  ///< k x channels
  MonitoredDirections directions;        ///< p of them
  Eigen::VectorXd monitored_mean;        ///< p
  Eigen::MatrixXd monitored_covariance;  ///< p x p, shrunk (limits.hpp) plus floor
  double t2_limit = 0;
  std::vector<int> bin_id;             ///< bins seen while teaching
  Eigen::MatrixXd bin_residual;        ///< bins x channels, mean of what the directions leave there
  Eigen::MatrixXd bin_residual_sigma;  ///< bins x channels, its part-to-part deviation, floored
  double spe_limit = 0;
  double area_share = 0;
  std::array<double, 3> gloss_gu{};
  Lab lab = Lab::Zero();
  ClusterReadings readings;  ///< of `mean`, derived when the recipe comes into force, not stored
};

/// What good parts show of local departures from their material: on tiles of kTileBlocks x
/// kTileBlocks defect blocks, per light (local_defects.hpp).
struct DefectReference {
  static constexpr int kTileBlocks = 4;
  int parts = 0;                          ///< taught from; 0: nothing taught, wide priors stand in
  double limit = 0;                       ///< on |z| of a part
  std::vector<Eigen::MatrixXd> material;  ///< per cluster k x channels, prior sigmas: what
                                          ///< residuals are told from
  std::vector<cv::Mat> mean;              ///< per light CV_32FC(channels), ln units
  std::vector<cv::Mat> deviation;         ///< per light, same type: part to part, > 0
};

struct Recipe {
  int id = 1;
  std::string name;
  std::string created;           ///< ISO 8601
  int parts = 0;                 ///< taught from
  std::string calibration_hash;  ///< it belongs to
  std::string basis_checksum;    ///< it belongs to
  int channels = 3;
  int components = 0;
  double part_height_mm = 0;  ///< of the taught parts' surface over the white reference's
  JudgeSettings settings;
  TaughtLayout layout;                  ///< empty: parts are not registered
  std::vector<TaughtCluster> clusters;  ///< 1..8
  DefectReference defects;
  RuleSet rules;                      ///< over the settings' limits on the same readings
  std::vector<std::string> warnings;  ///< e.g. taught from one part
};

/// What teaching needs of one good part's cluster.
struct TeachSample {
  BinnedSamples samples;
  Weights weights;
  double area_share = 0;
};

/// The bins that at least half of the parts saw, at their mean directions.
/// Throws InputError where there is none.
BinFrame common_frame(const std::vector<TeachSample>& parts);

/// The parts along the material's monitored directions on their common frame.
/// @param material  the taught reconstruction
struct ObservedParts {
  MonitoredDirections directions;
  std::vector<ClusterObservation> parts;
};
ObservedParts observe_parts(const Basis& basis, const Brdf& material,
                            const std::vector<TeachSample>& parts);

/// One cluster from N good parts (N >= 1): mean weights, shrunk covariance (limits.hpp), limits by
/// predictive simulation of the shrunk estimator with a fixed seed (limits.hpp), each for its share
/// of the part's false-reject rate. N = 1, 2 rest on a prior for the part-to-part deviation and the
/// measurements' own noise. A pure function of matrices, without directions, area share, gloss and
/// colour.
/// @param clusters  of the recipe: they share the rate
/// Throws InputError when empty, when shapes differ or a number is not finite.
TaughtCluster teach_observed(const std::vector<ClusterObservation>& parts,
                             const JudgeSettings& settings, int clusters = 1);

}  // namespace brdfgate
