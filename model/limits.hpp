// Covariances from few parts and the limits of T^2 and SPE that hold for them (method.md section
// 8).
#pragma once

#include <Eigen/Core>

namespace brdfgate {

/// A part's false-reject rate divided (Bonferroni: statistics that move together reject less often
/// than their shares add up to): three quarters to T^2 and SPE of all clusters in equal shares, a
/// quarter to the part's local defects.
struct RateShares {
  double per_statistic = 0;
  double defects = 0;
};
RateShares split_rate(double per_part, int clusters);

/// Ledoit and Wolf 2004, "A well-conditioned estimator for large-dimensional covariance matrices":
/// shrinks the sample covariance (of N, not N - 1) toward its scaled identity. Rows are
/// observations, two or more.
Eigen::MatrixXd ledoit_wolf(const Eigen::MatrixXd& observations);

/// Covariance of good parts' monitored changes, shrunk towards independent changes of the parts'
/// own deviations: Ledoit and Wolf's covariance of the changes in units of those (of N). Their
/// scaled identity as it is gives all changes one deviation, and the gloss of a matte part deviates
/// ten times as much as its colour. The first `levels` changes are diffuse levels of channels; they
/// are told apart as their mean and the contrasts between them (Helmert's), because pigment and
/// lamps move them together: a shrunk correlation of the levels would loosen the colour. Rows are
/// parts, two or more; `levels` at most the columns. Keeps the sample covariance's trace.
Eigen::MatrixXd shrunk_covariance(const Eigen::MatrixXd& observations, int levels = 0);

/// T^2's limit by predictive simulation. The F law does not hold for a shrunk covariance, so the
/// whole estimator is played through: N parts are drawn from N(0, S), mean and shrunk covariance
/// (shrunk_covariance) plus floor^2 I estimated again, and T^2 of new parts taken with (1 + 1/N)
/// times that covariance; the limit is its quantile. With N = 1, 2 the covariance counts as known.
/// Fixed seed.
/// @param covariance  S, part to part, without the floor; directions in which it is smaller than
///                    floor^2 are drawn with floor^2
/// @param floor       standard deviation that every estimate adds, > 0
/// @param rate        false rejects, (0, 0.5)
/// @param levels      as in shrunk_covariance()
double t2_limit(const Eigen::MatrixXd& covariance, int parts, double floor, double rate,
                int levels = 0);

/// Box 1954: a sum of correlated squares goes as g chi^2_h, h = (tr C)^2 / tr C^2. Here for the
/// mean square of residuals in units of their deviations, from N rows of those (taught mean
/// removed): tr C^2 by the estimate that is unbiased for Gaussian rows of fewer rows than columns
/// (Srivastava 2005, eq. 1.6). In [1, columns].
double box_dof(const Eigen::MatrixXd& standardised);

/// SPE's limit: Box's law with its scale from leave-one-out, and its denominator's own uncertainty.
/// The deviations in SPE come from the N parts too, with h (N - 1) degrees of freedom, so SPE of a
/// fresh part follows F(h, h (N - 1)) rather than chi^2_h / h; the scale is the mean of the parts'
/// leave-one-out SPE, so that a fresh part is not systematically above them. Quantile by simulation
/// with a fixed seed.
double spe_limit(double leave_one_out_mean, double dof, int parts, double rate);

/// No SPE limit is lower: a part whose residuals differ from the taught ones by less than 1.2 of
/// their own part-to-part deviations is never rejected for it.
inline constexpr double kLeastSpeLimit = 1.5;
/// For N = 1, 2, where the deviation is the floor: twice it, RMS.
inline constexpr double kSpeLimitOfFew = 4.0;

}  // namespace brdfgate
