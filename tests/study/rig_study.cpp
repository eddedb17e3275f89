// The rig of the literature (validation.hpp) on materials a basis has not seen: error of the
// reconstruction, what a tilted part or a few bad bins do to it, and whether the stated uncertainty
// holds.
//
//   rig_study BASIS MODE FILE.binary...    MODE: error | tilt | inspected | coverage | outliers |
//                                          kernels
//
// One JSON object a material on stdout. tests/rig_accuracy builds the bases and makes the tables.
#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <numbers>
#include <numeric>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "model/canonical.hpp"
#include "model/estimators.hpp"
#include "model/example_regression.hpp"
#include "model/mapping.hpp"
#include "model/merl.hpp"
#include "model/pose_estimate.hpp"
#include "model/reading_rows.hpp"
#include "model/readings.hpp"
#include "model/regions.hpp"
#include "support/simple_regression.hpp"
#include "support/synthetic_part.hpp"

namespace {

using namespace brdfgate;
using Eigen::Index;
using nlohmann::json;

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kRowNoise = 0.01;  // relative, per row; a bin of the default station has less

Eigen::Vector3d in_plane(double deg) {
  return {std::sin(deg * kDegree), 0, std::cos(deg * kDegree)};
}

constexpr int kLattice = 15;
const double kRadius = std::tan(12.5 * kDegree);  // m, of what the camera sees from 1 m
const double kStep = 2 * kRadius / (kLattice - 1);

/// Sightlines of the literature's rig, light after light; the camera is 1 m away.
std::vector<Sightline> rig() {
  const Eigen::Vector3d eye = in_plane(55);
  std::vector<Sightline> lines;
  for (const double light : {-55.0, 20.0}) {
    Eigen::Vector4d at = Eigen::Vector4d::Zero();
    at.head<3>() = in_plane(light);
    for (int j = 0; j < kLattice; ++j) {
      for (int i = 0; i < kLattice; ++i) {
        const double x = kRadius * (2.0 * i / (kLattice - 1) - 1);
        const double y = kRadius * (2.0 * j / (kLattice - 1) - 1);
        if (x * x + y * y <= kRadius * kRadius * (1 + 1e-12)) lines.push_back({eye, {x, y, 0}, at});
      }
    }
  }
  return lines;
}

/// Truth on the cells of a 45 x 45 x 45 grid, and the basis' rows there.
class Evaluation {
 public:
  explicit Evaluation(const Basis& basis) {
    constexpr BasisGrid kGrid{45, 45, 45};
    for (int h = 0; h < kGrid.theta_h; ++h) {
      for (int d = 0; d < kGrid.theta_d; ++d) {
        for (int p = 0; p < kGrid.phi_d; ++p) {
          const HalfDiff at = kGrid.centre(h, d, p);
          if (cosines(at).above_horizon(0.02)) cells_.push_back(at);
        }
      }
    }
    rows_ = basis.rows(cells_);
    factor_.compute(rows_.q.transpose() * rows_.q);
  }
  Eigen::MatrixXd truth(const Brdf& brdf) const {
    Eigen::MatrixXd x(rows_.q.rows(), 3);
    for (Index j = 0; j < x.rows(); ++j) {
      const Rgb f = brdf.eval(cells_[static_cast<std::size_t>(j)]);
      for (Index c = 0; c < 3; ++c)
        x(j, c) = to_mapped(f[c], rows_.median[j], rows_.weight[j]) - rows_.mean[j];
    }
    return x;
  }
  double error(const Eigen::MatrixXd& truth, const Eigen::MatrixXd& c) const {
    return ((truth - rows_.q * c).colwise().squaredNorm() / double(truth.rows()))
        .cwiseSqrt()
        .mean();
  }
  Eigen::MatrixXd best(const Eigen::MatrixXd& truth) const {
    return factor_.solve(rows_.q.transpose() * truth);
  }

