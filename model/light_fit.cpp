#include "model/light_fit.hpp"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr int kBlocksAcross = 48;
constexpr std::size_t kLeastBlocks = 60;
/// A block that is darker than the fit by this much is no noise; a few are dust.
constexpr double kShadow = 0.05;
constexpr double kMostShadowed = 0.005;
constexpr double kWorstRms = 0.01;
constexpr double kMostShift = 0.15;
constexpr double kHuber = 3;  // sigmas

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

std::string light_name(std::size_t light) {
  return "light " + std::to_string(light + 1);
}

struct Block {
  std::size_t light = 0;
  Eigen::Vector3d p_W;
  double r2 = 0;      ///< squared distance from the principal point over the corner's
  double level = 0;   ///< ln of the mean
  double sigma = 0;   ///< of level
  cv::Point at;       ///< block column and row
  bool flat = false;  ///< of the plate at height 0
};

double corner_radius2(const SensorFormat& sensor, const PinholeCamera& camera) {
  const Eigen::Vector2d last(sensor.width - 1, sensor.height - 1);
  const Eigen::Vector2d& c = camera.centre_px;
  return c.cwiseAbs().cwiseMax((last - c).cwiseAbs()).squaredNorm();
}

/// Mean and its variance over a block's good cells, channels summed; nothing where under half are
/// good.
std::optional<std::array<double, 2>> block_mean(const Radiance& white, const cv::Rect& cells) {
  const int channels = white.value.channels();
  double sum = 0, variance = 0;
  int n = 0;
  for (int v = cells.y; v < cells.br().y; ++v) {
    const auto* x = white.value.ptr<float>(v);
    const auto* s = white.variance.ptr<float>(v);
    const auto* bad = white.mask.ptr<unsigned char>(v);
    for (int u = cells.x; u < cells.br().x; ++u) {
      if (bad[u] != 0) continue;
      for (int c = u * channels; c < (u + 1) * channels; ++c) {
        sum += x[c];
        variance += s[c];
      }
      ++n;
    }
  }
  if (2 * n < cells.area() || !(sum > 0)) return std::nullopt;
  return std::array{sum / n, variance / n / n};
}

cv::Size block_grid(const cv::Size& cells) {
  const int side = std::max(1, cells.width / kBlocksAcross);
  return {cells.width / side, cells.height / side};
}

void add_blocks(const LightFitInput& input, const WhiteView& view, std::size_t light,
                std::vector<Block>& blocks) {
  const PinholeCamera& camera = input.geometry.camera;
  const cv::Size cells = input.sensor.cells();
  const int side = std::max(1, cells.width / kBlocksAcross);
  const cv::Size grid = block_grid(cells);
  const double corner2 = corner_radius2(input.sensor, camera);
  const Eigen::Vector2d half_cell = Eigen::Vector2d::Constant((side - 1) / 2.0);
  const Eigen::Vector2d first = cell_centre_px(input.sensor, 0, 0);
  const double step = cell_centre_px(input.sensor, 1, 0).x() - first.x();
  for (int j = 0; j < grid.height; ++j) {
    for (int i = 0; i < grid.width; ++i) {
      const Eigen::Vector2d px = first + step * (side * Eigen::Vector2d(i, j) + half_cell);
      const Eigen::Vector3d ray = camera.ray_W(px);
      if (!(ray.z() < 0)) continue;
      const Eigen::Vector3d eye = camera.position();
      const Eigen::Vector3d p_W = eye + (view.height_m - eye.z()) / ray.z() * ray;
      if (std::abs(p_W.x()) > input.plate_m.width / 2 ||
          std::abs(p_W.y()) > input.plate_m.height / 2) {
        continue;
      }
      const auto mean = block_mean(view.lights[light], {side * i, side * j, side, side});
      if (!mean) continue;
      const double relative2 = (*mean)[1] / ((*mean)[0] * (*mean)[0]);
      const double plate = input.priors.plate;
      blocks.push_back({.light = light,
                        .p_W = p_W,
                        .r2 = (px - camera.centre_px).squaredNorm() / corner2,
                        .level = std::log((*mean)[0]),
                        .sigma = std::sqrt(relative2 + plate * plate),
                        .at = {i, j},
                        .flat = view.height_m == 0});
    }
  }
}

