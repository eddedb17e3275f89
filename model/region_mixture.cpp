#include "model/region_mixture.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace brdfgate {
namespace {

using Eigen::ArrayXd;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Outliers (stains, dust, mixed cells) are spread evenly over this range of ln f per channel...
constexpr double kOutlierRange = 4.0;
/// ...and make up this share at first and at least a tenth of it later.
constexpr double kOutlierShare = 0.02;
/// Samples per independent observation in the information criterion: neighbouring cells share the
/// discrepancy of their material.
constexpr double kSamplesPerObservation = 5.0;
/// Prior deviations of a surface's coefficients by degree 1, 2, 3, in ln f over half the image:
/// they bind a small cluster's surface where it has no cells and leave a large one's free.
constexpr double kSlopePrior[] = {0.5, 0.3, 0.2};
/// Segments are trusted when they cover this share of the samples...
constexpr double kLeastCovered = 0.4;
/// ...and no cluster of them scatters more about its surface (RMS of ln f beyond noise): an edge
/// with a gap, where two materials cross in brightness, lets one segment run over both.
constexpr double kMostScatter = 0.05;
constexpr double kLeastSampleShare = 0.01;  ///< of the samples, for a material of its own
constexpr int kTryRounds = 12;              ///< of expectation-maximisation per candidate split
constexpr int kSettleRounds = 30;           ///< for the best candidate

struct Mixture {
  std::vector<Trend> trends;
  double outlier_share = kOutlierShare;
  double log_likelihood = -std::numeric_limits<double>::infinity();
  MatrixXd responsibility;  ///< n x (trends + 1), outliers last
};

TrendTerms prior_precision() {
  TrendTerms p;
  p.setConstant(1e-6);
  p.segment(1, 2) = 1 / (kSlopePrior[0] * kSlopePrior[0]);
  p.segment(3, 3) = 1 / (kSlopePrior[1] * kSlopePrior[1]);
  p.segment(6, 4) = 1 / (kSlopePrior[2] * kSlopePrior[2]);
  return p;
}

/// Squared residuals of every sample from one surface, split into level and hue.
struct Residuals {
  ArrayXd level2;
  ArrayXd hue2;
};
Residuals squared_residuals(const TrendSamples& s, const MatrixXd& coefficients) {
  const MatrixXd d = s.y - s.terms * coefficients;
  Residuals r{d.rowwise().sum().array().square() / static_cast<double>(d.cols()), ArrayXd()};
  r.hue2 = (d.rowwise().squaredNorm().array() - r.level2).max(0.0);
  return r;
}

/// Weighted ridge fit of one surface and its scatter. `r` are the samples' responsibilities.
void fit_one(const TrendSamples& s, const ArrayXd& r, Trend& t) {
  constexpr double kLeast = kTrendDiscrepancy * kTrendDiscrepancy;
  const double before = std::max({t.level_variance, t.hue_variance, kLeast});
  const VectorXd w = r / (before + s.noise.array());
  const MatrixXd weighted = s.terms.transpose() * w.asDiagonal();
  MatrixXd normal = weighted * s.terms;
  normal.diagonal().array() += prior_precision();
  t.coefficients = normal.ldlt().solve(weighted * s.y);
  const double total = std::max(r.sum(), 1e-9);
  const double hues = static_cast<double>(s.y.cols()) - 1;
  const Residuals d = squared_residuals(s, t.coefficients);
  t.level_variance = std::max(kLeast, (r * (d.level2 - s.noise.array())).sum() / total);
  t.hue_variance = kLeast;
  if (hues > 0)
    t.hue_variance = std::max(kLeast, (r * (d.hue2 / hues - s.noise.array())).sum() / total);
  t.share = total / static_cast<double>(r.size());
}

/// ln of share times density, n x (trends + 1).
MatrixXd log_densities(const TrendSamples& s, const Mixture& m) {
  const auto k = static_cast<Index>(m.trends.size());
  const double channels = static_cast<double>(s.y.cols());
  MatrixXd d(s.y.rows(), k + 1);
  for (Index j = 0; j < k; ++j) {
    const Trend& t = m.trends[static_cast<std::size_t>(j)];
    const Residuals r = squared_residuals(s, t.coefficients);
    const ArrayXd level = t.level_variance + s.noise.array();
    const ArrayXd hue = t.hue_variance + s.noise.array();
    d.col(j) = std::log(t.share) -
               0.5 * (r.level2 / level + r.hue2 / hue + level.log() + (channels - 1) * hue.log() +
                      channels * std::log(2 * std::numbers::pi));
  }
  d.col(k).setConstant(std::log(m.outlier_share) - channels * std::log(kOutlierRange));
  return d;
}

void expectation(const TrendSamples& s, Mixture& m) {
  m.responsibility = log_densities(s, m);
  const VectorXd top = m.responsibility.rowwise().maxCoeff();
  m.responsibility = (m.responsibility.colwise() - top).array().exp();
  const VectorXd sum = m.responsibility.rowwise().sum();
  m.log_likelihood = (top.array() + sum.array().log()).sum();
  m.responsibility.array().colwise() /= sum.array();
}

void maximisation(const TrendSamples& s, Mixture& m) {
  const auto k = static_cast<Index>(m.trends.size());
  for (Index j = 0; j < k; ++j)
    fit_one(s, m.responsibility.col(j), m.trends[static_cast<std::size_t>(j)]);
  m.outlier_share = std::max(m.responsibility.col(k).mean(), kOutlierShare / 10);
}

void iterate(const TrendSamples& s, Mixture& m, int rounds) {
  for (int i = 0; i < rounds; ++i) {
    const double before = m.log_likelihood;
    maximisation(s, m);
    expectation(s, m);
    if (std::abs(m.log_likelihood - before) < 1e-3) return;
  }
}

Mixture one_trend(const TrendSamples& s) {
  Mixture m;
  m.trends.resize(1);
  m.responsibility = MatrixXd::Zero(s.y.rows(), 2);
  m.responsibility.col(0).setConstant(1 - kOutlierShare);
  m.responsibility.col(1).setConstant(kOutlierShare);
  iterate(s, m, kSettleRounds);
  return m;
}

/// Deviations of a cluster's samples from a surface of the first `terms` terms, fitted to them by
/// least squares.
MatrixXd residuals_of(const TrendSamples& s, const std::vector<Index>& members, Index terms) {
  const MatrixXd x = s.terms(members, Eigen::seqN(0, terms));
  const MatrixXd y = s.y(members, Eigen::all);
  MatrixXd normal = x.transpose() * x;
  normal.diagonal().array() += 1e-6;
  return y - x * normal.ldlt().solve(x.transpose() * y);
}

/// 2-means along the main direction of the residuals: true for the samples of the upper mean.
std::vector<bool> split_along_main_direction(const MatrixXd& residuals) {
  const MatrixXd covariance = residuals.transpose() * residuals;
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(covariance);
  const VectorXd p = residuals * eigen.eigenvectors().rightCols(1);
  double low = p.minCoeff();
  double high = p.maxCoeff();
  for (int i = 0; i < 20; ++i) {
    const ArrayXd upper = (p.array() > 0.5 * (low + high)).cast<double>();
    const double n = upper.sum();
    if (n < 1 || n > static_cast<double>(p.size()) - 1) break;
    high = (p.array() * upper).sum() / n;
    low = (p.array() * (1 - upper)).sum() / (static_cast<double>(p.size()) - n);
  }
  std::vector<bool> out(static_cast<std::size_t>(p.size()));
  for (Index i = 0; i < p.size(); ++i)
    out[static_cast<std::size_t>(i)] = p[i] > 0.5 * (low + high);
  return out;
}

std::vector<Index> members_of(const Mixture& m, Index column) {
  std::vector<Index> members;
  for (Index i = 0; i < m.responsibility.rows(); ++i) {
    Index top = 0;
    m.responsibility.row(i).maxCoeff(&top);
    if (top == column) members.push_back(i);
  }
  return members;
}

/// `m` with a new trend that begins with these samples.
Mixture with_new_trend(const TrendSamples& s, const Mixture& m, const std::vector<Index>& seeds) {
  Mixture next = m;
  const Index n = m.responsibility.rows();
  const Index k = m.responsibility.cols();
  next.responsibility.resize(n, k + 1);
  next.responsibility.leftCols(k - 1) = m.responsibility.leftCols(k - 1);
  next.responsibility.col(k - 1).setZero();
  next.responsibility.col(k) = m.responsibility.col(k - 1);
  for (const Index i : seeds) {
    next.responsibility.row(i).setZero();
    next.responsibility(i, k - 1) = 1;
  }
  next.trends.emplace_back();
  next.log_likelihood = -std::numeric_limits<double>::infinity();
  iterate(s, next, kTryRounds);
  return next;
}

/// Seeds of candidate splits: the outliers as a material of their own; each cluster cut in two by
/// its residuals from a constant, a plane and a cubic (a step hides in a cubic, a trend in a
/// constant).
std::vector<std::vector<Index>> split_seeds(const TrendSamples& s, const Mixture& m) {
  std::vector<std::vector<Index>> out;
  constexpr std::size_t kLeastHalf = 2 * std::size_t{kTrendTerms};
  const auto k = static_cast<Index>(m.trends.size());
  std::vector<Index> outliers = members_of(m, k);
  if (outliers.size() >= static_cast<std::size_t>(kTrendTerms)) {
    const std::vector<bool> upper = split_along_main_direction(residuals_of(s, outliers, 1));
    std::vector<Index> halves[2];
    for (std::size_t i = 0; i < outliers.size(); ++i)
      halves[upper[i] ? 1 : 0].push_back(outliers[i]);
    out.push_back(std::move(halves[0]));
    out.push_back(std::move(halves[1]));
    out.push_back(std::move(outliers));
  }
  for (Index j = 0; j < k; ++j) {
    const std::vector<Index> members = members_of(m, j);
    if (members.size() < 2 * kLeastHalf) continue;
    for (const Index terms : {1, 3, kTrendTerms}) {
      const std::vector<bool> upper = split_along_main_direction(residuals_of(s, members, terms));
      std::vector<Index> seeds;
      for (std::size_t i = 0; i < members.size(); ++i)
        if (upper[i]) seeds.push_back(members[i]);
      out.push_back(std::move(seeds));
    }
  }
  return out;
}

Mixture best_split(const TrendSamples& s, const Mixture& m) {
  Mixture best;
  for (const std::vector<Index>& seeds : split_seeds(s, m)) {
    if (seeds.size() < static_cast<std::size_t>(kTrendTerms)) continue;
    Mixture next = with_new_trend(s, m, seeds);
    if (next.log_likelihood > best.log_likelihood) best = std::move(next);
  }
  if (!best.trends.empty()) iterate(s, best, kSettleRounds);
  return best;
}

double information_criterion(const TrendSamples& s, const Mixture& m) {
  const double per_trend = static_cast<double>(kTrendTerms * s.y.cols() + 3);
  const double n = static_cast<double>(s.y.rows()) / kSamplesPerObservation;
  return -2 * m.log_likelihood / kSamplesPerObservation +
         per_trend * static_cast<double>(m.trends.size()) * std::log(n);
}

using Members = std::vector<Index>;

/// Rows of some samples.
TrendSamples some(const TrendSamples& s, const Members& members) {
  return {s.terms(members, Eigen::all), s.y(members, Eigen::all), s.noise(members), {}};
}

/// Step between two clusters on one common bend: the offset of the last `nb` samples in a joint fit
/// of a cubic and an offset, RMS over channels. Needs no surface where it has no cells, and no bend
/// can stand in for a step.
double step_between(const TrendSamples& both, Index nb) {
  MatrixXd terms(both.terms.rows(), kTrendTerms + 1);
  terms.leftCols(kTrendTerms) = both.terms;
  terms.rightCols(1).setZero();
  terms.rightCols(1).bottomRows(nb).setOnes();
  const VectorXd w = (kTrendDiscrepancy * kTrendDiscrepancy + both.noise.array()).inverse();
  const MatrixXd weighted = terms.transpose() * w.asDiagonal();
  MatrixXd normal = weighted * terms;
  normal.diagonal().head(kTrendTerms).array() += prior_precision();
  normal.diagonal().tail(1).array() += 1e-6;
  const MatrixXd solution = normal.ldlt().solve(weighted * both.y);
  return std::sqrt(solution.bottomRows(1).squaredNorm() / static_cast<double>(both.y.cols()));
}

/// Sum of squared residuals, mean over channels, of a surface fitted to all samples.
double loss_of(const TrendSamples& s) {
  Trend t;
  fit_one(s, ArrayXd::Ones(s.y.rows()), t);
  const Residuals r = squared_residuals(s, t.coefficients);
  return (r.level2 + r.hue2).sum() / static_cast<double>(s.y.cols());
}

/// Distance of two clusters in ln f: the step between them or, for clusters that bend differently,
/// what one common surface loses against one for each. (Two levels `d` apart in shares p and 1 - p
/// lose p (1 - p) d^2.)
double distance(const TrendSamples& s, const Members& a, const Members& b) {
  if (a.empty() || b.empty()) return 0;
  Members both = a;
  both.insert(both.end(), b.begin(), b.end());
  const TrendSamples together = some(s, both);
  const double loss = std::max(0.0, loss_of(together) - loss_of(some(s, a)) - loss_of(some(s, b)));
  const auto na = static_cast<double>(a.size());
  const auto nb = static_cast<double>(b.size());
  return std::max(step_between(together, static_cast<Index>(b.size())),
                  std::sqrt(loss * (na + nb) / (na * nb)));
}

/// The closest two clusters under kTrendDistance; {-1, -1} when there are none.
std::pair<int, int> closest_pair(const TrendSamples& s, const std::vector<Members>& clusters) {
  std::pair<int, int> closest{-1, -1};
  double least = kTrendDistance;
  for (std::size_t a = 0; a < clusters.size(); ++a) {
    for (std::size_t b = a + 1; b < clusters.size(); ++b) {
      const double d = distance(s, clusters[a], clusters[b]);
      if (d >= least) continue;
      least = d;
      closest = {static_cast<int>(a), static_cast<int>(b)};
    }
  }
  return closest;
}

/// Merges the closest pair of clusters until all are kTrendDistance apart.
void merge_close(const TrendSamples& s, Mixture& m) {
  for (;;) {
    const auto k = static_cast<Index>(m.trends.size());
    std::vector<Members> clusters;
    clusters.reserve(m.trends.size());
    for (Index j = 0; j < k; ++j)
      clusters.push_back(members_of(m, j));
    const auto [a, b] = closest_pair(s, clusters);
    if (a < 0) return;
    m.responsibility.col(a) += m.responsibility.col(b);
    const Index behind = k - b;
    m.responsibility.middleCols(b, behind) = m.responsibility.rightCols(behind).eval();
    m.responsibility.conservativeResize(Eigen::NoChange, k);
    m.trends.erase(m.trends.begin() + b);
    iterate(s, m, kSettleRounds);
  }
}

/// Mixtures of rising size; the best by the information criterion.
Mixture grow(const TrendSamples& s, int max_trends) {
  Mixture current = one_trend(s);
  Mixture best = current;
  double least = information_criterion(s, best);
  int failures = 0;
  // One size beyond the best is looked at: of three materials, two may be no better than one.
  while (static_cast<int>(current.trends.size()) < max_trends && failures < 2) {
    current = best_split(s, current);
    if (current.trends.empty()) break;
    const double criterion = information_criterion(s, current);
    if (criterion < least) {
      least = criterion;
      best = current;
      failures = 0;
    } else {
      ++failures;
    }
  }
  return best;
}

/// Samples by segment; [0] are those of none.
std::vector<Members> by_segment(const TrendSamples& s) {
  const int segments = s.segment.empty() ? 0 : *std::ranges::max_element(s.segment);
  std::vector<Members> out(static_cast<std::size_t>(segments) + 1);
  for (std::size_t i = 0; i < s.segment.size(); ++i)
    out[static_cast<std::size_t>(s.segment[i])].push_back(static_cast<Index>(i));
  return out;
}

/// Segments gathered into clusters, and the cluster of each segment.
struct Gathering {
  std::vector<Members> clusters;
  std::vector<int> of_segment;
};

void remove_cluster(Gathering& g, int gone, int into) {
  if (into >= 0) {
    Members& kept = g.clusters[static_cast<std::size_t>(into)];
    const Members& lost = g.clusters[static_cast<std::size_t>(gone)];
    kept.insert(kept.end(), lost.begin(), lost.end());
  }
  g.clusters.erase(g.clusters.begin() + gone);
  for (int& cluster : g.of_segment) {
    if (cluster == gone) {
      cluster = into;
    } else if (cluster > gone) {
      --cluster;
    }
  }
}

/// The largest segments first: each joins the nearest cluster under kTrendDistance or founds one.
/// Then clusters merge, and those of too few samples, or too many clusters, are given up.
Gathering gather(const TrendSamples& s, const std::vector<Members>& segments, int max_trends) {
  Gathering g;
  for (std::size_t i = 1; i < segments.size(); ++i) {
    int nearest = -1;
    double least = kTrendDistance;
    for (std::size_t c = 0; c < g.clusters.size(); ++c) {
      const double d = distance(s, g.clusters[c], segments[i]);
      if (d >= least) continue;
      least = d;
      nearest = static_cast<int>(c);
    }
    if (nearest < 0) {
      nearest = static_cast<int>(g.clusters.size());
      g.clusters.emplace_back();
    }
    Members& cluster = g.clusters[static_cast<std::size_t>(nearest)];
    cluster.insert(cluster.end(), segments[i].begin(), segments[i].end());
    g.of_segment.push_back(nearest);
  }
  for (auto pair = closest_pair(s, g.clusters); pair.first >= 0; pair = closest_pair(s, g.clusters))
    remove_cluster(g, pair.second, pair.first);
  const auto least = static_cast<std::size_t>(kLeastSampleShare * double(s.y.rows()));
  for (;;) {
    const auto smallest = std::ranges::min_element(
        g.clusters, [](const Members& a, const Members& b) { return a.size() < b.size(); });
    if (smallest == g.clusters.end()) break;
    if (smallest->size() >= least && static_cast<int>(g.clusters.size()) <= max_trends) break;
    remove_cluster(g, static_cast<int>(smallest - g.clusters.begin()), -1);
  }
  return g;
}

/// Materials from segments; no trends when they cover too little or scatter too much to be trusted.
TrendFit from_segments(const TrendSamples& s, int max_trends) {
  const std::vector<Members> segments = by_segment(s);
  const auto covered = static_cast<double>(s.y.rows()) - static_cast<double>(segments[0].size());
  if (covered < kLeastCovered * static_cast<double>(s.y.rows())) return {};
  const Gathering g = gather(s, segments, max_trends);
  TrendFit fit;
  for (const Members& members : g.clusters) {
    Trend t;
    fit_one(some(s, members), ArrayXd::Ones(static_cast<Index>(members.size())), t);
    if (std::max(t.level_variance, t.hue_variance) > kMostScatter * kMostScatter) return {};
    t.share = static_cast<double>(members.size()) / static_cast<double>(s.y.rows());
    fit.trends.push_back(t);
  }
  fit.of_segment = g.of_segment;
  return fit;
}

}  // namespace

TrendTerms trend_terms(double u, double v) {
  TrendTerms t;
  t << 1, u, v, u * u, u * v, v * v, u * u * u, u * u * v, u * v * v, v * v * v;
  return t;
}

TrendFit fit_trends(const TrendSamples& samples, int max_trends) {
  TrendFit fit = from_segments(samples, max_trends);
  if (!fit.trends.empty()) return fit;
  Mixture best = grow(samples, max_trends);
  merge_close(samples, best);
  return {best.trends, {}};
}

}  // namespace brdfgate
