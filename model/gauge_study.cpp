#include "model/gauge_study.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr double kPoolFrom = 0.05;  ///< p of the interaction from which it is pooled
constexpr double kDistinct = 1.41;  ///< AIAG: sqrt(2), to the digits it prints

double squared(double x) {
  return x * x;
}

double root_of_positive(double variance) {
  return std::sqrt(std::max(0.0, variance));
}

double over(double a, double b) {
  if (b > 0) return a / b;
  return a > 0 ? std::numeric_limits<double>::infinity() : 0;
}

/// Counts of a study that is whole.
struct Shape {
  int parts = 0, operators = 0, trials = 0;
  int count() const { return parts * operators * trials; }
};

Shape shape_of(const GrrInput& input) {
  if (input.values.size() < 2) {
    throw InputError("study", std::to_string(input.values.size()) + " part(s)", "two or more");
  }
  const Shape shape{static_cast<int>(input.values.size()),
                    static_cast<int>(input.values.front().rows()),
                    static_cast<int>(input.values.front().cols())};
  for (std::size_t i = 0; i < input.values.size(); ++i) {
    const Eigen::ArrayXXd& part = input.values[i];
    if (part.rows() != shape.operators || part.cols() != shape.trials || part.rows() < 1 ||
        part.cols() < 2) {
      throw InputError("part " + std::to_string(i + 1),
                       std::to_string(part.rows()) + " operator(s) with " +
                           std::to_string(part.cols()) + " trial(s)",
                       "as many of each as the first part has, two trials or more");
    }
    if (!part.allFinite()) {
      throw InputError("part " + std::to_string(i + 1), "a value that is not finite", "a number");
    }
  }
  if (!(input.tolerance >= 0)) throw InputError("tolerance", "is negative", "over 0, or none");
  return shape;
}

double grand_mean(const GrrInput& input, const Shape& n) {
  double sum = 0;
  for (const Eigen::ArrayXXd& part : input.values)
    sum += part.sum();
  return sum / n.count();
}

Eigen::ArrayXd operator_means(const GrrInput& input, const Shape& n) {
  Eigen::ArrayXd mean = Eigen::ArrayXd::Zero(n.operators);
  for (const Eigen::ArrayXXd& part : input.values)
    mean += part.rowwise().sum();
  return mean / (n.parts * n.trials);
}

/// grr, tv and the shares from the four deviations.
void conclude(const GrrInput& input, GrrResult& r) {
  r.grr = std::sqrt(squared(r.ev) + squared(r.av) + squared(r.interaction));
  r.tv = std::hypot(r.grr, r.pv);
  r.grr_share = over(r.grr, r.tv);
  if (input.tolerance > 0) r.tolerance_share = 6 * r.grr / input.tolerance;
  r.ndc = over(kDistinct * r.pv, r.grr);
}

VarianceLine line(const char* source, int dof, double ss) {
  return {source, dof, ss, dof > 0 ? ss / dof : 0, 0, 1};
}

void test(VarianceLine& above, const VarianceLine& below) {
  if (above.dof == 0 || below.dof == 0) return;
  above.f = over(above.ms, below.ms);
  above.p = std::isfinite(above.f) ? f_upper_tail(above.f, above.dof, below.dof) : 0;
}

struct Squares {
  double parts = 0, operators = 0, interaction = 0, repeat = 0;
};

Squares squares_of(const GrrInput& input, const Shape& n) {
  const double mean = grand_mean(input, n);
  const Eigen::ArrayXd by_operator = operator_means(input, n);
  Squares s;
  s.operators = n.parts * n.trials * (by_operator - mean).square().sum();
  for (const Eigen::ArrayXXd& part : input.values) {
    const double of_part = part.mean();
    const Eigen::ArrayXd cell = part.rowwise().mean();
    s.parts += n.operators * n.trials * squared(of_part - mean);
    s.interaction += n.trials * (cell - of_part - by_operator + mean).square().sum();
    s.repeat += (part.colwise() - cell).square().sum();
  }
  return s;
}

