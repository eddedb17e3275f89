#include "model/expectation.hpp"

#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "model/error.hpp"
#include "model/log_image.hpp"

namespace brdfgate {
namespace {

double squared_angle(const HalfDiff& a, const HalfDiff& b) {
  const double h = a.theta_h - b.theta_h;
  const double d = a.theta_d - b.theta_d;
  const double p =
      std::remainder(a.phi_d - b.phi_d, std::numbers::pi) * std::sin(0.5 * (a.theta_h + b.theta_h));
  return h * h + d * d + p * p;
}

int nearest(const BinMap& bins, const std::vector<int>& known, int bin) {
  double least = std::numeric_limits<double>::infinity();
  int best = -1;
  for (const int other : known) {
    const double d = squared_angle(bins.mean_angles[static_cast<std::size_t>(bin)],
                                   bins.mean_angles[static_cast<std::size_t>(other)]);
    if (d >= least) continue;
    least = d;
    best = other;
  }
  return best;
}

}  // namespace

ExpectedLog expected_log(const TaughtAppearance& taught, const BinMap& bins, int light,
                         int channels) {
  if (taught.log_f.rows() != bins.bins() || taught.log_f.cols() != channels) {
    throw InputError("taught appearance",
                     std::to_string(taught.log_f.rows()) + " bins x " +
                         std::to_string(taught.log_f.cols()) + " channels",
                     std::to_string(bins.bins()) + " x " + std::to_string(channels));
  }
  ExpectedLog out = ((taught.log_f.exp() + kLogFloor).log()).cast<float>();
  std::vector<int> known;
  std::vector<int> missing;
  for (int b = 0; b < bins.bins(); ++b) {
    if (bins.light[static_cast<std::size_t>(b)] != light) {
      out.row(b).setConstant(std::numeric_limits<float>::quiet_NaN());
    } else {
      (out.row(b).isFinite().all() ? known : missing).push_back(b);
    }
  }
  for (const int b : missing) {
    const int from = nearest(bins, known, b);
    if (from < 0) {
      out.row(b).setConstant(std::numeric_limits<float>::quiet_NaN());
    } else {
      out.row(b) = out.row(from).eval();
    }
  }
  return out;
}

}  // namespace brdfgate
