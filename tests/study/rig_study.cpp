// The rig of the literature (validation.hpp) on materials a basis has not seen: error of the
// reconstruction, what a tilted part or a few bad bins do to it, and whether the stated uncertainty
// holds.
//
//   rig_study BASIS MODE FILE.binary...    MODE: error | tilt | inspected | coverage | outliers |
//                                          kernels
//
// One JSON object a material on stdout. tests/rig_accuracy builds the bases and makes the tables.
#include <fmt/core.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <numeric>

#include "model/mapping.hpp"
#include "study/rig.hpp"

namespace {

using namespace brdfgate;
using namespace brdfgate::study;
using Eigen::Index;
using nlohmann::json;

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

json error_of(const Study& s, const Brdf& brdf, const std::string&) {
  const Eigen::MatrixXd truth = s.evaluation.truth(brdf);
  const auto samples = to_samples(s.lines, {}, observe(brdf, s.lines, {}, nullptr), 0);
  return {{"gp", s.evaluation.error(truth, s.own->estimate(samples).c)},
          {"ridge", s.evaluation.error(truth, s.papers->estimate(samples).c)},
          {"least_squares", s.evaluation.error(truth, s.evaluation.best(truth))}};
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

}  // namespace

int main(int argc, char** argv) {
  static const std::map<std::string, json (*)(const Study&, const Brdf&, const std::string&)>
      kModes{{"error", error_of},       {"tilt", tilt_of},         {"inspected", inspected_of},
             {"coverage", coverage_of}, {"outliers", outliers_of}, {"kernels", kernels_of}};
  const auto mode = argc < 4 ? kModes.end() : kModes.find(argv[2]);
  if (mode == kModes.end()) {
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
  for (int i = 3; i < argc; ++i) {
    const std::string name = std::filesystem::path(argv[i]).stem();
    json line{{"name", name}};
    line.update(mode->second(study, *MerlBrdf::open(argv[i]), name));
    fmt::print("{}\n", line.dump());
    std::fflush(stdout);
  }
}