double range(const Eigen::ArrayXd& values) {
  return values.maxCoeff() - values.minCoeff();
}

double normal_cdf(double x) {
  return std::erfc(-x / std::numbers::sqrt2) / 2;
}

struct RangeMoments {
  double mean = 0, second = 0;
};

/// First and second moment of the range of n standard normal values by the trapezoidal rule.
RangeMoments range_sums(int n, int steps) {
  constexpr double kReach = 8;
  const double step = 2 * kReach / steps;
  std::vector<double> cdf;
  for (int i = 0; i <= steps; ++i)
    cdf.push_back(normal_cdf(-kReach + i * step));
  RangeMoments m;
  for (std::size_t i = 0; i < cdf.size(); ++i) {
    // E W = int 1 - F^n - (1 - F)^n; E W^2 = 2 int int_{x < y} 1 - F(y)^n - (1 - F(x))^n +
    // (F(y) - F(x))^n.
    m.mean += step * (1 - std::pow(cdf[i], n) - std::pow(1 - cdf[i], n));
    for (std::size_t j = i; j < cdf.size(); ++j) {
      const double weight = i == j ? 0.5 : 1;  // the triangle's edge
      m.second +=
          2 * weight * step * step *
          (1 - std::pow(cdf[j], n) - std::pow(1 - cdf[i], n) + std::pow(cdf[j] - cdf[i], n));
    }
  }
  return m;
}

/// On the line the rule converges faster than any power; along the triangle's edge with the square
/// of the step, which Richardson's extrapolation takes out.
RangeMoments range_moments(int n) {
  constexpr int kSteps = 200;
  const RangeMoments coarse = range_sums(n, kSteps);
  const RangeMoments fine = range_sums(n, 2 * kSteps);
  return {fine.mean, (4 * fine.second - coarse.second) / 3};
}

/// Continued fraction of the incomplete beta function by Lentz's method (Abramowitz and Stegun
/// 26.5.8).
double beta_fraction(double x, double a, double b) {
  constexpr double kTiny = 1e-300;
  constexpr int kMost = 1000;
  double c = 1;
  double d = 1 - (a + b) * x / (a + 1);
  if (std::abs(d) < kTiny) d = kTiny;
  d = 1 / d;
  double value = d;
  for (int m = 1; m <= kMost; ++m) {
    for (const double step : {m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
                              -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))}) {
      d = 1 + step * d;
      if (std::abs(d) < kTiny) d = kTiny;
      d = 1 / d;
      c = 1 + step / c;
      if (std::abs(c) < kTiny) c = kTiny;
      value *= d * c;
    }
    if (std::abs(d * c - 1) < 1e-14) break;
  }
  return value;
}

double incomplete_beta(double x, double a, double b) {
  if (x <= 0) return 0;
  if (x >= 1) return 1;
  const double front = std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) +
                                a * std::log(x) + b * std::log1p(-x));
  if (x < (a + 1) / (a + b + 2)) return front * beta_fraction(x, a, b) / a;
  return 1 - front * beta_fraction(1 - x, b, a) / b;
}

}  // namespace

Type1Result type1_study(const Type1Input& input) {
  const auto n = static_cast<double>(input.values.size());
  if (input.values.size() < 2) {
    throw InputError("study", std::to_string(input.values.size()) + " value(s)",
                     "two or more; 25 to 50 make a study");
  }
  const Eigen::Map<const Eigen::ArrayXd> x(input.values.data(),
                                           static_cast<Eigen::Index>(input.values.size()));
  if (!x.allFinite()) throw InputError("study", "a value that is not finite", "a number");
  if (!(input.tolerance > 0)) throw InputError("tolerance", "not over 0", "its width, T");
  if (!(input.reference_sigma >= 0)) {
    throw InputError("reference's uncertainty", "is negative", "a standard deviation");
  }
  Type1Result r;
  r.count = static_cast<int>(input.values.size());
  r.mean = x.mean();
  r.s = std::sqrt((x - r.mean).square().sum() / (n - 1));
  r.cg = over(0.2 * input.tolerance, 6 * r.s);
  r.least_tolerance = Type1Result::kCapable * 6 * r.s / 0.2;
  if (!input.reference) return r;
  const double bias = r.mean - *input.reference;
  r.bias = bias;
  const double room = 0.1 * input.tolerance - std::abs(bias);
  r.cgk = room < 0 ? -over(-room, 3 * r.s) : over(room, 3 * r.s);
  r.bias_t = over(std::abs(bias) * std::sqrt(n), r.s);
  const double u = std::sqrt(squared(input.reference_sigma) + squared(r.s) + squared(bias) / 3);
  r.q_ms = 2 * (2 * u) / input.tolerance;
  return r;
}