 private:
  std::vector<HalfDiff> cells_;
  BasisRows rows_;
  Eigen::LDLT<Eigen::MatrixXd> factor_;
};

/// Reflectance at the sightlines of a part that lies so; noise from the generator, if any.
Eigen::MatrixXd observe(const Brdf& brdf, const std::vector<Sightline>& lines, const PartPose& pose,
                        std::mt19937_64* noise) {
  Eigen::MatrixXd f(static_cast<Index>(lines.size()), 3);
  std::normal_distribution<double> normal;
  for (Index j = 0; j < f.rows(); ++j) {
    const Rgb value = brdf.eval(lines[static_cast<std::size_t>(j)].angles(pose));
    for (Index c = 0; c < 3; ++c)
      f(j, c) = std::max(0.0, value[c] * (noise ? 1 + kRowNoise * normal(*noise) : 1.0));
  }
  return f;
}

BinnedSamples to_samples(const std::vector<Sightline>& lines, const PartPose& pose,
                         const Eigen::MatrixXd& f, double relative_noise) {
  BinnedSamples samples;
  for (Index j = 0; j < f.rows(); ++j) {
    Bin bin;
    bin.id = static_cast<int>(j);
    bin.light = j < f.rows() / 2 ? 1 : 2;
    bin.angles = lines[static_cast<std::size_t>(j)].angles(pose);
    bin.pixels = 1;
    bin.f = f.row(j).transpose().array();
    bin.variance = (relative_noise * bin.f).square();
    samples.bins.push_back(bin);
  }
  return samples;
}

/// What a station that knows of no tilt makes of the same light.
Eigen::MatrixXd as_taught(const std::vector<Sightline>& lines, const PartPose& pose,
                          Eigen::MatrixXd f) {
  for (Index j = 0; j < f.rows(); ++j) {
    const Sightline& line = lines[static_cast<std::size_t>(j)];
    f.row(j) *= line.irradiance(pose) / line.irradiance({});
  }
  return f;
}

/// Kernels that were tried (docs/decisions): the product's, with one thing or two changed.
std::vector<std::pair<std::string, ExampleKernel>> kernels() {
  std::vector<std::pair<std::string, ExampleKernel>> out;
  const auto add = [&](const std::string& name, const auto& change) {
    for (const bool share : {false, true}) {
      ExampleKernel k;
      if (!share) k.ridge_share = 0;
      change(k);
      out.emplace_back(share ? name + ", a fifth of ridge" : name, k);
    }
  };
  add("the product's", [](ExampleKernel&) {});
  add("0011", [](ExampleKernel& k) {
    k.norm_exponents = {1, 0.7, 0.3};
    k.linear = 1;
  });
  add("0011, no damping", [](ExampleKernel& k) {
    k.norm_exponents = {1, 0.7, 0.3};
    k.linear = 1;
    k.value_error = 0;
  });
  add("linear 0.1, no damping (0010)", [](ExampleKernel& k) {
    k.linear = 0.1F;
    k.value_error = 0;
  });
  add("linear 0.1", [](ExampleKernel& k) { k.linear = 0.1F; });
  add("exponents 1, 0.95, 0.9", [](ExampleKernel& k) { k.norm_exponents = {1, 0.95, 0.9}; });
  add("length 3", [](ExampleKernel& k) { k.length = 3; });
  add("length 1.3", [](ExampleKernel& k) { k.length = 1.3; });
  add("half the noise", [](ExampleKernel& k) {
    k.measured_noise /= 2;
    k.derived_noise /= 2;
  });
  add("twice the noise", [](ExampleKernel& k) {
    k.measured_noise *= 2;
    k.derived_noise *= 2;
  });
  return out;
}

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

json error_of(const Study& s, const Brdf& brdf, const std::string&) {
  const Eigen::MatrixXd truth = s.evaluation.truth(brdf);
  const auto samples = to_samples(s.lines, {}, observe(brdf, s.lines, {}, nullptr), 0);
  return {{"gp", s.evaluation.error(truth, s.own->estimate(samples).c)},
          {"ridge", s.evaluation.error(truth, s.papers->estimate(samples).c)},
          {"least_squares", s.evaluation.error(truth, s.evaluation.best(truth))}};
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

/// RMS over the first 8 weights of all channels, prior deviations.
double moved(const Study& s, const Weights& a, const Weights& b) {
  const Eigen::MatrixXd d =
      (a.c - b.c).topRows(8) * std::sqrt(double(s.basis->info().observations));
  return std::sqrt(d.squaredNorm() / double(d.size()));
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

/// The same as an inspection samples: cells of the default station's image, averaged in its bins.
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

/// The error with other kernels than the product's, by the tests' simple form of it.
json kernels_of(const Study& s, const Brdf& brdf, const std::string&) {
  const Eigen::MatrixXd truth = s.evaluation.truth(brdf);
  const auto samples = to_samples(s.lines, {}, observe(brdf, s.lines, {}, nullptr), 0);
  const BasisRows rows = s.basis->rows(samples.directions());
  const Eigen::MatrixXd x = centred(samples, rows);
  if (s.kernels.empty()) {
    for (const auto& [name, kernel] : kernels())
      s.kernels.emplace_back(name, test::SimpleRegression(*s.basis, samples.directions(), kernel));
  }
  json out;
  for (const auto& [name, regression] : s.kernels) {
    Eigen::MatrixXd c(rows.q.cols(), x.cols());
    for (Index channel = 0; channel < x.cols(); ++channel)
      c.col(channel) = regression.mean(x.col(channel));
    out.push_back({name, s.evaluation.error(truth, c)});
  }
  return {{"kernels", out}};
}

/// What 3 % of the bins off by a factor of 3 do, in all channels: dust or a glint.
json outliers_of(const Study& s, const Brdf& brdf, const std::string& name) {
  constexpr double kShare = 0.03;
  constexpr double kFactor = 3;
  std::mt19937_64 dice(std::hash<std::string>{}(name));
  const Eigen::MatrixXd truth = s.evaluation.truth(brdf);
  const Eigen::MatrixXd f = observe(brdf, s.lines, {}, &dice);
  Eigen::MatrixXd bad = f;
  std::vector<Index> order(std::size_t(f.rows()));
  std::iota(order.begin(), order.end(), Index(0));
  std::shuffle(order.begin(), order.end(), dice);
  for (Index i = 0; i < std::lround(kShare * double(f.rows())); ++i)
    bad.row(order[std::size_t(i)]) *= i % 2 == 0 ? kFactor : 1 / kFactor;
  const BinnedSamples clean = to_samples(s.lines, {}, f, kRowNoise);
  const BinnedSamples dusty = to_samples(s.lines, {}, bad, kRowNoise);
  if (!s.plain) s.plain = std::make_shared<ExampleRegression>(*s.basis, clean.directions());
  const auto plain = [&](const BinnedSamples& samples) {
    Weights w;
    w.c = s.plain->mean(centred(samples, s.plain->rows()));
    return w;
  };
  json out;
  const auto add = [&](const char* method, const Weights& before, const Weights& after) {
    out[method] = {{"clean", s.evaluation.error(truth, before.c)},
                   {"dusty", s.evaluation.error(truth, after.c)},
                   {"moved", moved(s, before, after)}};
  };
  add("gp", s.own->estimate(clean), s.own->estimate(dusty));
  add("gp, nothing held", plain(clean), plain(dusty));
  add("ridge", s.papers->estimate(clean), s.papers->estimate(dusty));
  return out;
}

/// One channel of a BRDF, as grey.
class OneChannel final : public Brdf {
 public:
  OneChannel(const Brdf& brdf, Index channel) : brdf_(brdf), channel_(channel) {}
  Rgb diffuse(double theta_d) const override {
    return Rgb::Constant(brdf_.diffuse(theta_d)[channel_]);
  }
  Rgb specular(const HalfDiff& angles) const override {
    return Rgb::Constant(brdf_.specular(angles)[channel_]);
  }

 private:
  const Brdf& brdf_;
  Index channel_;
};

json reading_json(const Reading& r, double truth) {
  return {r.value, r.sigma, truth};
}

/// [told, its deviation, true] of every reading, the table's own BRDF telling the truth.
json readings_of(const Study& s, const Brdf& brdf, const Weights& w) {
  const ClusterReadings r = s.readings.read(w);
  const std::array<double, 3> gloss = gloss_gu(brdf);
  const AspecularReadings truth = aspecular_readings(brdf);
  json out;
  const std::array<const char*, 3> degrees{"20", "60", "85"};
  for (std::size_t i = 0; i < 3; ++i)
    out[std::string("gloss ") + degrees[i]] = reading_json(r.gloss[i], gloss[i]);
  if (std::isfinite(r.haze.value)) out["haze"] = reading_json(r.haze, gloss[1] - gloss[0]);
  for (std::size_t i = 0; i < kAspecularDeg.size(); ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      out[fmt::format("{} at {:.0f}", std::array{"L*", "a*", "b*"}[j], kAspecularDeg[i])] =
          reading_json(r.aspecular[i].lab[j], truth.lab[i][Index(j)]);
    }
  }
  if (std::isfinite(truth.flop_index) && std::isfinite(r.flop.sigma))
    out["flop"] = reading_json(r.flop, truth.flop_index);
  return out;
}

/// Per reading the deviation of weights drawn from their posterior (of its logarithm for gloss)
/// over the one told to first order; neither holds the basis' own error.
json first_order_of(const Study& s, const Weights& w) {
  constexpr int kDraws = 200;
  const ReadingRows rows(s.basis, std::nullopt, 0);
  const ClusterReadings told = rows.read(w);
  const std::array<const char*, 6> names{"gloss 20", "gloss 60", "gloss 85",
                                         "L* at 15", "L* at 45", "a* at 45"};
  const auto some = [](const ClusterReadings& r) {
    return std::array<Reading, 6>{r.gloss[0],         r.gloss[1],
                                  r.gloss[2],         r.aspecular[0].lab[0],
                                  r.at_45_0().lab[0], r.at_45_0().lab[1]};
  };
  std::vector<Eigen::MatrixXd> factor;
  for (const Eigen::MatrixXd& c : w.covariance)
    factor.emplace_back(c.llt().matrixL());
  const Eigen::MatrixXd mix = w.channel_correlation.llt().matrixL();
  std::mt19937_64 dice(1);
  std::normal_distribution<double> normal;
  Eigen::ArrayXXd drawn(kDraws, 6);
  for (Index i = 0; i < kDraws; ++i) {
    const Eigen::MatrixXd z =
        Eigen::MatrixXd::NullaryExpr(w.c.rows(), 3, [&] { return normal(dice); }) * mix.transpose();
    Weights one;
    one.c = w.c;
    for (Index c = 0; c < 3; ++c)
      one.c.col(c) += factor[std::size_t(c)] * z.col(c);
    const auto values = some(rows.read(one));
    for (std::size_t j = 0; j < 6; ++j)
      drawn(i, Index(j)) = j < 3 ? std::log(values[j].value) : values[j].value;
  }
  json out;
  for (std::size_t j = 0; j < 6; ++j) {
    const Reading r = some(told)[j];
    const Eigen::ArrayXd x = drawn.col(Index(j)) - drawn.col(Index(j)).mean();
    const double sigma = j < 3 ? r.sigma / r.value : r.sigma;
    out[names[j]] = {std::sqrt(x.square().mean()) / sigma, sigma};
  }
  return out;
}

/// Per pair of channels: how far apart they look (channel_correlation()'s distance), and both
/// channels' errors of gloss 60 and of lightness at 45:0, in their deviations.
json channel_errors(const Study& s, const Brdf& brdf, const BinnedSamples& samples,
                    const Weights& w) {
  const Eigen::MatrixXd x = centred(samples, s.basis->rows(samples.directions()));
  std::array<std::array<double, 2>, 3> z{};
  for (Index c = 0; c < 3; ++c) {
    Weights one;
    one.c = w.c.col(c);
    one.covariance = {w.covariance[std::size_t(c)]};
    const ClusterReadings r = s.readings.read(one);
    const OneChannel truth(brdf, c);
    const Reading& l = r.at_45_0().lab[0];
    z[std::size_t(c)] = {std::log(r.gloss[1].value / gloss_gu(truth, GlossGeometry::deg60)) *
                             r.gloss[1].value / r.gloss[1].sigma,
                         (l.value - lab_45_0(truth)[0]) / l.sigma};
  }
  json out = json::array();
  for (std::size_t a = 0; a < 3; ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      out.push_back(
          {std::sqrt((x.col(Index(a)) - x.col(Index(b))).squaredNorm() / double(x.rows())), z[a][0],
           z[b][0], z[a][1], z[b][1]});
    }
  }
  return out;
}

/// Of the leading weights: whether the 90 % interval holds the truth, and log scores.
json coverage_of(const Study& s, const Brdf& brdf, const std::string& name) {
  constexpr Index kLeading = 8;
  constexpr double k90 = 1.6448536269514722;
  std::mt19937_64 dice(std::hash<std::string>{}(name));
  const Eigen::MatrixXd truth = s.evaluation.best(s.evaluation.truth(brdf)).topRows(kLeading);
  const Eigen::MatrixXd f = observe(brdf, s.lines, {}, &dice);
  const auto samples = to_samples(s.lines, {}, f, kRowNoise);
  const double m = s.basis->info().observations;
  const auto score = [&](double miss, double variance) {
    return -0.5 * (miss * miss / variance + std::log(2 * std::numbers::pi * variance * m));
  };
  json out{{"gloss", f.topRows(f.rows() / 2).maxCoeff() /
                         std::max(1e-4, f.bottomRows(f.rows() / 2).mean())}};
  const Weights own = s.own->estimate(samples);
  const Weights papers = s.papers->estimate(samples);
  json held = json::array();
  json ratio = json::array();
  double scores[3] = {0, 0, 0};
  for (Index c = 0; c < 3; ++c) {
    for (Index i = 0; i < kLeading; ++i) {
      const double variance = own.covariance[std::size_t(c)](i, i);
      const double miss = own.c(i, c) - truth(i, c);
      held.push_back(std::abs(miss) < k90 * std::sqrt(variance) ? 1 : 0);
      ratio.push_back(std::sqrt(variance * m));
      scores[0] += score(miss, variance) / (3 * kLeading);
      scores[1] += score(papers.c(i, c) - truth(i, c), papers.covariance[std::size_t(c)](i, i)) /
                   (3 * kLeading);
      scores[2] += score(truth(i, c), 1 / m) / (3 * kLeading);
    }
  }
  out.update({{"readings", readings_of(s, brdf, own)},
              {"first_order", first_order_of(s, own)},
              {"channels", channel_errors(s, brdf, samples, own)},
              {"held", held},
              {"sigma", ratio},
              {"score", scores[0]},
              {"score_ridge", scores[1]},
              {"score_prior", scores[2]}});
  return out;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) {
    fmt::print(
        stderr,
        "usage: rig_study BASIS error|tilt|inspected|coverage|outliers|kernels FILE.binary...\n");
    return 2;
  }
  const auto basis = Basis::open(argv[1]);
  const Study study{basis,
                    Evaluation(*basis),
                    make_estimator({"gp"}, basis),
                    make_estimator({"gp"}, basis),
                    make_estimator({"ridge"}, basis),
                    ReadingRows(basis),
                    rig(),
                    nullptr,
                    {}};
  const std::string mode = argv[2];
  const auto measure = mode == "tilt"        ? tilt_of
                       : mode == "inspected" ? inspected_of
                       : mode == "kernels"   ? kernels_of
                       : mode == "coverage"  ? coverage_of
                       : mode == "outliers"  ? outliers_of
                                             : error_of;
  for (int i = 3; i < argc; ++i) {
    const std::string name = std::filesystem::path(argv[i]).stem();
    json line{{"name", name}};
    line.update(measure(study, *MerlBrdf::open(argv[i]), name));
    fmt::print("{}\n", line.dump());
    std::fflush(stdout);
  }
}