/// ln X of one block; false below a horizon.
template <typename T>
bool level_of(const Block& block, const T* position, const T* aim, const T* shared, T* out) {
  using Vector = Eigen::Matrix<T, 3, 1>;
  const Vector L = Eigen::Map<const Vector>(position);
  const Vector to = L - block.p_W.cast<T>();
  const Vector axis = Vector(aim[0], aim[1], T(0)) - L;
  const T d2 = to.squaredNorm();
  const T cos_e = -to.dot(axis) / sqrt(d2 * axis.squaredNorm());
  const T lens = T(1) + shared[1] * block.r2 + shared[2] * (block.r2 * block.r2);
  if (!(to.z() > T(0)) || !(cos_e > T(0)) || !(lens > T(0))) return false;
  *out = log(to.z()) - T(1.5) * log(d2) + shared[0] * log(cos_e) + log(lens);
  return true;
}

struct BlockResidual {
  const Block* block;
  template <typename T>
  bool operator()(const T* position, const T* aim, const T* level, const T* shared,
                  T* residual) const {
    T shape;
    if (!level_of(*block, position, aim, shared, &shape)) return false;
    residual[0] = (T(block->level) - level[0] - shape) / T(block->sigma);
    return true;
  }
};

/// The half vector at a highlight lies along the normal.
struct HighlightResidual {
  Highlight seen;
  Eigen::Vector3d eye_W;
  template <typename T>
  bool operator()(const T* position, T* residual) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Eigen::Vector3d p_W(seen.at_m.x(), seen.at_m.y(), 0);
    const Vector wi = (Eigen::Map<const Vector>(position) - p_W.cast<T>()).normalized();
    const Vector h = (wi + (eye_W - p_W).normalized().cast<T>()).normalized();
    residual[0] = h.x() / T(seen.normal_sigma);
    residual[1] = h.y() / T(seen.normal_sigma);
    return true;
  }
};

template <int N>
struct Prior {
  std::array<double, N> mean, sigma;
  template <typename T>
  bool operator()(const T* x, T* residual) const {
    for (int i = 0; i < N; ++i) {
      const auto at = static_cast<std::size_t>(i);
      residual[i] = (x[i] - T(mean[at])) / T(sigma[at]);
    }
    return true;
  }
};

template <int N>
ceres::CostFunction* prior(const std::array<double, N>& mean, const std::array<double, N>& sigma) {
  return new ceres::AutoDiffCostFunction<Prior<N>, N, N>(new Prior<N>{mean, sigma});
}

/// The problem over plain arrays that Ceres keeps pointers into.
struct Parameters {
  std::vector<std::array<double, 3>> position;
  std::vector<std::array<double, 2>> aim;
  std::vector<double> level;
  std::array<double, 3> shared{1, 0, 0};  ///< emission, vignetting
};

Parameters start_of(const LightFitInput& input, const std::vector<Block>& blocks) {
  Parameters x;
  for (const Eigen::Vector3d& light : input.geometry.lights_W) {
    x.position.push_back({light.x(), light.y(), light.z()});
    x.aim.push_back({0, 0});
  }
  std::vector<double> sum(x.position.size()), n(x.position.size());
  for (const Block& b : blocks) {
    double shape = 0;
    if (!level_of(b, x.position[b.light].data(), x.aim[b.light].data(), x.shared.data(), &shape)) {
      throw InputError(light_name(b.light), "configured below the horizon of the plate",
                       "a light above it");
    }
    sum[b.light] += b.level - shape;
    n[b.light] += 1;
  }
  for (std::size_t l = 0; l < sum.size(); ++l)
    x.level.push_back(sum[l] / std::max(1.0, n[l]));
  return x;
}