GrrResult grr_anova(const GrrInput& input) {
  const Shape n = shape_of(input);
  const Squares ss = squares_of(input, n);
  const bool crossed = n.operators > 1;
  VarianceLine operators = line("operator", n.operators - 1, ss.operators);
  VarianceLine parts = line("part", n.parts - 1, ss.parts);
  VarianceLine both =
      line("operator x part", (n.operators - 1) * (n.parts - 1), crossed ? ss.interaction : 0);
  VarianceLine repeat = line("repeatability", n.parts * n.operators * (n.trials - 1), ss.repeat);
  test(both, repeat);
  const bool pooled = !crossed || both.p > kPoolFrom;
  const VarianceLine error =
      pooled ? line("repeatability", both.dof + repeat.dof, both.ss + repeat.ss) : both;
  test(operators, error);
  test(parts, error);
  GrrResult r;
  r.ev = std::sqrt(pooled ? error.ms : repeat.ms);
  if (!pooled) r.interaction = root_of_positive((both.ms - repeat.ms) / n.trials);
  if (crossed) r.av = root_of_positive((operators.ms - error.ms) / (n.parts * n.trials));
  r.pv = root_of_positive((parts.ms - error.ms) / (n.operators * n.trials));
  conclude(input, r);
  const double all = ss.operators + ss.parts + both.ss + ss.repeat;
  if (crossed) r.table.push_back(operators);
  r.table.push_back(parts);
  if (crossed) r.table.push_back(both);
  r.table.push_back(repeat);
  r.table.push_back(line("total", n.count() - 1, all));
  return r;
}

GrrResult grr_average_range(const GrrInput& input) {
  const Shape n = shape_of(input);
  double ranges = 0;
  Eigen::ArrayXd part_means(n.parts);
  for (int i = 0; i < n.parts; ++i) {
    const Eigen::ArrayXXd& part = input.values[static_cast<std::size_t>(i)];
    part_means[i] = part.mean();
    ranges += (part.rowwise().maxCoeff() - part.rowwise().minCoeff()).sum();
  }
  GrrResult r;
  r.ev = ranges / (n.parts * n.operators) / d2(n.trials);
  if (n.operators > 1) {
    const double between = range(operator_means(input, n)) / d2_star(n.operators, 1);
    r.av = root_of_positive(squared(between) - squared(r.ev) / (n.parts * n.trials));
  }
  r.pv = range(part_means) / d2_star(n.parts, 1);
  conclude(input, r);
  return r;
}

double d2(int n) {
  if (n < 2 || n > 200) throw InputError("d2", "n = " + std::to_string(n), "2 to 200");
  return range_moments(n).mean;
}

double d2_star(int n, int subgroups) {
  if (subgroups < 1) throw InputError("d2*", "no subgroup", "one or more");
  if (n < 2 || n > 200) throw InputError("d2*", "n = " + std::to_string(n), "2 to 200");
  const RangeMoments m = range_moments(n);
  return std::sqrt(squared(m.mean) + (m.second - squared(m.mean)) / subgroups);
}

double f_upper_tail(double f, double dof_above, double dof_below) {
  if (!(f > 0)) return 1;
  return incomplete_beta(dof_below / (dof_below + dof_above * f), dof_below / 2, dof_above / 2);
}

}  // namespace brdfgate
