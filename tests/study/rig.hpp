// The rig of the literature (validation.hpp) on materials that a basis has not seen: what is
// measured of a material, one JSON object each, and what those measurements share.
#pragma once

#include <Eigen/Cholesky>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "model/estimators.hpp"
#include "model/example_regression.hpp"
#include "model/merl.hpp"
#include "model/pose.hpp"
#include "model/reading_rows.hpp"
#include "support/simple_regression.hpp"

namespace brdfgate::study {

inline constexpr double kDegree = std::numbers::pi / 180;
/// Relative, per row; a bin of the default station has less.
inline constexpr double kRowNoise = 0.01;

inline constexpr int kLattice = 15;
/// Of what the camera sees from 1 m, m.
inline const double kRadius = std::tan(12.5 * kDegree);
inline const double kStep = 2 * kRadius / (kLattice - 1);

/// Sightlines of the literature's rig, light after light; the camera is 1 m away.
std::vector<Sightline> rig();

/// Truth on the cells of a 45 x 45 x 45 grid, and the basis' rows there.
class Evaluation {
 public:
  explicit Evaluation(const Basis& basis);
  Eigen::MatrixXd truth(const Brdf& brdf) const;
  /// RMS over the cells in mapped units, mean over the channels.
  double error(const Eigen::MatrixXd& truth, const Eigen::MatrixXd& c) const;
  /// The weights of least squares over all cells.
  Eigen::MatrixXd best(const Eigen::MatrixXd& truth) const;

 private:
  std::vector<HalfDiff> cells_;
  BasisRows rows_;
  Eigen::LDLT<Eigen::MatrixXd> factor_;
};

struct Study {
  std::shared_ptr<const Basis> basis;
  Evaluation evaluation;
  std::shared_ptr<const Estimator> own;
  std::shared_ptr<const Estimator> anywhere;  ///< the same, for directions that come once
  std::shared_ptr<const Estimator> papers;
  ReadingRows readings;
  std::vector<Sightline> lines = rig();
  mutable std::shared_ptr<const ExampleRegression> plain;  ///< trained when first needed
  mutable std::vector<std::pair<std::string, test::SimpleRegression>> kernels;  ///< as `plain`
};

/// Reflectance at the sightlines of a part that lies so; noise from the generator, if any.
Eigen::MatrixXd observe(const Brdf& brdf, const std::vector<Sightline>& lines, const PartPose& pose,
                        std::mt19937_64* noise);

BinnedSamples to_samples(const std::vector<Sightline>& lines, const PartPose& pose,
                         const Eigen::MatrixXd& f, double relative_noise);

/// RMS over the first 8 weights of all channels, prior deviations.
double moved(const Study& s, const Weights& a, const Weights& b);

/// A part tilted in a few ways, against the flat one: on the rig's single points.
nlohmann::json tilt_of(const Study& s, const Brdf& brdf, const std::string& name);
/// The same as an inspection samples: cells of the default station's image, averaged in its bins.
nlohmann::json inspected_of(const Study& s, const Brdf& brdf, const std::string& name);
/// Of the leading weights: whether the 90 % interval holds the truth, and log scores; the same of
/// the readings.
nlohmann::json coverage_of(const Study& s, const Brdf& brdf, const std::string& name);

}  // namespace brdfgate::study
