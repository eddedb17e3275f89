#include "model/reading_rows.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "model/error.hpp"
#include "model/mapping.hpp"
#include "model/readings.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

constexpr double kNormal90 = 1.6448536269514722;
constexpr double kDegree = EIGEN_PI / 180;
constexpr float kLargestMapped = 80;  ///< float's exponent; no measured material exceeds 20
constexpr std::array<double, 3> kGlossDeg{20, 60, 85};

/// Three glosses, five colours: each errs in its own way beyond the basis.
constexpr Index kPlaces = 8;

/// A reading's gradient, whitened: L_a^T g_a, then s h_a in the row of its place; (k + kPlaces) x
/// channels. Sums and differences of readings are those of these.
using Whitened = Eigen::MatrixXd;

/// Covariance factors of the weights.
class Posterior {
 public:
  Posterior(const Weights& weights, double basis_error)
      : basis_error_(basis_error), correlation_(weights.channel_correlation) {
    if (correlation_.size() == 0) {
      correlation_ = Eigen::MatrixXd::Identity(weights.c.cols(), weights.c.cols());
    }
    if (std::ssize(weights.covariance) != weights.c.cols()) return;
    for (const Eigen::MatrixXd& covariance : weights.covariance) {
      // Single precision went into it: what it has lost below is put back as a sliver of its trace.
      Eigen::MatrixXd whole = covariance;
      whole.diagonal().array() += 1e-9 * covariance.trace();
      factor_.emplace_back(whole.llt().matrixL());
    }
  }
  bool known() const { return !factor_.empty(); }

  /// @param together  h, one a channel
  Whitened whiten(const Eigen::MatrixXd& gradient, const Eigen::RowVectorXd& together,
                  Index place) const {
    Whitened out = Whitened::Zero(gradient.rows() + kPlaces, gradient.cols());
    if (!known()) return out;
    out.row(gradient.rows() + place) = basis_error_ * together;
    for (Index ch = 0; ch < gradient.cols(); ++ch) {
      out.col(ch).head(gradient.rows()) =
          factor_[static_cast<std::size_t>(ch)].triangularView<Eigen::Lower>().transpose() *
          gradient.col(ch);
    }
    return out;
  }
  double sigma(const Whitened& u) const {
    if (!known()) return std::numeric_limits<double>::quiet_NaN();
    return std::sqrt(std::max(0.0, (u.transpose() * u).cwiseProduct(correlation_).sum()));
  }

 private:
  double basis_error_;
  Eigen::MatrixXd correlation_;
  std::vector<Eigen::MatrixXd> factor_;
};

/// What all channels say at the directions, with derivatives by the mapped value.
struct Seen {
  Eigen::ArrayXXf f;      ///< 1/sr, rows x channels
  Eigen::ArrayXXf slope;  ///< df/dx
  Rgb rgb(Index row) const {
    if (f.cols() == 1) return Rgb::Constant(f(row, 0));
    return f.row(row).transpose().cast<double>();
  }
};

/// Camera RGB to XYZ with its derivatives; mono: one column for all three.
class Colour {
 public:
  Colour(const std::optional<CameraColour>& camera, Index channels)
      : camera_(camera), channels_(channels) {}
  bool linear() const { return !camera_ || camera_->model == ColourModel::matrix; }
  Eigen::Array3d xyz(const Rgb& rgb) const {
    return camera_ ? camera_->xyz(rgb) : linear_srgb_to_xyz(rgb);
  }
  Eigen::MatrixXd slope(const Rgb& rgb) const {
    const Eigen::Matrix3d all = camera_ ? camera_->xyz_slope(rgb) : linear_srgb_xyz_matrix();
    if (channels_ == 1) return all.rowwise().sum();
    return all;
  }

 private:
  const std::optional<CameraColour>& camera_;
  Index channels_;
};

struct GlossOf {
  double value = 0;
  Whitened u;
};

