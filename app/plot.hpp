// Pictures of numbers: data and a script for gnuplot, which draws them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace brdfgate {

/// One set of points. x empty: the points are numbered from 0. Points that are not finite are left
/// out.
struct PlotSeries {
  enum class Style { Points, Lines, LinesPoints, Boxes };
  std::string label;
  std::vector<double> x;
  std::vector<double> y;
  Style style = Style::Points;
};

/// A horizontal line across the picture.
struct PlotLevel {
  std::string label;
  double y = 0;
  std::size_t series = 0;  ///< has the colour of this series
};

struct Plot {
  std::string title;
  std::string x_label;
  std::string y_label;
  std::vector<PlotSeries> series;
  std::vector<PlotLevel> levels;
  std::vector<std::string> x_names;  ///< instead of numbers at x = 0, 1, 2, ...
  bool log_x = false;
  bool log_y = false;
  int width_px = 1600;
  int height_px = 900;
};

/// Draws the plot as a PNG, written all or nothing.
/// Throws InputError: nothing to draw, x and y of different lengths, gnuplot not installed or
/// failing (with its first line), a place that cannot be written.
void write_plot(const Plot& plot, const std::filesystem::path& png);

/// The script that write_plot() gives to gnuplot; data comes from the files series_<n>.dat in the
/// working folder. Text of the plot cannot become commands.
std::string plot_script(const Plot& plot);

}  // namespace brdfgate
