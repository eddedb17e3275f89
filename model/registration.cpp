#include "model/registration.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>

#include "model/error.hpp"
#include "model/log_image.hpp"

namespace brdfgate {
namespace {

/// The nest's level in plane images; the part's median is 0. Far enough under it that the outline
/// stands out from any print.
constexpr float kNestLevel = -2.0F;
/// Contrasts on the part beyond this (ln units) count as this.
constexpr float kMostContrast = 1.5F;
/// Pyramid: blur and distance of the points compared, m.
struct Level {
  double blur;
  double step;
  int rounds;
};
constexpr Level kCoarse{0.003, 0.002, 15}, kFine{0.0007, 0, 8};
/// A grid step holds at least this many steps from cell to cell: no hole between cells.
constexpr double kCellsPerStep = 1.25;
/// A match farther off than this is none: most of the taught part would lie out of the view.
constexpr double kMostShift = 0.012, kMostTurn = 0.2;
/// Deviation of a good match, where Huber's weights begin to fall (ln units).
constexpr double kMatchError = 0.15;
/// How far parts lie off as a rule: holds what nothing tells.
constexpr double kShiftPrior = 0.005, kTurnPrior = 0.09;

void check_size(const cv::Mat& a, const cv::Mat& b, const char* what) {
  if (a.size() == b.size()) return;
  throw InputError(what,
                   std::to_string(a.cols) + " x " + std::to_string(a.rows) + " cells against " +
                       std::to_string(b.cols) + " x " + std::to_string(b.rows),
                   "one size");
}

/// Grid coordinates (column, row) of a point of the plane.
struct Grid {
  int side = 0;
  double pitch = kLayoutPitch;

