#include "app/calibration_report.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "app/html_page.hpp"
#include "app/plot.hpp"
#include "app/result_json.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

/// What the colours of a map span, of its middle value.
constexpr double kUniformitySpan = 0.5;
constexpr double kResidualSpan = 0.02;
constexpr int kTile = 32;  // pixels; the noise curve has a point per tile

/// Mean of the channels over its own median, less 1; NaN where masked.
cv::Mat1f evenness(const Radiance& white) {
  cv::Mat1f level(white.value.size(), 0);
  std::vector<cv::Mat> channels;
  cv::split(white.value, channels);
  for (const cv::Mat& channel : channels)
    level += channel;
  std::vector<float> good;
  for (int y = 0; y < level.rows; ++y) {
    for (int x = 0; x < level.cols; ++x)
      if (white.mask.at<unsigned char>(y, x) == 0) good.push_back(level(y, x));
  }
  if (good.empty()) return cv::Mat1f(level.size(), NAN);
  const auto middle = good.begin() + static_cast<std::ptrdiff_t>(good.size() / 2);
  std::nth_element(good.begin(), middle, good.end());
  level = level / *middle - 1;
  level.setTo(NAN, white.mask != 0);
  return level;
}

std::string white_pictures(const Calibration& c) {
  std::string out;
  for (std::size_t l = 0; l < c.white.size(); ++l) {
    cv::Mat map;
    const cv::Mat full = diverging(evenness(c.white[l]), kUniformitySpan);
    cv::resize(full, map, {}, 0.5, 0.5, cv::INTER_AREA);
    out += image_tag(png_of(map),
                     fmt::format("White reference under light {}: blue {:.0f} % darker than the "
                                 "median, red {:.0f} % brighter, black masked",
                                 l + 1, 100 * kUniformitySpan, 100 * kUniformitySpan));
  }
  return out;
}

std::string residual_pictures(const GeometryResult& found) {
  std::string out;
  if (!found.lights) return out;
  for (std::size_t l = 0; l < found.lights->residuals.size(); ++l) {
    cv::Mat map;
    cv::resize(diverging(found.lights->residuals[l], kResidualSpan), map, {}, 12, 12,
               cv::INTER_NEAREST);
    out += image_tag(
        png_of(map),
        fmt::format("Light {}: seen over fitted falloff, ln; full colour is {:.0f} %, rms {:.3f} %",
                    l + 1, 100 * kResidualSpan, 100 * found.lights->lights[l].rms));
  }
  return out;
}

std::string reprojection_picture(const GeometryResult& found) {
  if (!found.camera) return {};
  Plot plot;
  plot.title = fmt::format("Reprojection errors, {:.3f} px rms", found.camera->rms_px);
  plot.x_label = "x, sensor pixels";
  plot.y_label = "y, sensor pixels";
  plot.width_px = 800;
  plot.height_px = 700;
  for (std::size_t v = 0; v < found.camera->errors_px.size(); ++v) {
    PlotSeries series;
    series.label = fmt::format("board {}: {:.3f} px", v + 1, found.camera->view_rms_px[v]);
    for (const Eigen::Vector2d& e : found.camera->errors_px[v]) {
      series.x.push_back(e.x());
      series.y.push_back(e.y());
    }
    plot.series.push_back(std::move(series));
  }
  return image_tag(png_of(plot),
                   "Where each corner of the boards was seen, less where the fitted "
                   "camera has it");
}

PlotSeries noise_line(const Calibration& c, double most_dn) {
  PlotSeries line;
  line.label = fmt::format("{:.4f} DN per electron, read noise {:.2f} DN", c.noise.gain_dn_per_e,
                           c.noise.read_noise_dn);
  line.style = PlotSeries::Style::Lines;
  for (double mean = std::max(1.0, most_dn / 500); mean <= most_dn; mean *= 1.1) {
    line.x.push_back(mean);
    line.y.push_back(c.noise.gain_dn_per_e * mean + c.noise.read_noise_dn * c.noise.read_noise_dn +
                     1.0 / 12);
  }
  return line;
}

