#include <cstdlib>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "app/plot.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

Plot small_plot() {
  Plot plot;
  plot.title = "Errors";
  plot.x_names = {"chrome", "it's `touch pwned`", "white \"fabric\"\n"};
  plot.series = {{"ridge", {}, {0.1, std::numeric_limits<double>::quiet_NaN(), 0.3}},
                 {"other", {}, {0.1, 0.2, 0.2}, PlotSeries::Style::LinesPoints}};
  plot.levels = {{"mean", 0.2, 0}};
  plot.width_px = 640;
  plot.height_px = 480;
  return plot;
}

/// PATH for the life of the object.
struct Path {
  explicit Path(const std::string& value) : before(std::getenv("PATH")) {
    setenv("PATH", value.c_str(), 1);
  }
  ~Path() { setenv("PATH", before.c_str(), 1); }
  std::string before;
};

/// Only files that are not half-written ones.
std::size_t files_in(const TempDir& dir) {
  return static_cast<std::size_t>(
      std::distance(std::filesystem::directory_iterator(dir.path()), {}));
}

}  // namespace

TEST_CASE("A plot becomes a PNG of its size with something on it") {
  const TempDir dir;
  write_plot(small_plot(), dir / "it's.png");
  const cv::Mat image = cv::imread((dir / "it's.png").string());
  CHECK(image.size() == cv::Size(640, 480));
  const cv::Scalar mean = cv::mean(image);
  CHECK(mean[0] < 254);
  CHECK(mean[0] > 100);
  CHECK(files_in(dir) == 1);
}

TEST_CASE("Names cannot become commands of the plotting program") {
  const std::string script = plot_script(small_plot());
  CHECK(contains(script, "'it''s `touch pwned`'"));
  CHECK(contains(script, "'white \"fabric\" '"));
  CHECK_FALSE(contains(script, "\"touch"));
}

TEST_CASE("More lines than colours are dashed, their legend beside the plot") {
  Plot plot = small_plot();
  const std::string few = plot_script(plot);
  CHECK(contains(few, "set key left top"));
  plot.series.assign(7, plot.series[1]);
  const std::string many = plot_script(plot);
  CHECK(contains(many, "set key outside right top"));
  const std::size_t seventh = many.find("'series_6.dat'");
  REQUIRE(seventh != std::string::npos);
  CHECK(many.find("dashtype 2") > seventh);
  CHECK(contains(many.substr(seventh), "pointtype 7 dashtype 2"));
}

TEST_CASE("Without gnuplot there is one clear error and no file") {
  const TempDir dir;
  const Path nowhere(dir.path().string());
  const std::string error = input_error([&] { write_plot(small_plot(), dir / "a.png"); });
  CHECK(contains(error, "gnuplot"));
  CHECK(contains(error, "gnuplot-nox"));
  CHECK(files_in(dir) == 0);
}

TEST_CASE("A failing gnuplot is reported with its own words") {
  const TempDir bin;
  const TempDir dir;
  const auto fake = bin.write("gnuplot", "#!/bin/sh\necho 'no such terminal' >&2\nexit 1\n");
  std::filesystem::permissions(fake, std::filesystem::perms::owner_all);
  const Path first(bin.path().string());
  CHECK(
      contains(input_error([&] { write_plot(small_plot(), dir / "a.png"); }), "no such terminal"));
  CHECK(files_in(dir) == 0);
}

TEST_CASE("Plots without points, or with x and y of different lengths, are refused") {
  const TempDir dir;
  Plot plot = small_plot();
  plot.series[1].x = {1, 2};
  CHECK(contains(input_error([&] { write_plot(plot, dir / "a.png"); }), "2 x for 3 y"));
  plot.series.clear();
  CHECK(contains(input_error([&] { write_plot(plot, dir / "a.png"); }), "nothing to draw"));
  CHECK(
      contains(input_error([&] { write_plot(small_plot(), dir / "no/where.png"); }), "where.png"));
}
