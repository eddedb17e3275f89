#include "model/teaching_checks.hpp"

#include <algorithm>
#include <cmath>

#include "model/limits.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

/// Monitored changes of all parts but one, rows.
Eigen::MatrixXd others_of(const std::vector<ClusterObservation>& parts, std::size_t left_out) {
  Eigen::MatrixXd rows(std::ssize(parts) - 1, parts.front().monitored.size());
  Index row = 0;
  for (std::size_t i = 0; i < parts.size(); ++i)
    if (i != left_out) rows.row(row++) = parts[i].monitored.transpose();
  return rows;
}

}  // namespace

std::vector<OutlyingPart> outlying_parts(const std::vector<ClusterObservation>& parts,
                                         const TaughtCluster& taught,
                                         const JudgeSettings& settings) {
  std::vector<OutlyingPart> out;
  if (std::ssize(parts) < kLeastPartsToCompare) return out;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const Eigen::MatrixXd others = others_of(parts, i);
    TaughtCluster rest = taught;
    rest.parts = static_cast<int>(parts.size()) - 1;
    rest.monitored_mean = others.colwise().mean().transpose();
    rest.monitored_covariance = shrunk_covariance(others, parts.front().levels);
    rest.monitored_covariance.diagonal().array() += settings.change_floor * settings.change_floor;
    const double t2 = deviation(rest, parts[i]).t2;
    if (t2 > taught.t2_limit)
      out.push_back({static_cast<int>(i), t2, largest_shift(rest, parts[i])});
  }
  return out;
}

std::vector<Reach> reach_of(const TaughtCluster& taught, const JudgeSettings& settings,
                            int clusters, int more) {
  const double rate = split_rate(settings.false_reject_rate, clusters).per_statistic;
  const double limit = t2_limit(taught.monitored_covariance, more, settings.change_floor, rate,
                                level_count(taught.directions));
  std::vector<Reach> out;
  for (Index i = 0; i < taught.monitored_mean.size(); ++i) {
    const auto name = static_cast<std::size_t>(i);
    const double variance = taught.monitored_covariance(i, i);
    out.push_back({name < taught.directions.names.size() ? taught.directions.names[name] : "",
                   std::sqrt(taught.t2_limit * variance * (1 + 1.0 / std::max(1, taught.parts))),
                   std::sqrt(limit * variance * (1 + 1.0 / more))});
  }
  return out;
}

}  // namespace brdfgate