/// Mean and variance of one tile of two equal frames; nothing where it is near either end.
void add_tile(const cv::Mat1f& a, const cv::Mat1f& b, const SensorFormat& sensor,
              PlotSeries& into) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(a - b, mean, deviation);
  const double level = (cv::mean(a)[0] + cv::mean(b)[0]) / 2 - sensor.black_level_dn;
  double top = 0;
  cv::minMaxLoc(cv::max(a, b), nullptr, &top);
  if (level < 1 || top >= sensor.full_well_dn) return;
  into.x.push_back(level);
  into.y.push_back(deviation[0] * deviation[0] / 2);
}

/// From the first two whites, tile by tile, frame by frame.
PlotSeries white_tiles(const CalibrationRecordings& from, const SensorFormat& sensor) {
  PlotSeries points;
  points.label = "tiles of two white recordings";
  if (from.levels.whites.size() < 2) return points;
  const auto& frames = from.levels.whites[0].frames;
  const auto& others = from.levels.whites[1].frames;
  for (std::size_t i = 0; i < std::min(frames.size(), others.size()); ++i) {
    if (frames[i].light == kNoLight || frames[i].exposure_s != others[i].exposure_s) continue;
    cv::Mat1f a, b;
    frames[i].counts.convertTo(a, CV_32F);
    others[i].counts.convertTo(b, CV_32F);
    for (int y = kTile; y + 2 * kTile <= a.rows; y += 4 * kTile) {
      for (int x = kTile; x + 2 * kTile <= a.cols; x += 4 * kTile) {
        const cv::Rect tile(x, y, kTile, kTile);
        add_tile(a(tile), b(tile), sensor, points);
      }
    }
  }
  return points;
}

std::string noise_picture(const CalibrationOutcome& outcome, const CalibrationRecordings& from) {
  const Calibration& c = outcome.calibration;
  PlotSeries points;
  if (outcome.sweep) {
    points.label = "photon-transfer sweep";
    for (const SweepPoint& p : outcome.sweep->points) {
      points.x.push_back(p.mean_dn);
      points.y.push_back(p.variance_dn2);
    }
  } else {
    points = white_tiles(from, c.sensor);
  }
  if (points.y.empty()) return {};
  Plot plot;
  plot.title = "Noise curve";
  plot.x_label = "mean over black, DN";
  plot.y_label = "temporal variance, DN^2";
  plot.log_x = plot.log_y = true;
  plot.width_px = 900;
  plot.height_px = 600;
  plot.series = {std::move(points), noise_line(c, c.sensor.full_well_dn - c.sensor.black_level_dn)};
  return image_tag(png_of(plot), "Photon transfer: the variance grows with the signal by the gain");
}

std::string response_picture(const Calibration& c) {
  if (c.response.empty()) return {};
  static constexpr std::array<const char*, 3> kNames{"red", "green", "blue"};
  Plot plot;
  plot.title = "Tone curve";
  plot.x_label = "count";
  plot.y_label = "radiance times exposure, DN of a linear camera";
  plot.log_y = true;
  plot.width_px = 900;
  plot.height_px = 600;
  for (std::size_t ch = 0; ch < c.response.size(); ++ch) {
    const ToneCurve& curve = c.response[ch];
    PlotSeries series;
    series.style = PlotSeries::Style::Lines;
    series.label = c.response.size() == 1 ? "mono" : kNames[ch % 3];
    for (int z = curve.least; z <= curve.most; ++z) {
      series.x.push_back(z);
      series.y.push_back(std::exp(curve.log_x[static_cast<std::size_t>(z)]));
    }
    plot.series.push_back(std::move(series));
  }
  return image_tag(png_of(plot), "The response that was recovered from the bracket");
}

std::string place_text(const Eigen::Vector3d& p, const PlaceQuality& quality) {
  if (quality.source == GeometrySource::nominal) return "as configured, not calibrated";
  return fmt::format("{:.2f}, {:.2f}, {:.2f} mm, +- {:.2f} mm, {}", 1e3 * p.x(), 1e3 * p.y(),
                     1e3 * p.z(), 1e3 * quality.sigma_m,
                     quality.source == GeometrySource::by_hand ? "by hand" : "fitted");
}

