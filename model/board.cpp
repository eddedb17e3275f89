#include "model/board.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "model/error.hpp"
#include "model/geometry.hpp"
#include "model/markers.hpp"

namespace brdfgate {
namespace {

/// Grey level of the board's white in the 8-bit copy that detectors want.
constexpr double kWhiteLevel = 230;
constexpr std::size_t kLeastCharucoCorners = 6;
constexpr std::size_t kLeastMarkers = 3;
/// Half of a search window as a share of the way to the next corner: clear of other edges.
constexpr double kCheckerReach = 0.3;
constexpr double kCharucoReach = 0.11;  // a marker begins at an eighth of a square

bool is_black(int column, int row) {
  return (column + row) % 2 == 0;
}

int white_squares(const BoardPattern& pattern) {
  return pattern.squares_x * pattern.squares_y / 2;
}

Eigen::Vector2d corner_at(const BoardPattern& p, int i, int j) {
  return p.square_m * Eigen::Vector2d(i + 1 - p.squares_x / 2.0, j + 1 - p.squares_y / 2.0);
}

/// The lights' sum, channels averaged: CV_32FC1 per cell.
cv::Mat grey_of(const RadianceSet& radiance) {
  cv::Mat sum;
  for (const Radiance& light : radiance.lights) {
    cv::Mat grey;
    if (light.value.channels() == 1) {
      grey = light.value.clone();
    } else {
      cv::transform(light.value, grey, cv::Matx13f::ones() * (1.0F / 3));
    }
    sum = sum.empty() ? grey : cv::Mat(sum + grey);
  }
  return sum;
}

double percentile(const cv::Mat& image, double share) {
  std::vector<float> values(image.begin<float>(), image.end<float>());
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

cv::Mat eight_bits(const cv::Mat& grey) {
  cv::Mat out;
  const double white = std::max(percentile(grey, 0.95), 1e-12);
  grey.convertTo(out, CV_8U, kWhiteLevel / white);
  return out;
}

/// Homography from B's plane to cells.
cv::Matx33d plane_to_cells(const std::vector<Eigen::Vector2d>& board,
                           const std::vector<cv::Point2f>& cells, bool robust) {
  std::vector<cv::Point2d> from;
  std::vector<cv::Point2d> to;
  for (std::size_t i = 0; i < board.size(); ++i) {
    from.emplace_back(board[i].x(), board[i].y());
    to.emplace_back(cells[i].x, cells[i].y);
  }
  const cv::Mat H = cv::findHomography(from, to, robust ? cv::RANSAC : 0, 3.0);
  return H.empty() ? cv::Matx33d::zeros() : cv::Matx33d(H);
}

cv::Point2f mapped(const cv::Matx33d& H, const Eigen::Vector2d& p) {
  const cv::Vec3d q = H * cv::Vec3d(p.x(), p.y(), 1);
  return {static_cast<float>(q[0] / q[2]), static_cast<float>(q[1] / q[2])};
}

/// Mean over white squares' centres less that over black ones.
double contrast(const cv::Mat& grey, const BoardPattern& p, const cv::Matx33d& H) {
  double sum = 0;
  for (int j = 0; j < p.squares_y; ++j) {
    for (int i = 0; i < p.squares_x; ++i) {
      const Eigen::Vector2d centre = corner_at(p, i, j) - Eigen::Vector2d::Constant(p.square_m / 2);
      const cv::Point at = mapped(H, centre);
      if (!cv::Rect({}, grey.size()).contains(at)) continue;
      sum += (is_black(i, j) ? -1 : 1) * grey.at<float>(at);
    }
  }
  return sum;
}

/// Seen from the front: x to the right and y up in B become y down in the image.
bool seen_from_front(const cv::Matx33d& H) {
  const cv::Point2f o = mapped(H, {0, 0});
  const cv::Point2f x = mapped(H, {1e-3, 0}) - o;
  const cv::Point2f y = mapped(H, {0, 1e-3}) - o;
  return x.cross(y) < 0;
}

std::vector<Eigen::Vector2d> all_corners(const BoardPattern& p) {
  std::vector<Eigen::Vector2d> out;
  for (int j = 0; j + 1 < p.squares_y; ++j) {
    for (int i = 0; i + 1 < p.squares_x; ++i)
      out.push_back(corner_at(p, i, j));
  }
  return out;
}

/// Which way round the detector walked the grid: the one seen from the front with black and white
/// where they belong.
std::optional<std::vector<Eigen::Vector2d>> oriented(const cv::Mat& grey, const BoardPattern& p,
                                                     const std::vector<cv::Point2f>& cells) {
  std::optional<std::vector<Eigen::Vector2d>> best;
  double most = 0;
  for (const Eigen::Array2d& sign : {Eigen::Array2d(1, 1), Eigen::Array2d(-1, -1),
                                     Eigen::Array2d(-1, 1), Eigen::Array2d(1, -1)}) {
    std::vector<Eigen::Vector2d> board = all_corners(p);
    for (Eigen::Vector2d& corner : board)
      corner = (corner.array() * sign).matrix();
    const cv::Matx33d H = plane_to_cells(board, cells, false);
    const double found = contrast(grey, p, H);
    if (seen_from_front(H) && found > most) {
      most = found;
      best = board;
    }
  }
  return best;
}

struct CellCorners {
  std::vector<Eigen::Vector2d> board_m;
  std::vector<cv::Point2f> cells;
};

CellCorners find_checker(const cv::Mat& grey, const BoardPattern& p, const std::string& where) {
  const cv::Size size(p.squares_x - 1, p.squares_y - 1);
  std::vector<cv::Point2f> cells;
  const bool found = cv::findChessboardCornersSB(
      eight_bits(grey), size, cells, cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_EXHAUSTIVE);
  const auto board = found ? oriented(grey, p, cells) : std::nullopt;
  if (!board) {
    throw InputError(where,
                     "no whole checkerboard of " + std::to_string(p.squares_x) + " x " +
                         std::to_string(p.squares_y) + " squares in view",
                     "all its corners in the image, sharp and lit");
  }
  return {*board, cells};
}

/// Square (column, row) of each marker, from its number.
std::vector<cv::Point> marker_squares(const BoardPattern& p) {
  std::vector<cv::Point> out;
  for (int j = p.squares_y - 1; j >= 0; --j) {
    for (int i = 0; i < p.squares_x; ++i) {
      if (!is_black(i, j)) out.emplace_back(i, j);
    }
  }
  return out;
}

/// Corners of a marker in B, clockwise as seen, from its top left.
std::array<Eigen::Vector2d, 4> marker_corners(const BoardPattern& p, const cv::Point& square) {
  const Eigen::Vector2d centre =
      corner_at(p, square.x, square.y) - Eigen::Vector2d::Constant(p.square_m / 2);
  const double h = kMarkerShare * p.square_m / 2;
  return {Eigen::Vector2d(centre + Eigen::Vector2d(-h, h)),
          Eigen::Vector2d(centre + Eigen::Vector2d(h, h)),
          Eigen::Vector2d(centre + Eigen::Vector2d(h, -h)),
          Eigen::Vector2d(centre + Eigen::Vector2d(-h, -h))};
}

/// Where the markers say the inner corners are: the plane's homography, and what the nearest
/// marker corner lies off it (the lens).
CellCorners predict_corners(const CellCorners& markers, const BoardPattern& p,
                            const cv::Size& size) {
  const cv::Matx33d H = plane_to_cells(markers.board_m, markers.cells, true);
  CellCorners out;
  const double near = 0.3 * p.square_m;  // the corner's own two markers
  for (const Eigen::Vector2d& corner : all_corners(p)) {
    double least = near;
    cv::Point2f at(-1, -1);
    for (std::size_t m = 0; m < markers.cells.size(); ++m) {
      const double distance = (markers.board_m[m] - corner).norm();
      if (distance >= least) continue;
      least = distance;
      at = mapped(H, corner) + markers.cells[m] - mapped(H, markers.board_m[m]);
    }
    constexpr float kMargin = 6;
    const cv::Rect2f inside(kMargin, kMargin, static_cast<float>(size.width) - 2 * kMargin,
                            static_cast<float>(size.height) - 2 * kMargin);
    if (!inside.contains(at)) continue;
    out.board_m.push_back(corner);
    out.cells.push_back(at);
  }
  return out;
}

/// Six corners that do not lie in one row: a pose and a homography follow from them.
bool spans_plane(const std::vector<Eigen::Vector2d>& corners) {
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const auto& c : corners)
    mean += c / static_cast<double>(corners.size());
  for (const auto& c : corners)
    spread += (c - mean) * (c - mean).transpose();
  return corners.size() >= kLeastCharucoCorners &&
         spread.determinant() > 1e-6 * spread.trace() * spread.trace();
}

CellCorners find_charuco(const cv::Mat& grey, const BoardPattern& p, const std::string& where) {
  const std::vector<cv::Point> squares = marker_squares(p);
  CellCorners markers;
  for (const FoundMarker& found : find_markers(eight_bits(grey))) {
    if (found.id >= static_cast<int>(squares.size())) continue;
    const auto corners = marker_corners(p, squares[static_cast<std::size_t>(found.id)]);
    markers.board_m.insert(markers.board_m.end(), corners.begin(), corners.end());
    markers.cells.insert(markers.cells.end(), found.corners.begin(), found.corners.end());
  }
  CellCorners out;
  if (markers.cells.size() >= 4 * kLeastMarkers) out = predict_corners(markers, p, grey.size());
  if (!spans_plane(out.board_m)) {
    throw InputError(
        where,
        "the ChArUco board is not to be seen: " + std::to_string(markers.cells.size() / 4) +
            " of " + std::to_string(squares.size()) + " markers found",
        "most of the board in the image, sharp and lit");
  }
  return out;
}

/// Half the window for the refinement, in cells: by the shortest way between neighbours.
int reach_of(const CellCorners& corners, const BoardPattern& p) {
  const cv::Matx33d H = plane_to_cells(corners.board_m, corners.cells, true);
  double shortest = HUGE_VAL;
  for (const Eigen::Vector2d& c : corners.board_m) {
    for (const Eigen::Vector2d& step :
         {Eigen::Vector2d(p.square_m, 0), Eigen::Vector2d(0, p.square_m)}) {
      const cv::Point2f way = mapped(H, c + step) - mapped(H, c);
      shortest = std::min(shortest, std::hypot(double(way.x), double(way.y)));
    }
  }
  const double share = p.kind == BoardKind::checker ? kCheckerReach : kCharucoReach;
  return std::clamp(static_cast<int>(share * shortest), 2, 15);
}

}  // namespace

void check_pattern(const BoardPattern& p) {
  const std::string size = std::to_string(p.squares_x) + " x " + std::to_string(p.squares_y);
  if (p.squares_x < 3 || p.squares_y < 3 || p.squares_x > 100 || p.squares_y > 100) {
    throw InputError("board.squares", size, "3 to 100 squares a side");
  }
  if (p.squares_x % 2 == p.squares_y % 2) {
    throw InputError("board.squares", size,
                     "an odd and an even number, or half a turn would not show");
  }
  if (p.kind == BoardKind::charuco && white_squares(p) > kMarkerIds) {
    throw InputError(
        "board.squares", size,
        "at most " + std::to_string(2 * kMarkerIds) + " squares, 4X4_50 has no more markers");
  }
  if (!(p.square_m > 1e-4 && p.square_m < 1)) {
    throw InputError("board.square_mm", std::to_string(p.square_m * 1e3), "0.1 to 1000");
  }
}

cv::Mat draw_board(const BoardPattern& p, int pixels_per_square) {
  check_pattern(p);
  const int side = pixels_per_square;
  cv::Mat image(p.squares_y * side, p.squares_x * side, CV_8UC1, cv::Scalar(255));
  const auto square = [&](int i, int j) {
    return image(cv::Rect(i * side, (p.squares_y - 1 - j) * side, side, side));
  };
  for (int j = 0; j < p.squares_y; ++j) {
    for (int i = 0; i < p.squares_x; ++i) {
      if (is_black(i, j)) square(i, j).setTo(0);
    }
  }
  if (p.kind == BoardKind::checker) return image;
  const std::vector<cv::Point> squares = marker_squares(p);
  for (std::size_t id = 0; id < squares.size(); ++id) {
    const cv::Mat marker = draw_marker(static_cast<int>(id), side / 8);
    const int margin = (side - marker.cols) / 2;
    marker.copyTo(square(squares[id].x, squares[id].y)(cv::Rect({margin, margin}, marker.size())));
  }
  return image;
}

BoardView find_board(const RadianceSet& radiance, const SensorFormat& sensor,
                     const BoardPattern& pattern, const std::string& where) {
  check_pattern(pattern);
  const cv::Mat grey = grey_of(radiance);
  CellCorners corners = pattern.kind == BoardKind::checker ? find_checker(grey, pattern, where)
                                                           : find_charuco(grey, pattern, where);
  const int reach = reach_of(corners, pattern);
  cv::cornerSubPix(grey, corners.cells, {reach, reach}, {-1, -1},
                   {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-4});
  BoardView view;
  view.board_m = corners.board_m;
  const Eigen::Vector2d first = cell_centre_px(sensor, 0, 0);
  const Eigen::Vector2d step = cell_centre_px(sensor, 1, 1) - first;
  for (const cv::Point2f& c : corners.cells)
    view.image_px.push_back(first + step.cwiseProduct(Eigen::Vector2d(c.x, c.y)));
  return view;
}

}  // namespace brdfgate