/// Sum of w Y(f) over a block of rows.
GlossOf gloss_of(const Eigen::Ref<const Eigen::MatrixXf>& q,
                 const Eigen::Ref<const Eigen::ArrayXf>& weight, const Seen& seen,
                 const Colour& colour, const Posterior& posterior, Index place) {
  Eigen::MatrixXf by_value(q.rows(), seen.f.cols());  // d gloss / d mapped value
  double gloss = 0;
  if (colour.linear()) {
    const Eigen::MatrixXd slope = colour.slope(Rgb::Ones());
    for (Index ch = 0; ch < seen.f.cols(); ++ch) {
      gloss += slope(1, ch) * double((weight * seen.f.col(ch)).sum());
      by_value.col(ch) = (float(slope(1, ch)) * weight * seen.slope.col(ch)).matrix();
    }
  } else {
    for (Index row = 0; row < q.rows(); ++row) {
      const Rgb rgb = seen.rgb(row);
      gloss += double(weight[row]) * colour.xyz(rgb)[1];
      by_value.row(row) =
          weight[row] * colour.slope(rgb).row(1).cast<float>().array() * seen.slope.row(row);
    }
  }
  const Eigen::MatrixXf gradient = q.transpose() * by_value;
  return {gloss < 0 ? 0 : gloss, posterior.whiten(gradient.cast<double>(),
                                                  by_value.colwise().sum().cast<double>(), place)};
}

struct ColourOf {
  Lab lab;
  std::array<Whitened, 3> u;
};

ColourOf colour_of(const Eigen::RowVectorXf& q, const Seen& seen, Index row, const Colour& colour,
                   const Posterior& posterior, Index place) {
  const Rgb rgb = EIGEN_PI * seen.rgb(row);
  const Eigen::Array3d xyz = colour.xyz(rgb);
  const Eigen::MatrixXd by_channel = lab_slope(xyz) * colour.slope(rgb);
  const Whitened along = posterior.whiten(q.transpose().cast<double>().replicate(1, seen.f.cols()),
                                          Eigen::RowVectorXd::Ones(seen.f.cols()), place);
  ColourOf out{xyz_to_lab(xyz), {}};
  for (Index i = 0; i < 3; ++i) {
    const Eigen::RowVectorXd by_value =
        by_channel.row(i).array() * EIGEN_PI * seen.slope.row(row).cast<double>();
    out.u[static_cast<std::size_t>(i)] = along * by_value.asDiagonal();
  }
  return out;
}

/// Alman's index and its gradient from L* at 15, 45 and 110 degrees.
Reading flop_of(const std::array<ColourOf, 5>& at, const Posterior& posterior) {
  Reading flop;
  const double l15 = at[0].lab[0], l45 = at[2].lab[0], l110 = at[4].lab[0];
  flop.value = flop_index(l15, l45, l110);
  const double fall = l15 - l110;
  // Held at 0 there, or undefined: no slope tells how uncertain it is.
  if (!(fall > 0) || !(l45 > 0)) return flop;
  const double by_fall = 1.11 * flop.value / fall, by_l45 = -0.86 * flop.value / l45;
  flop.sigma = posterior.sigma(by_fall * (at[0].u[0] - at[4].u[0]) + by_l45 * at[2].u[0]);
  return flop;
}

void check(const Weights& weights, int components) {
  if (weights.c.rows() != components || (weights.c.cols() != 1 && weights.c.cols() != 3)) {
    throw InputError("weights",
                     std::to_string(weights.c.rows()) + " components of " +
                         std::to_string(weights.c.cols()) + " channels",
                     std::to_string(components) + " of 1 or 3");
  }
  if (!weights.c.allFinite()) throw InputError("weights", "not a number", "finite values");
}

}  // namespace

std::array<double, 2> Reading::interval() const {
  return {value - kNormal90 * sigma, value + kNormal90 * sigma};
}

std::array<double, 2> Reading::interval_by_factor() const {
  const double factor = value > 0 ? std::exp(kNormal90 * sigma / value) : 1;
  return {value / factor, value * factor};
}