std::string sensor_rows(const CalibrationOutcome& outcome) {
  const Calibration& c = outcome.calibration;
  std::string out = fact_row("black level", fmt::format("{:.2f} DN", c.sensor.black_level_dn)) +
                    fact_row("full well", fmt::format("{:.0f} DN", c.sensor.full_well_dn));
  if (!c.response.empty()) return out + fact_row("response", "tone curve, from a recorded bracket");
  out += fact_row("read noise", fmt::format("{:.3f} DN", c.noise.read_noise_dn)) +
         fact_row("gain", fmt::format("{:.4f} DN per electron", c.noise.gain_dn_per_e));
  if (outcome.sweep) {
    out += fact_row("saturation", fmt::format("{:.0f} electrons", outcome.sweep->saturation_e)) +
           fact_row("linearity error", fmt::format("{:.2f} %", outcome.sweep->linearity_percent));
  }
  return out;
}

std::string figures(const CalibrationOutcome& outcome) {
  const Calibration& c = outcome.calibration;
  const std::array<double, 3>& w = c.white_reflectance;
  std::string out = "<table>\n" + fact_row("made", c.created) + fact_row("hash", c.hash) +
                    fact_row("station", c.station_hash) +
                    fact_row("white reference", fmt::format("{} {} {}", w[0], w[1], w[2]));
  if (!c.certificate.number.empty() || !c.certificate.due.empty()) {
    out += fact_row("certificate",
                    c.certificate.number + ", " + c.certificate.date + " to " + c.certificate.due);
  }
  if (outcome.days_until_due)
    out += fact_row("due", fmt::format("in {} days", *outcome.days_until_due));
  out += sensor_rows(outcome);
  out += fact_row("camera", place_text(c.geometry.camera.position(), c.quality.camera));
  for (std::size_t l = 0; l < c.geometry.lights_W.size(); ++l) {
    const PlaceQuality quality = l < c.quality.lights.size() ? c.quality.lights[l] : PlaceQuality{};
    out += fact_row(fmt::format("light {}", l + 1), place_text(c.geometry.lights_W[l], quality));
  }
  if (c.colour) {
    out +=
        fact_row("colour", fmt::format("{}: residual {:.2f} CIEDE2000 mean, {:.2f} max",
                                       c.colour->chart, c.colour->de00_mean, c.colour->de00_max));
  }
  for (std::size_t l = 0; l < outcome.drift.size(); ++l)
    out += fact_row(fmt::format("light {} since the last calibration", l + 1),
                    fmt::format("{:+.2f} %", 100 * outcome.drift[l]));
  for (std::size_t l = 0; l < c.stray_share.size(); ++l)
    out += fact_row(fmt::format("black gauge under light {}", l + 1),
                    fmt::format("{:.3f} % of white", 100 * c.stray_share[l]));
  return out + "</table>\n";
}

constexpr const char* kStyle =
    "body{font-family:sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}"
    "th{text-align:left;padding-right:2em;font-weight:normal;color:#555}"
    "td{font-family:monospace}figure{display:inline-block;margin:1em 1em 1em 0}"
    "img{max-width:100%}figcaption{color:#555;max-width:45em}.warning{color:#a00}";

}  // namespace

void write_calibration_report(const std::filesystem::path& file, const CalibrationOutcome& outcome,
                              const CalibrationRecordings& from) {
  std::string page = "<h1>Calibration report</h1>\n";
  for (const std::string& warning : outcome.warnings)
    page += fmt::format("<p class=\"warning\">{}</p>\n", html_text(warning));
  page += figures(outcome);
  page += "<h2>White reference</h2>\n" + white_pictures(outcome.calibration);
  page += "<h2>Noise</h2>\n" + response_picture(outcome.calibration) +
          (outcome.calibration.response.empty() ? noise_picture(outcome, from) : std::string());
  if (outcome.geometry.camera) page += "<h2>Camera</h2>\n" + reprojection_picture(outcome.geometry);
  if (outcome.geometry.lights) page += "<h2>Lights</h2>\n" + residual_pictures(outcome.geometry);
  write_text_file(file, html_page("Calibration " + outcome.calibration.created, kStyle, page));
}

}  // namespace brdfgate
