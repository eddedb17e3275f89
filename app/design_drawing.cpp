#include "app/design_drawing.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace brdfgate {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
/// Page and views, mm.
constexpr double kPageWidth = 297, kPageHeight = 210, kMargin = 10;
constexpr double kViewWidth = 133, kViewTop = 30, kSideHeight = 84, kTopHeight = 106;
constexpr double kRow = 5.5;
constexpr const char* kThin = R"(stroke="#555" stroke-width="0.2")";
constexpr const char* kAxis = R"(stroke="#999" stroke-width="0.2" stroke-dasharray="4 1 1 1")";
constexpr const char* kCone = R"(stroke="#1f4e9c" stroke-width="0.12")";
constexpr const char* kCameraColour = "#1f4e9c";
constexpr const char* kLightColour = "#b85c00";

struct Point {
  double x = 0, y = 0;
};

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else {
      out += c;
    }
  }
  return out;
}

std::string line(Point a, Point b, const std::string& style) {
  return fmt::format(R"(<line x1="{:.2f}" y1="{:.2f}" x2="{:.2f}" y2="{:.2f}" {}/>)"
                     "\n",
                     a.x, a.y, b.x, b.y, style);
}

std::string circle(Point at, double radius, const std::string& style) {
  return fmt::format(R"(<circle cx="{:.2f}" cy="{:.2f}" r="{:.2f}" {}/>)"
                     "\n",
                     at.x, at.y, radius, style);
}

std::string text(Point at, const std::string& words, const std::string& style = "") {
  return fmt::format(R"(<text x="{:.2f}" y="{:.2f}" {}>{}</text>)"
                     "\n",
                     at.x, at.y, style, escaped(words));
}

/// Arc around `centre` between two mathematical angles (radians, y up), less than half a turn.
std::string arc(Point centre, double radius, double from, double to) {
  const Point a{centre.x + radius * std::cos(from), centre.y - radius * std::sin(from)};
  const Point b{centre.x + radius * std::cos(to), centre.y - radius * std::sin(to)};
  return fmt::format(
      R"(<path d="M {:.2f} {:.2f} A {:.2f} {:.2f} 0 0 {} {:.2f} {:.2f}" stroke="#555" stroke-width="0.2" fill="none"/>)"
      "\n",
      a.x, a.y, radius, radius, to > from ? 0 : 1, b.x, b.y);
}

const char* colour(const RigPart& part) {
  return part.camera ? kCameraColour : kLightColour;
}

/// Where the parts are, mm; directional lights beyond everything else.
class Scene {
 public:
  explicit Scene(const RigDrawing& drawing) : drawing_(drawing) {
    for (const RigPart& part : drawing.parts)
      reach_ = std::max(reach_, 1e3 * part.distance_m);
    if (!(reach_ > 0)) reach_ = 100;
    const bool directional = std::any_of(drawing.parts.begin(), drawing.parts.end(),
                                         [](const RigPart& p) { return !(p.distance_m > 0); });
    if (directional) reach_ *= 1.3;
    reach_ = std::max(reach_, 1e3 * drawing.disc_radius_m);
    // Half a view's width or the whole side view's height, less room for the labels.
    constexpr double kRoom = 46;
    const double least = reach_ / kRoom;
    const std::array<double, 12> scales{1, 1.5, 2, 2.5, 3, 4, 5, 7.5, 10, 15, 20, 50};
    const auto found = std::lower_bound(scales.begin(), scales.end(), least);
    scale_ = found != scales.end() ? *found : std::ceil(least);
  }

  double scale() const { return scale_; }
  double mm(const RigPart& part) const {
    return part.distance_m > 0 ? 1e3 * part.distance_m : reach_;
  }
  Eigen::Vector3d on_paper(const RigPart& part) const { return mm(part) / scale_ * part.at.unit(); }
  double disc() const { return 1e3 * drawing_.disc_radius_m / scale_; }

 private:
  const RigDrawing& drawing_;
  double reach_ = 0;
  double scale_ = 1;
};

