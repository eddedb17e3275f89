// Tilted parts on the rig of the literature, and as an inspection samples them.
#include <algorithm>
#include <functional>
#include <optional>

#include "model/canonical.hpp"
#include "model/pose_estimate.hpp"
#include "model/regions.hpp"
#include "study/rig.hpp"
#include "support/synthetic_part.hpp"

namespace brdfgate::study {

using Eigen::Index;
using nlohmann::json;

namespace {

/// What a station that knows of no tilt makes of the same light.
Eigen::MatrixXd as_taught(const std::vector<Sightline>& lines, const PartPose& pose,
                          Eigen::MatrixXd f) {
  for (Index j = 0; j < f.rows(); ++j) {
    const Sightline& line = lines[static_cast<std::size_t>(j)];
    f.row(j) *= line.irradiance(pose) / line.irradiance({});
  }
  return f;
}

/// Whether a highlight says anything: the brightest value of the mirror light, which comes first,
/// is over twice the other's median, and inside the view.
/// @param reach  of the view from the centre of the plane, m: a peak beyond it may be the flank of
///               one that is not seen
bool highlight(const PoseSamples& seen, double reach) {
  const Eigen::VectorXd grey = seen.f.rowwise().mean();
  Index mirror = 0;
  while (mirror < grey.size() &&
         seen.lines[static_cast<std::size_t>(mirror)].light_W == seen.lines[0].light_W)
    ++mirror;
  Eigen::VectorXd off = grey.tail(grey.size() - mirror);
  std::nth_element(off.begin(), off.begin() + off.size() / 2, off.end());
  Index brightest = 0;
  const double peak = grey.head(mirror).maxCoeff(&brightest);
  return peak > 2 * off[off.size() / 2] &&
         seen.lines[static_cast<std::size_t>(brightest)].point_W.norm() < reach;
}

/// Squared distance of directions in units of MERL's axes, phi_d counting as far as it is defined.
double squared_distance(const HalfDiff& a, const HalfDiff& b) {
  const double h = std::sqrt(a.theta_h) - std::sqrt(b.theta_h);
  const double d = a.theta_d - b.theta_d;
  const double around = std::remainder(a.phi_d - b.phi_d, std::numbers::pi);
  const double spread = std::sin(a.theta_d) * std::sin(b.theta_d) *
                        std::min(1.0, 4 * std::sqrt(a.theta_h * b.theta_h));
  return h * h * 2 / std::numbers::pi + d * d + around * around * spread;
}

/// As the inspection does it: samples of a tilted part are told by their angles, not by their place
/// in the image, which bin of the flat part they belong to.
BinnedSamples assign(const BinFrame& frame, const BinnedSamples& tilted) {
  BinnedSamples assigned;
  for (std::size_t i = 0; i < frame.id.size(); ++i) {
    const auto nearest =
        std::min_element(tilted.bins.begin(), tilted.bins.end(), [&](const Bin& a, const Bin& b) {
          if (a.light != b.light) return a.light == frame.light[i];
          return squared_distance(a.angles, frame.directions[i]) <
                 squared_distance(b.angles, frame.directions[i]);
        });
    assigned.bins.push_back(*nearest);
    assigned.bins.back().id = frame.id[i];
  }
  return assigned;
}

/// What is seen of a part in some pose.
struct TiltedPart {
  PartPose pose;
  PoseEstimate found;
  bool highlight = false;
  std::function<BinnedSamples(const PartPose&)> samples;       ///< taking it to lie so
  std::function<BinnedSamples(const BinnedSamples&)> on_bins;  ///< by the flat part's ids
};

/// The flat part, which a tilted one is compared with.
struct FlatPart {
  BinFrame frame;
  Weights weights;
};

json trial(const Study& s, const TiltedPart& part, const FlatPart& flat,
           const Eigen::MatrixXd& truth) {
  const auto estimate = [&](const PartPose& pose) {
    const BinnedSamples assigned = part.on_bins(part.samples(pose));
    return s.own->estimate(onto_frame(*s.basis, assigned, ridge(*s.basis, assigned), flat.frame));
  };
  const Weights w = estimate(part.found.pose);
  const Weights anew = s.anywhere->estimate(part.samples(part.found.pose));
  const PartPose& found = part.found.pose;
  const Eigen::Matrix3d& covariance = part.found.covariance;
  return {
      {"tilt_deg", {part.pose.tilt_x / kDegree, part.pose.tilt_y / kDegree}},
      {"found_deg", {found.tilt_x / kDegree, found.tilt_y / kDegree}},
      {"sigma_deg", {std::sqrt(covariance(0, 0)) / kDegree, std::sqrt(covariance(1, 1)) / kDegree}},
      {"highlight", part.highlight},
      {"error", s.evaluation.error(truth, w.c)},
      {"ignored", s.evaluation.error(truth, s.papers->estimate(part.samples({})).c)},
      {"anew", s.evaluation.error(truth, anew.c)},
      {"moved_anew", moved(s, anew, flat.weights)},
      {"moved_told", moved(s, estimate(part.pose), flat.weights)},
      {"weights_moved", moved(s, w, flat.weights)}};
}

/// The flat part under the same rig half a step of its lattice aside: what other places of the
/// samples change when nothing is tilted and nothing has to be moved.
json aside_of(const Study& s, const Brdf& brdf, const Weights& flat, const Eigen::MatrixXd& truth,
              std::mt19937_64& dice) {
  json out = json::array();
  for (const Eigen::Vector3d& half :
       {Eigen::Vector3d(kStep / 2, 0, 0), Eigen::Vector3d(0, kStep / 2, 0),
        Eigen::Vector3d(kStep / 2, kStep / 2, 0)}) {
    std::vector<Sightline> lines = s.lines;
    for (Sightline& line : lines)
      line.point_W += half;
    const Weights w =
        s.anywhere->estimate(to_samples(lines, {}, observe(brdf, lines, {}, &dice), kRowNoise));
    out.push_back({{"error", s.evaluation.error(truth, w.c)}, {"moved", moved(s, w, flat)}});
  }
  return out;
}

constexpr int kTrials = 3;

PartPose random_pose(std::mt19937_64& dice) {
  std::uniform_real_distribution<double> uniform(-1 * kDegree, 1 * kDegree);
  const double x = uniform(dice);
  return {x, uniform(dice), 0};
}

}  // namespace

json tilt_of(const Study& s, const Brdf& brdf, const std::string& name) {
  std::mt19937_64 dice(std::hash<std::string>{}(name));
  const Eigen::MatrixXd truth = s.evaluation.truth(brdf);
  const auto samples = to_samples(s.lines, {}, observe(brdf, s.lines, {}, &dice), kRowNoise);
  const FlatPart flat{frame_of(samples), s.own->estimate(samples)};
  json trials = json::array();
  for (int i = 0; i < kTrials; ++i) {
    TiltedPart part;
    part.pose = random_pose(dice);
    const Eigen::MatrixXd f = observe(brdf, s.lines, part.pose, &dice);
    const PoseSamples seen{s.lines, as_taught(s.lines, part.pose, f)};
    part.found = estimate_pose(*s.basis, seen, {0.6 * kDegree, 0});
    part.highlight = highlight({s.lines, f}, kRadius - kStep / 2);
    part.samples = [&](const PartPose& pose) { return to_samples(s.lines, pose, f, kRowNoise); };
    part.on_bins = [&](const BinnedSamples& tilted) { return assign(flat.frame, tilted); };
    trials.push_back(trial(s, part, flat, truth));
  }
  return {{"flat", s.evaluation.error(truth, flat.weights.c)},
          {"trials", trials},
          {"aside", aside_of(s, brdf, flat.weights, truth, dice)}};
}

json inspected_of(const Study& s, const Brdf& brdf, const std::string& name) {
  static const test::SyntheticStation station(182, 136);
  constexpr double kReach = 0.036;  // m, of a part of 80 mm
  std::mt19937_64 dice(std::hash<std::string>{}(name));
  const Eigen::MatrixXd truth = s.evaluation.truth(brdf);
  const Regions regions{test::true_labels(station, test::plain_part), 1, 1};
  const cv::Mat body = regions.label == 0;
  test::SyntheticPart scene;
  scene.materials = {BrdfPtr(BrdfPtr(), &brdf)};
  const auto look = [&](const PartPose& pose) {
    scene.pose = pose;
    scene.seed = static_cast<unsigned>(dice());
    return test::render(station, scene);
  };
  const BinnedSamples samples = bin_all(look({}), station.map, regions).front();
  const FlatPart flat{frame_of(samples), s.own->estimate(samples)};
  json trials = json::array();
  for (int i = 0; i < kTrials; ++i) {
    TiltedPart part;
    part.pose = random_pose(dice);
    const std::vector<Reflectance> r = look(part.pose);
    const PoseSamples seen = pose_samples(r, station.geometry, station.map.cells, body);
    part.found = estimate_pose(*s.basis, seen, {0.6 * kDegree, 0});
    part.highlight = highlight(seen, kReach);
    part.samples = [&](const PartPose& pose) {
      return bin_all(r, station.map, regions, {station.geometry, pose}).front();
    };
    part.on_bins = [](const BinnedSamples& tilted) { return tilted; };
    trials.push_back(trial(s, part, flat, truth));
  }
  return {{"flat", s.evaluation.error(truth, flat.weights.c)}, {"trials", trials}};
}

}  // namespace brdfgate::study
