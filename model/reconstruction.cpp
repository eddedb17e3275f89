#include "model/reconstruction.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "model/error.hpp"
#include "model/grid_stencil.hpp"
#include "model/mapping.hpp"

namespace brdfgate {
namespace {

/// Cells nearer to the horizon than this do not count in compare(), and what a missing one costs.
constexpr double kCompareCosine = 0.02;
constexpr double kMissingError = 5.0;
/// As for tables: the diffuse part is the minimum over theta_h below this.
constexpr double kDiffuseBelow = std::numbers::pi / 3;

/// Mapped values are held here: f stays finite for any weights. No measured one exceeds 20.
constexpr double kLargestMapped = 100.0;

constexpr HalfDiffGrid kMerl{MerlFormat::kThetaH, MerlFormat::kThetaD, MerlFormat::kPhiD};

/// Weights per colour: mono weights stand for all three.
Eigen::MatrixXd three_channels(const Weights& weights) {
  if (!weights.c.allFinite()) throw InputError("weights", "not a number", "finite values");
  if (weights.c.cols() == 1) return weights.c.replicate(1, 3);
  if (weights.c.cols() == 3) return weights.c;
  throw InputError("weights", std::to_string(weights.c.cols()) + " channels", "1 or 3");
}

double reflectance(double x, double median, double w) {
  return from_mapped(std::min(x, kLargestMapped), median, w);
}

class Reconstructed final : public Brdf {
 public:
  Reconstructed(std::shared_ptr<const Basis> basis, const Weights& weights)
      : basis_(std::move(basis)), x_(basis_->mapped_rows(three_channels(weights))) {
    find_diffuse();
  }

  Rgb diffuse(double theta_d) const override {
    const auto n = static_cast<double>(diffuse_.size());
    const double at = std::clamp(theta_d * (2 / std::numbers::pi) * n - 0.5, 0.0, n - 1);
    const auto d = std::min(static_cast<std::size_t>(at), diffuse_.size() - 2);
    const double share = at - static_cast<double>(d);
    return (1 - share) * diffuse_[d] + share * diffuse_[d + 1];
  }

  Rgb specular(const HalfDiff& angles) const override {
    return value(angles) - diffuse(angles.theta_d);
  }

  Rgb value(const HalfDiff& angles) const {
    const Basis::Location at = basis_->locate(angles);
    Eigen::Array3d x = Eigen::Array3d::Zero();
    for (std::size_t i = 0; i < 8; ++i) {
      if (at.weight[i] > 0) {
        x += at.weight[i] * x_.row(at.row[i]).transpose().array().cast<double>();
      }
    }
    return x.unaryExpr([&](double v) { return reflectance(v, at.median, at.cosine_weight); });
  }

 private:
  void find_diffuse() {
    const BasisGrid& grid = basis_->info().grid;
    diffuse_.assign(static_cast<std::size_t>(grid.theta_d),
                    Rgb::Constant(std::numeric_limits<double>::infinity()));
    for (int h = 0; h < grid.theta_h && grid.centre(h, 0, 0).theta_h < kDiffuseBelow; ++h) {
      for (int d = 0; d < grid.theta_d; ++d) {
        for (int p = 0; p < grid.phi_d; ++p) {
          if (!basis_->row_of(h, d, p)) continue;
          Rgb& least = diffuse_[static_cast<std::size_t>(d)];
          least = least.min(value_of_cell(h, d, p));
        }
      }
    }
  }

  Rgb value_of_cell(int h, int d, int p) const {
    const std::size_t row = *basis_->row_of(h, d, p);
    const double w = cosine_weight(cosines(basis_->info().grid.centre(h, d, p)));
    const double median = basis_->median_of_row(row);
    const Rgb x = x_.row(static_cast<Eigen::Index>(row)).transpose().array().cast<double>();
    return x.unaryExpr([&](double v) { return reflectance(v, median, w); });
  }

  std::shared_ptr<const Basis> basis_;
  Eigen::MatrixXf x_;
  std::vector<Rgb> diffuse_;  ///< per theta_d cell
};

struct ErrorSum {
  double squares = 0;
  std::size_t cells = 0;
  std::size_t missing = 0;

  void add(double a, double b, double w) {
    ++cells;
    if (a < 0 || b < 0) {
      ++missing;
      squares += kMissingError * kMissingError;
      return;
    }
    const double x = to_mapped(a, b, w);
    squares += x * x;
  }
  double rms() const { return cells > 0 ? std::sqrt(squares / static_cast<double>(cells)) : 0; }
};

double cell_of(const MerlBrdf& brdf, std::size_t channel, std::size_t cell) {
  return brdf.cell(static_cast<int>(channel), cell);
}
double cell_of(const MerlTable& table, std::size_t channel, std::size_t cell) {
  return table.f[channel][cell];
}

template <typename A>
BrdfDifference difference_of(const A& a, const MerlBrdf& b) {
  std::array<ErrorSum, 3> sums{};
  for (int h = 0; h < kMerl.theta_h; ++h) {
    for (int d = 0; d < kMerl.theta_d; ++d) {
      for (int p = 0; p < kMerl.phi_d; ++p) {
        const Cosines c = cosines(kMerl.centre(h, d, p));
        if (!c.above_horizon(kCompareCosine)) continue;
        const std::size_t cell = kMerl.cell(h, d, p);
        for (std::size_t channel = 0; channel < 3; ++channel) {
          sums[channel].add(cell_of(a, channel, cell), cell_of(b, channel, cell), cosine_weight(c));
        }
      }
    }
  }
  BrdfDifference difference;
  for (std::size_t channel = 0; channel < 3; ++channel) {
    difference.mapped_rms_per_channel[channel] = sums[channel].rms();
    difference.mapped_rms += sums[channel].rms() / 3;
    difference.missing_cells += sums[channel].missing;
  }
  return difference;
}

}  // namespace

BrdfPtr make_brdf(std::shared_ptr<const Basis> basis, const Weights& weights) {
  return std::make_shared<Reconstructed>(std::move(basis), weights);
}

MerlTable tabulate(const Basis& basis, const Weights& weights) {
  // Borrowed for the call: the reconstruction does not outlive it.
  const std::shared_ptr<const Basis> borrowed(std::shared_ptr<const Basis>(), &basis);
  const Reconstructed brdf(borrowed, weights);
  MerlTable table;
  for (int h = 0; h < kMerl.theta_h; ++h) {
    for (int d = 0; d < kMerl.theta_d; ++d) {
      for (int p = 0; p < kMerl.phi_d; ++p) {
        const HalfDiff at = kMerl.centre(h, d, p);
        if (!cosines(at).above_horizon()) continue;
        const Rgb f = brdf.value(at);
        for (std::size_t channel = 0; channel < 3; ++channel)
          table.f[channel][kMerl.cell(h, d, p)] = f[static_cast<Eigen::Index>(channel)];
      }
    }
  }
  return table;
}

BrdfDifference compare(const MerlBrdf& a, const MerlBrdf& b) {
  return difference_of(a, b);
}

BrdfDifference compare(const MerlTable& a, const MerlBrdf& b) {
  return difference_of(a, b);
}

}  // namespace brdfgate
