// The calibration board: a plate with a checkerboard, or one with markers in its white squares
// (ChArUco), and its corners in an image.
//
// Board frame B: origin at the board's centre, x along its columns, y along its rows upward, z
// toward the viewer; metres. The square at the lowest x and y is black, the plate around is white.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "model/frame.hpp"
#include "model/radiance.hpp"

namespace brdfgate {

enum class BoardKind { checker, charuco };

/// Markers are numbered through the white squares from the top left, row by row; dictionary 4X4_50,
/// their side 3/4 of a square's.
struct BoardPattern {
  BoardKind kind = BoardKind::checker;
  int squares_x = 10;  ///< an odd and an even number: half a turn shows
  int squares_y = 7;
  double square_m = 0.008;
};
inline constexpr double kMarkerShare = 0.75;

/// Throws InputError: under 3 squares a side, both numbers odd or both even, more white squares
/// than there are markers, a size that is none.
void check_pattern(const BoardPattern& pattern);

/// The pattern's squares as CV_8UC1, 0 black, 255 white, row 0 at the highest y: what is printed,
/// and what the simulated station shows. Pixels per square: a multiple of 8.
cv::Mat draw_board(const BoardPattern& pattern, int pixels_per_square);

/// Inner corners with their places in an image.
struct BoardView {
  std::vector<Eigen::Vector2d> board_m;   ///< x, y in B
  std::vector<Eigen::Vector2d> image_px;  ///< sensor pixels
};

/// Finds the corners in a recording's radiance, the lights' sum, cell by cell. A checkerboard must
/// be in view as a whole; of a ChArUco board 6 corners in two rows will do. Throws InputError
/// (`where`): board not found, or partly out of view.
BoardView find_board(const RadianceSet& radiance, const SensorFormat& sensor,
                     const BoardPattern& pattern, const std::string& where);

}  // namespace brdfgate