void add_priors(const LightFitInput& input, Parameters& x, ceres::Problem& problem) {
  const LightPriors& p = input.priors;
  for (std::size_t l = 0; l < x.position.size(); ++l) {
    const Eigen::Vector3d& nominal = input.geometry.lights_W[l];
    const double sigma = p.position * nominal.norm();
    problem.AddResidualBlock(
        prior<3>({nominal.x(), nominal.y(), nominal.z()}, {sigma, sigma, sigma}), nullptr,
        x.position[l].data());
    problem.AddResidualBlock(prior<2>({0, 0}, {p.aim_m, p.aim_m}), nullptr, x.aim[l].data());
  }
  problem.AddResidualBlock(prior<3>({1, 0, 0}, {p.emission, p.vignetting, p.vignetting}), nullptr,
                           x.shared.data());
}

void build(const LightFitInput& input, const std::vector<Block>& blocks, Parameters& x,
           ceres::Problem& problem) {
  for (const Block& block : blocks) {
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<BlockResidual, 1, 3, 2, 1, 3>(new BlockResidual{&block}),
        new ceres::HuberLoss(kHuber), x.position[block.light].data(), x.aim[block.light].data(),
        &x.level[block.light], x.shared.data());
  }
  for (const Highlight& seen : input.highlights) {
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<HighlightResidual, 2, 3>(
                                 new HighlightResidual{seen, input.geometry.camera.position()}),
                             nullptr, x.position[seen.light].data());
  }
  add_priors(input, x, problem);
}

Eigen::Matrix3d covariance_of(ceres::Covariance& covariance, const double* position) {
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> out;
  covariance.GetCovarianceBlock(position, position, out.data());
  return out;
}

double residual_of(const Block& b, const Parameters& x) {
  double shape = 0;
  level_of(b, x.position[b.light].data(), x.aim[b.light].data(), x.shared.data(), &shape);
  return b.level - x.level[b.light] - shape;
}

/// How the residuals compare to their sigmas, at least 1: what the covariance is scaled by.
double birge_ratio2(const std::vector<Block>& blocks, const Parameters& x) {
  double chi2 = 0;
  for (const Block& b : blocks)
    chi2 += std::pow(residual_of(b, x) / b.sigma, 2);
  return std::max(1.0, chi2 / static_cast<double>(blocks.size()));
}

void add_residuals(const LightFitInput& input, const std::vector<Block>& blocks,
                   const Parameters& x, LightFit& fit) {
  const cv::Size grid = block_grid(input.sensor.cells());
  std::vector<double> squares(fit.lights.size()), n(fit.lights.size());
  for (std::size_t l = 0; l < fit.lights.size(); ++l)
    fit.residuals.emplace_back(grid, CV_32FC1, cv::Scalar(std::numeric_limits<float>::quiet_NaN()));
  for (const Block& b : blocks) {
    const double r = residual_of(b, x);
    squares[b.light] += r * r;
    n[b.light] += 1;
    if (b.flat) fit.residuals[b.light].at<float>(b.at) = static_cast<float>(r);
  }
  for (std::size_t l = 0; l < fit.lights.size(); ++l)
    fit.lights[l].rms = std::sqrt(squares[l] / std::max(1.0, n[l]));
}

LightFit solve(const LightFitInput& input, const std::vector<Block>& blocks, Parameters& x) {
  ceres::Problem problem;
  build(input, blocks, x, problem);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-12;
  options.parameter_tolerance = 1e-10;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) {
    throw InputError("whites", "the lights' places do not follow from their falloff",
                     "a flat plate that covers the inspected region");
  }
  std::vector<std::pair<const double*, const double*>> wanted;
  for (const auto& position : x.position)
    wanted.emplace_back(position.data(), position.data());
  ceres::Covariance covariance({});
  const bool known = covariance.Compute(wanted, &problem);
  const double scale = birge_ratio2(blocks, x);
  LightFit fit;
  fit.emission = x.shared[0];
  fit.vignetting = {x.shared[1], x.shared[2]};
  for (std::size_t l = 0; l < x.position.size(); ++l) {
    FittedLight& light = fit.lights.emplace_back();
    light.position_W = Eigen::Vector3d(x.position[l].data());
    light.aim_m = Eigen::Vector2d(x.aim[l].data());
    if (known) light.covariance = scale * covariance_of(covariance, x.position[l].data());
    light.from_highlight = std::any_of(input.highlights.begin(), input.highlights.end(),
                                       [&](const Highlight& h) { return h.light == l; });
  }
  add_residuals(input, blocks, x, fit);
  return fit;
}

