#include "study/rig.hpp"

#include <algorithm>

#include "model/mapping.hpp"

namespace brdfgate::study {

using Eigen::Index;

namespace {

Eigen::Vector3d in_plane(double deg) {
  return {std::sin(deg * kDegree), 0, std::cos(deg * kDegree)};
}

}  // namespace

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

Evaluation::Evaluation(const Basis& basis) {
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

Eigen::MatrixXd Evaluation::truth(const Brdf& brdf) const {
  Eigen::MatrixXd x(rows_.q.rows(), 3);
  for (Index j = 0; j < x.rows(); ++j) {
    const Rgb f = brdf.eval(cells_[static_cast<std::size_t>(j)]);
    for (Index c = 0; c < 3; ++c)
      x(j, c) = to_mapped(f[c], rows_.median[j], rows_.weight[j]) - rows_.mean[j];
  }
  return x;
}

double Evaluation::error(const Eigen::MatrixXd& truth, const Eigen::MatrixXd& c) const {
  return ((truth - rows_.q * c).colwise().squaredNorm() / double(truth.rows())).cwiseSqrt().mean();
}

Eigen::MatrixXd Evaluation::best(const Eigen::MatrixXd& truth) const {
  return factor_.solve(rows_.q.transpose() * truth);
}

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

double moved(const Study& s, const Weights& a, const Weights& b) {
  const Eigen::MatrixXd d =
      (a.c - b.c).topRows(8) * std::sqrt(double(s.basis->info().observations));
  return std::sqrt(d.squaredNorm() / double(d.size()));
}

}  // namespace brdfgate::study