/// Camera or lamp at a point, and its label outside of it, away from `centre`.
std::string symbol(const RigPart& part, Point at, Point centre, const std::string& words) {
  constexpr double kLabelGap = 5;
  const double length = std::max(std::hypot(at.x - centre.x, at.y - centre.y), 1e-6);
  const Point out{(at.x - centre.x) / length, (at.y - centre.y) / length};
  std::string svg;
  if (part.camera) {
    constexpr double kHalf = 2.5;
    const Point a{kHalf * (out.x - out.y), kHalf * (out.y + out.x)};
    svg += fmt::format(
        R"svg(<polygon points="{:.2f},{:.2f} {:.2f},{:.2f} {:.2f},{:.2f} {:.2f},{:.2f}" fill="{}"/>)svg"
        "\n",
        at.x + a.x, at.y + a.y, at.x - a.y, at.y + a.x, at.x - a.x, at.y - a.y, at.x + a.y,
        at.y - a.x, colour(part));
  } else {
    svg += circle(at, 2.3, fmt::format(R"(fill="{}")", colour(part)));
  }
  const Point label{at.x + kLabelGap * out.x, at.y + kLabelGap * out.y + 1.2};
  constexpr double kSteep = 0.35;
  const char* anchor = std::abs(out.x) < kSteep ? "middle" : (out.x > 0 ? "start" : "end");
  return svg +
         text(label, words, fmt::format(R"(fill="{}" text-anchor="{}")", colour(part), anchor));
}

bool in_side_plane(const RigPart& part) {
  constexpr double kTwoDegrees = 0.035;
  return std::abs(std::sin(part.at.phi) * std::sin(part.at.theta)) < kTwoDegrees;
}

std::string ray_style(const RigPart& part) {
  return fmt::format(R"(stroke="{}" stroke-width="0.25"{})", colour(part),
                     part.camera ? "" : R"( stroke-dasharray="2 1")");
}

std::string side_view(const Scene& scene, const RigDrawing& drawing) {
  const Point centre{kMargin + kViewWidth / 2, kViewTop + kSideHeight};
  std::string svg =
      text({kMargin, kViewTop - 2}, "Side view (x to the right, z up)", R"(font-weight="bold")");
  svg += line({kMargin, centre.y}, {kMargin + kViewWidth, centre.y}, kThin);
  svg += line(centre, {centre.x, kViewTop + 16}, kAxis);
  svg += text({centre.x + 1, kViewTop + 18}, "normal");
  svg += line({centre.x - scene.disc(), centre.y}, {centre.x + scene.disc(), centre.y},
              "stroke=\"#000\" stroke-width=\"1.2\"");
  double arc_radius = 13;
  for (const RigPart& part : drawing.parts) {
    const Eigen::Vector3d p = scene.on_paper(part);
    const Point at{centre.x + p.x(), centre.y - p.z()};
    svg += line(centre, at, ray_style(part));
    if (part.camera) {
      for (const double edge : {-scene.disc(), scene.disc()})
        svg += line({centre.x + edge, centre.y}, at, kCone);
    }
    std::string words = fmt::format("{} {:.0f}°", part.label, part.at.theta * kDegrees);
    if (in_side_plane(part)) {
      constexpr double kUp = std::numbers::pi / 2;
      if (part.at.theta > 0.02) {
        svg += arc(centre, arc_radius, kUp, kUp - std::copysign(part.at.theta, p.x()));
        arc_radius += 5;
      }
    } else {
      words += " (seen askew)";
    }
    svg += symbol(part, at, centre, words);
  }
  return svg;
}

