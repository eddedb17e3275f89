// Teaching a recipe from good parts.
#pragma once

#include <string>
#include <vector>

#include "app/inspector.hpp"

namespace brdfgate {

/// Collects good parts one by one, so that no more than one part's frames are in memory.
/// The first part fixes the clusters (found from its own reflectance); every later part is assigned
/// to them.
class Teacher {
 public:
  explicit Teacher(const Inspector& inspector) : inspector_(inspector) {}

  /// Throws InputError naming `name` when the part cannot teach: absent, clipped or ambient beyond
  /// the limits, no cluster with enough bins, or not of the first part's kind (more than a tenth of
  /// it unknown, or a cluster missing).
  void add(const std::string& name, const Capture& capture);

  int parts() const { return parts_; }

  /// Of the first part, as the recipe will have them: names and area shares are known, the rest is
  /// not yet. Empty before it.
  std::vector<TaughtCluster> clusters() const;

  /// @pre at least one part; throws InputError otherwise.
  Recipe recipe(const std::string& name, int id) const;

 private:
  void begin(const std::string& name, const Inspection& first);
  void keep(const std::string& name, const Inspection& part);

  const Inspector& inspector_;
  int parts_ = 0;
  std::vector<std::string> names_;                 ///< of the parts
  std::vector<std::string> remarks_;               ///< on clusters, for the recipe's warnings
  std::optional<RecipeInForce> draft_;             ///< clusters of the first part, without limits
  std::vector<std::vector<TeachSample>> samples_;  ///< per cluster, per part
  /// Sums of the parts' poses against the first one's.
  Eigen::Vector2d shift_mm_ = Eigen::Vector2d::Zero();
  double rotation_deg_ = 0;
  std::vector<DefectEvidence> defects_;       ///< per part: local residuals
  std::vector<Eigen::MatrixXd> weight_sums_;  ///< per cluster: published weights, summed
};

}  // namespace brdfgate