ReadingRows::ReadingRows(std::shared_ptr<const Basis> basis, std::optional<CameraColour> colour,
                         double basis_error)
    : basis_(std::move(basis)), colour_(std::move(colour)), basis_error_(basis_error) {
  std::vector<HalfDiff> at;
  std::vector<float> weights;
  for (std::size_t i = 0; i < kGlossDeg.size(); ++i) {
    gloss_from_[i] = std::ssize(at);
    for (const GlossNode& node : gloss_nodes(static_cast<GlossGeometry>(i))) {
      at.push_back(node.angles);
      weights.push_back(static_cast<float>(node.specular));
    }
  }
  gloss_from_[3] = std::ssize(at);
  for (const double deg : kAspecularDeg)
    at.push_back(to_half_diff(aspecular_directions(deg)));
  const BasisRows rows = basis_->rows(at);
  q_ = rows.q.cast<float>();
  mean_ = rows.mean.array().cast<float>();
  const Eigen::ArrayXd offset = kMappingEpsilon / rows.weight.array();
  offset_ = offset.cast<float>();
  scale_ = (rows.median.array() + offset).cast<float>();
  gloss_weight_ = Eigen::Map<const Eigen::ArrayXf>(weights.data(), std::ssize(weights));
}

ClusterReadings ReadingRows::read(const Weights& weights) const {
  check(weights, basis_->info().components);
  const Eigen::MatrixXf c = weights.c.cast<float>();
  Seen seen;
  seen.slope = (q_ * c).array();
  seen.slope = ((seen.slope.colwise() + mean_).min(kLargestMapped).exp()).colwise() * scale_;
  seen.f = (seen.slope.colwise() - offset_).max(0.0F);
  const Posterior posterior(weights, basis_error_);
  const Colour colour(colour_, c.cols());

  ClusterReadings out;
  std::array<GlossOf, 3> gloss;
  for (std::size_t i = 0; i < 3; ++i) {
    const Index from = gloss_from_[i], n = gloss_from_[i + 1] - from;
    const Seen block{seen.f.middleRows(from, n), seen.slope.middleRows(from, n)};
    gloss[i] = gloss_of(q_.middleRows(from, n), gloss_weight_.segment(from, n), block, colour,
                        posterior, static_cast<Index>(i));
    out.gloss[i].value = gloss[i].value;
    out.gloss[i].sigma = posterior.sigma(gloss[i].u);
  }
  out.haze.value = haze_gu({gloss[0].value, gloss[1].value, gloss[2].value});
  if (std::isfinite(out.haze.value)) out.haze.sigma = posterior.sigma(gloss[1].u - gloss[0].u);

  std::array<ColourOf, 5> colours;
  for (std::size_t i = 0; i < colours.size(); ++i) {
    const Index row = gloss_from_[3] + static_cast<Index>(i);
    colours[i] = colour_of(q_.row(row), seen, row, colour, posterior, 3 + static_cast<Index>(i));
    for (std::size_t j = 0; j < 3; ++j) {
      out.aspecular[i].lab[j].value = colours[i].lab[static_cast<Index>(j)];
      out.aspecular[i].lab[j].sigma = posterior.sigma(colours[i].u[j]);
    }
  }
  out.flop = flop_of(colours, posterior);
  return out;
}

ClusterReadings ReadingRows::read(const Weights& weights, const BinnedSamples& seen) const {
  ClusterReadings out = read(weights);
  for (std::size_t i = 0; i < 3; ++i)
    out.gloss[i].measured = is_gloss_measured(seen, kGlossDeg[i]);
  out.haze.measured = out.gloss[0].measured && out.gloss[1].measured;
  for (std::size_t i = 0; i < out.aspecular.size(); ++i) {
    const bool measured = is_measured(seen, to_half_diff(aspecular_directions(kAspecularDeg[i])));
    for (Reading& reading : out.aspecular[i].lab)
      reading.measured = measured;
  }
  out.flop.measured = out.aspecular[0].lab[0].measured && out.at_45_0().lab[0].measured &&
                      out.aspecular[4].lab[0].measured;
  return out;
}

bool is_gloss_measured(const BinnedSamples& seen, double incidence_deg) {
  return std::any_of(seen.bins.begin(), seen.bins.end(), [&](const Bin& bin) {
    return bin.light == 1 && bin.angles.theta_h < kPeakThetaH &&
           std::abs(bin.angles.theta_d - incidence_deg * kDegree) < kGlossReach;
  });
}

}  // namespace brdfgate