std::string top_view(const Scene& scene, const RigDrawing& drawing) {
  const Point centre{kPageWidth - kMargin - kViewWidth / 2, kViewTop + kTopHeight / 2};
  std::string svg = text({kPageWidth - kMargin - kViewWidth, kViewTop - 2},
                         "Top view (x to the right, y up)", R"(font-weight="bold")");
  svg += line({centre.x - kViewWidth / 2, centre.y}, {centre.x + kViewWidth / 2, centre.y}, kAxis);
  svg += line({centre.x, kViewTop}, {centre.x, kViewTop + kTopHeight}, kAxis);
  svg += circle(centre, scene.disc(), R"(fill="#ddd" stroke="#000" stroke-width="0.3")");
  double arc_radius = 13;
  for (const RigPart& part : drawing.parts) {
    const Eigen::Vector3d p = scene.on_paper(part);
    const Point at{centre.x + p.x(), centre.y - p.y()};
    svg += line(centre, at, ray_style(part));
    const double azimuth = std::remainder(part.at.phi, 2 * std::numbers::pi);
    constexpr double kSome = 0.02;
    if (std::abs(azimuth) > kSome && std::abs(azimuth) < std::numbers::pi - kSome) {
      svg += arc(centre, arc_radius, 0, azimuth);
      arc_radius += 5;
    }
    svg += symbol(part, at, centre, fmt::format("{} az {:.0f}°", part.label, azimuth * kDegrees));
  }
  return svg;
}

std::string table(const Scene& scene, const RigDrawing& drawing) {
  const std::array<double, 8> columns{10, 45, 75, 105, 137, 160, 183, 206};
  const std::array<const char*, 8> heads{"",     "from normal", "azimuth", "distance mm",
                                         "x mm", "y mm",        "z mm",    ""};
  double y = kPageHeight - kMargin - 6 - kRow * static_cast<double>(drawing.parts.size());
  std::string svg;
  for (std::size_t i = 0; i < columns.size(); ++i)
    svg += text({columns[i], y}, heads[i], R"(font-weight="bold")");
  svg += line({kMargin, y + 1.5}, {kPageWidth - kMargin, y + 1.5}, kThin);
  for (const RigPart& part : drawing.parts) {
    y += kRow;
    const bool placed = part.distance_m > 0;
    const Eigen::Vector3d p = scene.mm(part) * part.at.unit();
    const auto length = [&](double v) { return placed ? fmt::format("{:.1f}", v + 0.0) : "-"; };
    const double azimuth = std::remainder(part.at.phi, 2 * std::numbers::pi) * kDegrees;
    const std::array<std::string, 8> cells{
        part.label,
        fmt::format("{:.1f}°", part.at.theta * kDegrees),
        fmt::format("{:.1f}°", azimuth),
        placed ? fmt::format("{:.1f}", scene.mm(part)) : "parallel light",
        length(p.x()),
        length(p.y()),
        length(p.z()),
        part.note};
    for (std::size_t i = 0; i < columns.size(); ++i)
      svg += text({columns[i], y}, cells[i]);
  }
  return svg;
}

}  // namespace

std::string draw_rig_svg(const RigDrawing& drawing) {
  const Scene scene(drawing);
  std::string svg = fmt::format(
      R"(<svg xmlns="http://www.w3.org/2000/svg" width="{0}mm" height="{1}mm" viewBox="0 0 {0} {1}" font-family="sans-serif" font-size="3.3" stroke="none">
<rect width="{0}" height="{1}" fill="#fff"/>
)",
      kPageWidth, kPageHeight);
  svg += text({kMargin, 13}, drawing.title, R"(font-size="5" font-weight="bold")");
  svg += text({kMargin, 19}, drawing.note);
  svg += side_view(scene, drawing) + top_view(scene, drawing) + table(scene, drawing);
  svg +=
      text({kMargin, kPageHeight - kMargin + 2},
           fmt::format("Scale 1:{:g} in both views. Angles from the sample's normal; azimuth from "
                       "x, toward y. Origin: centre of the sample. Field of view {:.1f}°, "
                       "measured disc {:.1f} mm across.",
                       scene.scale(), drawing.fov * kDegrees, 2e3 * drawing.disc_radius_m));
  return svg + "</svg>\n";
}

}  // namespace brdfgate
