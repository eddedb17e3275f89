// Capability of the gate as a gauge, for one reading: repeatability and bias on one part (type 1),
// and repeatability and reproducibility over many (GRR).
//
// Sources: Bosch, Quality Management in Technology, booklet 10, "Capability of Measurement and Test
// Processes", 2019, and VDA volume 5, 3rd ed., 2021 (type 1); AIAG, Measurement Systems Analysis,
// 4th ed., 2010, chapter III B and appendices A and C (GRR).
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

namespace brdfgate {

/// One part measured again and again.
struct Type1Input {
  std::vector<double> values;       ///< two or more; 25 to 50 make a study
  double tolerance = 0;             ///< T, width of the tolerance zone, over 0, the reading's unit
  std::optional<double> reference;  ///< the part's true value; none: no bias, no Cgk, no Q_MS
  double reference_sigma = 0;       ///< standard uncertainty of that value
};

/// Booklet 10: Cg = 0.2 T / (6 s), Cgk = (0.1 T - |mean - reference|) / (3 s), capable from 1.33
/// on. VDA 5: U_MS = 2 sqrt(u_cal^2 + s^2 + u_bias^2), u_bias = |bias| / sqrt(3), Q_MS = 2 U_MS /
/// T, capable up to 15 %. (Resolution is no limit to a floating-point reading.)
struct Type1Result {
  static constexpr double kCapable = 1.33;
  static constexpr double kMostQms = 0.15;
  int count = 0;
  double mean = 0;
  double s = 0;                  ///< standard deviation, n - 1
  double cg = 0;                 ///< infinite where all values are equal
  std::optional<double> bias;    ///< mean - reference
  std::optional<double> cgk;     ///< may be negative
  std::optional<double> bias_t;  ///< |bias| sqrt(n) / s; n - 1 degrees of freedom
  std::optional<double> q_ms;    ///< share of the tolerance
  /// Smallest tolerance for which Cg reaches 1.33: 1.33 * 6 s / 0.2 (booklet 10).
  double least_tolerance = 0;
  bool capable() const { return cg >= kCapable && (!cgk || *cgk >= kCapable); }
};
/// Throws InputError: fewer than two values, one that is not finite, a tolerance not over 0, a
/// negative uncertainty.
Type1Result type1_study(const Type1Input& input);

/// Parts by operators by trials, all of one count: values[part](operator, trial). What an operator
/// is, is the study's choice: a shift, a loading, a station.
struct GrrInput {
  std::vector<Eigen::ArrayXXd> values;  ///< two parts or more, one operator or more, two trials+
  double tolerance = 0;                 ///< 0: none, no share of the tolerance
};

/// A line of the analysis of variance.
struct VarianceLine {
  std::string source;  ///< "operator", "part", "operator x part", "repeatability", "total"
  int dof = 0;
  double ss = 0;
  double ms = 0;
  double f = 0;  ///< 0 where it has none
  double p = 1;  ///< of the F test
};

/// Standard deviations and what follows from them; shares are of the total variation (6 s by 6 s).
struct GrrResult {
  double ev = 0;           ///< repeatability (equipment variation)
  double av = 0;           ///< reproducibility (appraiser variation), without the interaction
  double interaction = 0;  ///< operator by part; 0 where pooled or not estimated
  double grr = 0;          ///< sqrt(ev^2 + av^2 + interaction^2)
  double pv = 0;           ///< part variation
  double tv = 0;           ///< sqrt(grr^2 + pv^2)
  double grr_share = 0;    ///< %GRR / 100; under 0.1 acceptable, to 0.3 perhaps (AIAG)
  std::optional<double> tolerance_share;  ///< 6 grr / T
  /// 1.41 pv / grr, not yet truncated to the whole number of distinct categories; 5 or more.
  double ndc = 0;
  std::vector<VarianceLine> table;  ///< of the analysis of variance
};

/// Two-way random effects with interaction; the interaction is pooled with the repeatability where
/// its F test has p > 0.05. One operator: one way, no reproducibility. Negative variances are 0.
/// Throws InputError: too few or unequal counts, a value that is not finite, a negative tolerance.
GrrResult grr_anova(const GrrInput& input);
/// AIAG's average and range method: EV = R / d2(trials), AV from the range of the operators'
/// averages and PV from that of the parts' by d2*(n, 1).
GrrResult grr_average_range(const GrrInput& input);

/// Mean range of n standard normal values, and d2* of g subgroups: sqrt(d2^2 + d3^2 / g) (Duncan
/// 1974; AIAG appendix C). By quadrature, n in 2..200.
double d2(int n);
double d2_star(int n, int subgroups);

/// Upper tail of Fisher's F (continued fraction of the incomplete beta function).
double f_upper_tail(double f, double dof_above, double dof_below);

}  // namespace brdfgate