/// A shadow pulls a least-squares fit along; against the median of its neighbourhood it stands out
/// all the same. Here the fit was robust already.
void check_shadows(const std::vector<Block>& blocks, const Parameters& x) {
  const std::size_t lights = x.position.size();
  std::vector<std::size_t> dark(lights), all(lights);
  std::vector<Eigen::Vector3d> where(lights, Eigen::Vector3d::Zero());
  for (const Block& b : blocks) {
    ++all[b.light];
    if (residual_of(b, x) > -kShadow) continue;
    ++dark[b.light];
    where[b.light] += b.p_W;
  }
  for (std::size_t l = 0; l < lights; ++l) {
    const auto n = static_cast<double>(dark[l]);
    if (n <= kMostShadowed * static_cast<double>(all[l])) continue;
    const Eigen::Vector3d p = 1e3 * where[l] / n;
    throw InputError("white reference under " + light_name(l),
                     number(100 * n / static_cast<double>(all[l])) +
                         " % of it is in shadow or dirty, around x " + number(p.x()) + ", y " +
                         number(p.y()) + " mm",
                     "nothing between light and plate, and a clean plate");
  }
}

void check_fit(const LightFitInput& input, const LightFit& fit) {
  for (std::size_t l = 0; l < fit.lights.size(); ++l) {
    const FittedLight& light = fit.lights[l];
    const std::string where = "white reference under " + light_name(l);
    if (light.rms > kWorstRms) {
      throw InputError(where,
                       "its light falls off otherwise than with cosine and distance: " +
                           number(100 * light.rms) + " % rms",
                       "under 1 %: a flat, uniform plate in the nest, not bent");
    }
    const Eigen::Vector3d& nominal = input.geometry.lights_W[l];
    const double shift = (light.position_W - nominal).norm();
    if (shift > kMostShift * nominal.norm()) {
      throw InputError(
          where,
          "its falloff puts the light " + number(1e3 * shift) + " mm from where it is configured",
          "within " + number(1e3 * kMostShift * nominal.norm()) +
              " mm: a plate that is flat and not bent, and the rig as configured");
    }
  }
}

void check_input(const LightFitInput& input) {
  const std::size_t lights = input.geometry.lights_W.size();
  const bool flat = std::any_of(input.whites.begin(), input.whites.end(),
                                [](const WhiteView& w) { return w.height_m == 0; });
  if (!flat) throw InputError("whites", "none at height 0", "the plate in the inspected plane");
  for (const WhiteView& view : input.whites) {
    if (view.lights.size() != lights) {
      throw InputError("whites", std::to_string(view.lights.size()) + " lights",
                       std::to_string(lights) + " as configured");
    }
    for (const Radiance& white : view.lights) {
      if (white.value.size() != input.sensor.cells()) {
        throw InputError("whites", "an image of another size than the sensor's", "the same camera");
      }
    }
  }
  for (const Highlight& h : input.highlights) {
    if (h.light >= lights || !(h.normal_sigma > 0)) {
      throw InputError("highlights", "of a light that there is not", "a configured light");
    }
  }
}

}  // namespace

double FittedLight::relative_sigma() const {
  return std::sqrt(covariance.trace()) / position_W.norm();
}

LightFit fit_lights(const LightFitInput& input) {
  check_input(input);
  std::vector<Block> blocks;
  for (std::size_t l = 0; l < input.geometry.lights_W.size(); ++l) {
    const std::size_t before = blocks.size();
    for (const WhiteView& view : input.whites)
      add_blocks(input, view, l, blocks);
    if (blocks.size() - before < kLeastBlocks) {
      throw InputError(
          "white reference under " + light_name(l),
          "too little of it can be used: " + std::to_string(blocks.size() - before) + " blocks",
          "a plate over the inspected region, lit and not clipped");
    }
  }
  Parameters x = start_of(input, blocks);
  LightFit fit = solve(input, blocks, x);
  check_shadows(blocks, x);
  check_fit(input, fit);
  return fit;
}

}  // namespace brdfgate