  Eigen::Vector2d at(const Eigen::Vector2d& p) const {
    return (p / pitch).array() + 0.5 * (side - 1);
  }
  Eigen::Vector2d point(int column, int row) const {
    return pitch * (Eigen::Vector2d(column, row).array() - 0.5 * (side - 1)).matrix();
  }
};

/// The widest step from an inspected cell to its neighbours, m.
double cell_step(const CellGeometry& cells) {
  double widest = 0;
  for (int v = 0; v + 1 < cells.inside.rows; ++v) {
    for (int u = 0; u + 1 < cells.inside.cols; ++u) {
      if (!cells.inside.at<unsigned char>(v, u)) continue;
      const auto p = cells.position_m.at<cv::Vec2f>(v, u);
      for (const auto& [y, x] : {std::pair{v, u + 1}, std::pair{v + 1, u}}) {
        if (!cells.inside.at<unsigned char>(y, x)) continue;
        widest = std::max(widest, cv::norm(cells.position_m.at<cv::Vec2f>(y, x) - p));
      }
    }
  }
  return widest;
}

/// The grid that holds every inspected cell.
Grid grid_over(const CellGeometry& cells) {
  double reach = 0;
  for (int v = 0; v < cells.inside.rows; ++v) {
    for (int u = 0; u < cells.inside.cols; ++u) {
      if (!cells.inside.at<unsigned char>(v, u)) continue;
      const auto p = cells.position_m.at<cv::Vec2f>(v, u);
      reach = std::max<double>(reach, std::max(std::abs(p[0]), std::abs(p[1])));
    }
  }
  const double pitch = std::max(kLayoutPitch, kCellsPerStep * cell_step(cells));
  return {2 * static_cast<int>(std::ceil(reach / pitch)) + 3, pitch};
}

/// Shares of a cell's weight on the four grid points around it (bilinear).
template <typename Visit>
void around(const Grid& grid, const cv::Vec2f& p, Visit&& visit) {
  const Eigen::Vector2d at = grid.at({p[0], p[1]});
  const int u = static_cast<int>(std::floor(at.x())), v = static_cast<int>(std::floor(at.y()));
  if (u < 0 || v < 0 || u + 1 >= grid.side || v + 1 >= grid.side) return;
  const auto x = static_cast<float>(at.x() - u), y = static_cast<float>(at.y() - v);
  visit(v, u, (1 - x) * (1 - y));
  visit(v, u + 1, x * (1 - y));
  visit(v + 1, u, (1 - x) * y);
  visit(v + 1, u + 1, x * y);
}

/// How the plane looks: the part's ln f under light 2 (channels summed) against its median, the
/// nest at kNestLevel, mixed where a grid point sees both.
struct PlaneImage {
  cv::Mat look;  ///< CV_32FC1
  cv::Mat seen;  ///< CV_32FC1, weight of the cells, 0: none
};

float summed(const Reflectance& light, int v, int u) {
  const int channels = light.value.channels();
  const auto* f = light.value.ptr<float>(v) + std::ptrdiff_t{u} * channels;
  float sum = 0;
  for (int c = 0; c < channels; ++c)
    sum += f[c];
  return sum;
}

/// Median of the positive values.
float median_of(const cv::Mat& image, const cv::Mat& weight) {
  std::vector<float> values;
  for (int v = 0; v < image.rows; ++v)
    for (int u = 0; u < image.cols; ++u)
      if (weight.at<float>(v, u) > 0) values.push_back(image.at<float>(v, u));
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Sums over the cells that fell on each place of the grid, CV_32FC1 each.
struct GridSums {
  cv::Mat seen;     ///< share of all cells
  cv::Mat on_part;  ///< share of the part's
  cv::Mat f;        ///< the part's reflectance, times the share
};

GridSums sum_on_grid(const Grid& grid, const Reflectance& light, const CellGeometry& cells,
                     const cv::Mat& not_part) {
  const cv::Size size(grid.side, grid.side);
  GridSums sums{cv::Mat::zeros(size, CV_32FC1), cv::Mat::zeros(size, CV_32FC1),
                cv::Mat::zeros(size, CV_32FC1)};
  for (int v = 0; v < cells.inside.rows; ++v) {
    for (int u = 0; u < cells.inside.cols; ++u) {
      if (!cells.inside.at<unsigned char>(v, u) || (light.mask.at<unsigned char>(v, u) & kInvalid))
        continue;
      const bool part = not_part.at<unsigned char>(v, u) == 0;
      const float f = part ? std::max(0.0F, summed(light, v, u)) : 0;
      around(grid, cells.position_m.at<cv::Vec2f>(v, u), [&](int y, int x, float share) {
        sums.seen.at<float>(y, x) += share;
        if (!part) return;
        sums.on_part.at<float>(y, x) += share;
        sums.f.at<float>(y, x) += share * f;
      });
    }
  }
  return sums;
}

/// ln of the part's mean reflectance at each place, 0 where no part is.
cv::Mat log_mean(const GridSums& sums) {
  cv::Mat look = cv::Mat::zeros(sums.f.size(), CV_32FC1);
  for (int v = 0; v < look.rows; ++v) {
    for (int u = 0; u < look.cols; ++u) {
      const float here = sums.on_part.at<float>(v, u);
      if (here > 0)
        look.at<float>(v, u) =
            std::log(sums.f.at<float>(v, u) / here + static_cast<float>(kLogFloor));
    }
  }
  return look;
}

PlaneImage plane_image(const Grid& grid, const Reflectance& light, const CellGeometry& cells,
                       const cv::Mat& not_part) {
  const GridSums sums = sum_on_grid(grid, light, cells, not_part);
  PlaneImage out{log_mean(sums), sums.seen};
  const float middle = median_of(out.look, sums.on_part);
  for (int v = 0; v < out.look.rows; ++v) {
    for (int u = 0; u < out.look.cols; ++u) {
      const float all = sums.seen.at<float>(v, u);
      const float share = all > 0 ? sums.on_part.at<float>(v, u) / all : 0;
      float& look = out.look.at<float>(v, u);
      look = share * std::clamp(look - middle, -kMostContrast, kMostContrast) +
             (1 - share) * kNestLevel;
    }
  }
  return out;
}

/// Blurred over what was seen only, with the places where enough was.
struct Smooth {
  cv::Mat look;  ///< CV_32FC1
  cv::Mat seen;  ///< CV_8UC1
};

Smooth smooth(const cv::Mat& look, const cv::Mat& seen, double sigma) {
  cv::Mat weight;
  cv::Mat sum;
  cv::Mat(seen > 0).convertTo(weight, CV_32F, 1.0 / 255);
  cv::GaussianBlur(look.mul(weight), sum, {}, sigma);
  cv::GaussianBlur(weight, weight, {}, sigma);
  Smooth out{sum / cv::max(weight, 1e-3), (weight > 0.9) & (seen > 0)};
  return out;
}

/// A level's blur in grid steps, at least one.
double blur_steps(const Level& level, const Grid& grid) {
  return std::max(1.0, level.blur / grid.pitch);
}

/// The taught image of one level with its slopes per metre.
struct Template {
  Grid grid;
  Smooth image;
  cv::Mat slope_x, slope_y;
};

Template make_template(const TaughtLayout& layout, const Grid& grid, const Level& level) {
  Template t{grid, smooth(layout.look, layout.seen, blur_steps(level, grid)), {}, {}};
  const cv::Mat kernel = (cv::Mat_<float>(1, 3) << -0.5F, 0, 0.5F);
  cv::filter2D(t.image.look, t.slope_x, CV_32F, kernel / layout.pitch_m);
  cv::filter2D(t.image.look, t.slope_y, CV_32F, kernel.t() / layout.pitch_m);
  return t;
}

float sample(const cv::Mat& image, int v, int u, float x, float y) {
  const auto* a = image.ptr<float>(v) + u;
  const auto* b = image.ptr<float>(v + 1) + u;
  return (1 - y) * ((1 - x) * a[0] + x * a[1]) + y * ((1 - x) * b[0] + x * b[1]);
}

/// Sums of one Gauss-Newton round.
struct Sums {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  double cost = 0;  ///< Huber's, mean over the points compared
  double points = 0;
  double square = 0;           ///< of the residuals
  double look = 0, look2 = 0;  ///< of the template
};

double huber_weight(double residual) {
  return std::min(1.0, kMatchError / std::max(1e-9, std::abs(residual)));
}

void add_point(Sums& s, const Template& t, const PlanarPose& pose, const Eigen::Vector2d& p,
               float seen) {
  const Eigen::Vector2d q = pose.to_taught(p);
  const Eigen::Vector2d at = t.grid.at(q);
  const int u = static_cast<int>(std::floor(at.x())), v = static_cast<int>(std::floor(at.y()));
  if (u < 0 || v < 0 || u + 1 >= t.grid.side || v + 1 >= t.grid.side) return;
  if (!t.image.seen.at<unsigned char>(v, u) || !t.image.seen.at<unsigned char>(v + 1, u + 1))
    return;
  const auto x = static_cast<float>(at.x() - u), y = static_cast<float>(at.y() - v);
  const double expected = sample(t.image.look, v, u, x, y);
  const double residual = seen - expected;
  const Eigen::Vector2d slope(sample(t.slope_x, v, u, x, y), sample(t.slope_y, v, u, x, y));
  // q = R^T (p - s): dq/ds = -R^T, dq/dtheta = -J q with J the quarter turn.
  const Eigen::Vector2d in_world = Eigen::Rotation2Dd(pose.rotation) * slope;
  const Eigen::Vector3d j(in_world.x(), in_world.y(), slope.y() * q.x() - slope.x() * q.y());
  const double w = huber_weight(residual);
  s.normal += w * j * j.transpose();
  s.gradient += w * residual * j;
  s.cost += w * residual * residual * (2 - w);
  s.square += residual * residual;
  s.look += expected;
  s.look2 += expected * expected;
  ++s.points;
}

Sums compare(const Template& t, const Smooth& part, const PlanarPose& pose, const Level& level) {
  const int step = std::max(1, static_cast<int>(level.step / t.grid.pitch));
  Sums s;
  for (int v = 0; v < part.look.rows; v += step) {
    for (int u = 0; u < part.look.cols; u += step) {
      if (part.seen.at<unsigned char>(v, u))
        add_point(s, t, pose, t.grid.point(u, v), part.look.at<float>(v, u));
    }
  }
  s.cost /= std::max(1.0, s.points);
  return s;
}

/// Newton's steps from a start; the pose comes with its last comparison's cost.
struct Fit {
  PlanarPose pose;
  double cost = 0;
};

Fit refine(const Template& t, const Smooth& part, const Level& level, PlanarPose pose) {
  const Eigen::Vector3d prior(kShiftPrior, kShiftPrior, kTurnPrior);
  const Eigen::Vector3d precision = kMatchError * kMatchError * prior.array().square().inverse();
  for (int i = 0; i < level.rounds; ++i) {
    Sums s = compare(t, part, pose, level);
    if (s.points < 10) break;
    const Eigen::Vector3d now(pose.shift_m.x(), pose.shift_m.y(), pose.rotation);
    // The image moves against its slopes: residual = -j step.
    s.normal.diagonal() += precision;
    const Eigen::Vector3d step =
        -s.normal.ldlt().solve(s.gradient + Eigen::Vector3d(precision.array() * now.array()));
    pose.shift_m += step.head<2>();
    pose.rotation += step[2];
    if (step.head<2>().norm() < 1e-6 && std::abs(step[2]) < 1e-5) break;
  }
  return {pose, compare(t, part, pose, level).cost};
}

/// Difference of the centres of what stands out from the nest.
Eigen::Vector2d centre(const cv::Mat& look, const cv::Mat& seen, const Grid& grid) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double n = 0;
  for (int v = 0; v < look.rows; ++v) {
    for (int u = 0; u < look.cols; ++u) {
      if (!seen.at<unsigned char>(v, u) || look.at<float>(v, u) < kNestLevel / 2) continue;
      sum += grid.point(u, v);
      ++n;
    }
  }
  return n > 0 ? Eigen::Vector2d(sum / n) : Eigen::Vector2d::Zero();
}

}  // namespace

Eigen::Vector2d PlanarPose::to_taught(const Eigen::Vector2d& p_W) const {
  return Eigen::Rotation2Dd(-rotation) * (p_W - shift_m);
}

TaughtLayout make_layout(const std::vector<Reflectance>& r, const CellGeometry& cells,
                         const Regions& regions) {
  const Reflectance& light = diffuse_light(r);
  check_size(light.value, cells.inside, "layout");
  check_size(regions.label, cells.inside, "layout");
  const Grid grid = grid_over(cells);
  const PlaneImage image = plane_image(grid, light, cells, regions.label == kNotPart);
  TaughtLayout layout{grid.pitch, {}, image.look, image.seen > 0, {}};
  // Each grid point has the label with the most weight of cells around it.
  layout.label = cv::Mat(image.look.size(), CV_8UC1, cv::Scalar(kNotPart));
  cv::Mat most = cv::Mat::zeros(image.look.size(), CV_32FC1);
  for (int k = 0; k <= kNotPart; ++k) {
    if (k >= regions.clusters && k < kUnknown) continue;
    cv::Mat votes = cv::Mat::zeros(image.look.size(), CV_32FC1);
    for (int v = 0; v < cells.inside.rows; ++v)
      for (int u = 0; u < cells.inside.cols; ++u)
        if (cells.inside.at<unsigned char>(v, u) && regions.label.at<unsigned char>(v, u) == k)
          around(grid, cells.position_m.at<cv::Vec2f>(v, u),
                 [&](int y, int x, float share) { votes.at<float>(y, x) += share; });
    layout.label.setTo(k, votes > most);
    most = cv::max(most, votes);
  }
  return layout;
}

Registration register_part(const TaughtLayout& layout, const std::vector<Reflectance>& r,
                           const CellGeometry& cells, const cv::Mat& not_part) {
  if (layout.empty()) throw InputError("registration", "no layout was taught", "a taught one");
  const Reflectance& light = diffuse_light(r);
  check_size(light.value, cells.inside, "registration");
  check_size(not_part, cells.inside, "registration");
  const Grid grid{layout.label.cols, layout.pitch_m};
  const PlaneImage image = plane_image(grid, light, cells, not_part);

  const Template coarse = make_template(layout, grid, kCoarse);
  const Smooth blurred = smooth(image.look, image.seen, blur_steps(kCoarse, grid));
  const Eigen::Vector2d moved =
      centre(blurred.look, blurred.seen, grid) - centre(coarse.image.look, coarse.image.seen, grid);
  Fit best{{}, std::numeric_limits<double>::infinity()};
  for (const double turn : {0.0, -kTurnPrior * 0.7, kTurnPrior * 0.7}) {
    const Fit fit = refine(coarse, blurred, kCoarse, {moved, turn});
    if (fit.cost < best.cost) best = fit;
  }
  const Template fine = make_template(layout, grid, kFine);
  const Smooth sharp = smooth(image.look, image.seen, blur_steps(kFine, grid));
  const PlanarPose pose = refine(fine, sharp, kFine, best.pose).pose;
  const Sums s = compare(fine, sharp, pose, kFine);
  const double variance = s.look2 - s.look * s.look / std::max(1.0, s.points);
  // A plain part that fills the view varies by nothing: there is nothing to disagree with.
  const double floor = kMatchError * kMatchError * s.points;
  const bool near = pose.shift_m.norm() < kMostShift && std::abs(pose.rotation) < kMostTurn;
  return {pose, near && s.points > 0 ? 1 - s.square / std::max(variance, floor) : 0};
}

cv::Mat expected_labels(const TaughtLayout& layout, const PlanarPose& pose,
                        const CellGeometry& cells) {
  cv::Mat out(cells.inside.size(), CV_8UC1, cv::Scalar(kNotPart));
  const Grid grid{layout.label.cols, layout.pitch_m};
  for (int v = 0; v < out.rows; ++v) {
    for (int u = 0; u < out.cols; ++u) {
      if (!cells.inside.at<unsigned char>(v, u)) continue;
      const auto p = cells.position_m.at<cv::Vec2f>(v, u);
      const Eigen::Vector2d at = grid.at(pose.to_taught({p[0], p[1]}));
      const long x = std::lround(at.x()), y = std::lround(at.y());
      if (x < 0 || y < 0 || x >= grid.side || y >= grid.side) continue;
      out.at<unsigned char>(v, u) =
          layout.label.at<unsigned char>(static_cast<int>(y), static_cast<int>(x));
    }
  }
  return out;
}

}  // namespace brdfgate
