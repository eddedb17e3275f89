#include "app/plot.hpp"

#include <fcntl.h>
#include <fmt/core.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <span>
#include <system_error>

#include "app/temp_folder.hpp"
#include "model/error.hpp"
#include "model/mapped_file.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

/// Colours that remain apart for colour-blind eyes (Okabe and Ito 2008).
constexpr std::array<const char*, 6> kColours{"#0072b2", "#d55e00", "#009e73",
                                              "#cc79a7", "#e69f00", "#56b4e9"};

const char* colour(std::size_t series) {
  return kColours[series % kColours.size()];
}

/// A gnuplot string. Single quotes: in double ones backquotes would run a command.
std::string quoted(const std::string& text) {
  std::string quote = "'";
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < 32) {
      quote += ' ';
    } else {
      quote += c == '\'' ? std::string("''") : std::string(1, c);
    }
  }
  return quote + "'";
}

const char* style_of(PlotSeries::Style style) {
  switch (style) {
    case PlotSeries::Style::Lines:
      return "lines linewidth 2";
    case PlotSeries::Style::LinesPoints:
      return "linespoints linewidth 2 pointtype 7";
    case PlotSeries::Style::Boxes:
      return "boxes fill solid 0.7 border";
    case PlotSeries::Style::Points:
      break;
  }
  return "points pointtype 7 pointsize 1";
}

/// Lines beyond the last colour start over, dashed.
std::string dashes(PlotSeries::Style style, std::size_t round) {
  const bool line = style == PlotSeries::Style::Lines || style == PlotSeries::Style::LinesPoints;
  return line && round > 0 ? fmt::format(" dashtype {}", round + 1) : "";
}

void check(const Plot& plot) {
  std::size_t points = 0;
  for (const PlotSeries& s : plot.series) {
    if (!s.x.empty() && s.x.size() != s.y.size()) {
      throw InputError("plot '" + s.label + "'",
                       std::to_string(s.x.size()) + " x for " + std::to_string(s.y.size()) + " y",
                       "as many, or no x");
    }
    points += static_cast<std::size_t>(
        std::count_if(s.y.begin(), s.y.end(), [](double y) { return std::isfinite(y); }));
  }
  if (points == 0) throw InputError("plot '" + plot.title + "'", "has nothing to draw");
}

void write_text(const fs::path& file, const std::string& text) {
  std::ofstream out(file);
  out << text;
  if (!out.flush()) throw InputError(file, "cannot write");
}

std::string data_of(const PlotSeries& series) {
  std::string text;
  for (std::size_t i = 0; i < series.y.size(); ++i) {
    const double x = series.x.empty() ? static_cast<double>(i) : series.x[i];
    if (std::isfinite(x) && std::isfinite(series.y[i])) {
      text += fmt::format("{:.9g} {:.9g}\n", x, series.y[i]);
    }
  }
  return text;
}

std::string first_line(const fs::path& file) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (line.find_first_not_of(" \t^") != std::string::npos) return line;
  }
  return "no message";
}

/// What the child process finds where this one has its standard streams.
class Redirections {
 public:
  explicit Redirections(const std::string& errors) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawn_file_actions_addopen(&actions_, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions_, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addopen(&actions_, STDERR_FILENO, errors.c_str(), O_WRONLY | O_CREAT,
                                     0600);
  }
  Redirections(const Redirections&) = delete;
  Redirections& operator=(const Redirections&) = delete;
  ~Redirections() { posix_spawn_file_actions_destroy(&actions_); }
  const posix_spawn_file_actions_t* get() const { return &actions_; }

 private:
  posix_spawn_file_actions_t actions_{};
};

void run_gnuplot(const fs::path& script, const fs::path& errors) {
  const Redirections streams(errors.string());
  std::string program = "gnuplot";
  std::string file = script.string();
  std::array<char*, 3> arguments{program.data(), file.data(), nullptr};
  pid_t child = 0;
  const int failed =
      posix_spawnp(&child, "gnuplot", streams.get(), nullptr, arguments.data(), environ);
  if (failed == ENOENT) {
    throw InputError("gnuplot", "is not installed, so no picture can be drawn",
                     "the Debian package gnuplot-nox");
  }
  if (failed != 0) {
    throw InputError("gnuplot", "cannot start: " + std::system_category().message(failed));
  }
  int status = 0;
  while (waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) throw InputError("gnuplot", "was lost");
  }
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    throw InputError("gnuplot", "failed: " + first_line(errors));
  }
}

}  // namespace

std::string plot_script(const Plot& plot) {
  std::string script = fmt::format(
      "set terminal pngcairo noenhanced size {},{} font 'sans,11'\n"
      "set output 'plot.png'\n"
      "set title {}\nset xlabel {}\nset ylabel {}\n"
      "set grid ytics\nset key {}\nset boxwidth 0.8 relative\n",
      plot.width_px, plot.height_px, quoted(plot.title), quoted(plot.x_label), quoted(plot.y_label),
      plot.series.size() > kColours.size() ? "outside right top" : "left top");
  if (plot.log_x) script += "set logscale x\n";
  if (plot.log_y) script += "set logscale y\n";
  if (!plot.x_names.empty()) {
    script += "set xtics rotate by -90 font ',8' (";
    for (std::size_t i = 0; i < plot.x_names.size(); ++i)
      script += fmt::format("{}{} {}", i == 0 ? "" : ", ", quoted(plot.x_names[i]), i);
    script += fmt::format(")\nset xrange [-1:{}]\n", plot.x_names.size());
  }
  script += "plot ";
  for (std::size_t i = 0; i < plot.series.size(); ++i) {
    const PlotSeries& s = plot.series[i];
    script += fmt::format("{}'series_{}.dat' using 1:2 with {}{} linecolor rgb '{}' title {}",
                          i == 0 ? "" : ", ", i, style_of(s.style),
                          dashes(s.style, i / kColours.size()), colour(i), quoted(s.label));
  }
  for (std::size_t i = 0; i < plot.levels.size(); ++i) {
    const PlotLevel& level = plot.levels[i];
    script += fmt::format(", {:.9g} with lines linewidth 1 dashtype {} linecolor rgb '{}' title {}",
                          level.y, i % 5 + 1, colour(level.series), quoted(level.label));
  }
  return script + "\n";
}

void write_plot(const Plot& plot, const fs::path& png) {
  check(plot);
  AtomicFile out(png);  // before the work: an unwritable place is known at once
  const TempFolder folder;
  for (std::size_t i = 0; i < plot.series.size(); ++i)
    write_text(folder / fmt::format("series_{}.dat", i), data_of(plot.series[i]));
  const fs::path script = folder / "plot.gp";
  write_text(script, "cd " + quoted(script.parent_path().string()) + "\n" + plot_script(plot));
  run_gnuplot(script, folder / "errors.txt");
  out.write(MappedFile(folder / "plot.png").bytes());
  out.commit();
}

}  // namespace brdfgate
