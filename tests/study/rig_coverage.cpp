// Whether the stated uncertainty of weights and readings holds.
#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <array>
#include <optional>

#include "model/canonical.hpp"
#include "model/mapping.hpp"
#include "model/readings.hpp"
#include "study/rig.hpp"

namespace brdfgate::study {

using Eigen::Index;
using nlohmann::json;

namespace {

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

}  // namespace

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

}  // namespace brdfgate::study
