// The station's angular bins: rings of theta_h on the MERL axis, cut into sectors of equal area.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <span>
#include <string>

#include "model/error.hpp"
#include "model/geometry.hpp"

namespace brdfgate {
namespace {

constexpr double kPi = std::numbers::pi;
/// Cells of the MERL axis of theta_h over 90 degrees; cell i ends at (i + 1)^2 / 90 degrees.
constexpr double kAxisCells = 90.0;
/// Sectors of equal area that one light's view is cut into away from the peak. The default station
/// then has 308 bins, of which a centred part of 80 x 80 mm fills 300: the ridge parameter 40 was
/// set for n = 298 rows and its result depends on n.
constexpr int kSectorsPerLight = 150;
/// No bin averages fewer cells than this: at the very peak several axis cells share a bin.
constexpr std::size_t kLeastCells = 16;

/// One cell of the image in the coordinates that the bins are cut in.
struct BinCell {
  float axis;     ///< theta_h in cells of the MERL axis
  float theta_d;  ///< rad
  float phi_d;    ///< rad
  int at;         ///< index of the pixel
};
using Cells = std::span<BinCell>;

/// Width of a ring in cells of the MERL axis: single cells where measured highlights are narrower
/// than a few degrees, wider outside, where lobes that still matter are wide themselves. At 2.8 deg
/// a ring spans 0.4 deg, at 10 deg 1.4 deg, at 40 deg 3.9 deg.
int ring_width(int axis) {
  if (axis < 16) return 1;
  return axis < 30 ? 2 : 3;
}

float axis_of(float theta_h) {
  return static_cast<float>(std::sqrt(std::max(0.0F, theta_h) / (kPi / 2)) * kAxisCells);
}

std::vector<BinCell> inspected_cells(const CellGeometry& cells, std::size_t light) {
  std::vector<BinCell> out;
  out.reserve(cells.inside.total());
  for (int v = 0; v < cells.inside.rows; ++v) {
    const auto* inside = cells.inside.ptr<unsigned char>(v);
    const auto* angles = cells.angles[light].ptr<cv::Vec3f>(v);
    for (int u = 0; u < cells.inside.cols; ++u) {
      if (!inside[u]) continue;
      out.push_back({axis_of(angles[u][0]), angles[u][1], angles[u][2], v * cells.inside.cols + u});
    }
  }
  return out;
}

/// Cells sorted by axis, split where a ring ends; rings of too few cells join the next one out, the
/// last of all the one before it.
std::vector<Cells> rings(std::vector<BinCell>& cells) {
  std::sort(cells.begin(), cells.end(), [](const BinCell& a, const BinCell& b) {
    return a.axis < b.axis || (a.axis == b.axis && a.at < b.at);
  });
  std::vector<Cells> out;
  std::size_t begin = 0;
  for (int edge = 0; begin < cells.size();) {
    edge += ring_width(edge);
    const auto end = static_cast<std::size_t>(
        std::partition_point(cells.begin() + static_cast<std::ptrdiff_t>(begin), cells.end(),
                             [edge](const BinCell& c) { return c.axis < float(edge); }) -
        cells.begin());
    const bool last = end == cells.size();
    if (end - begin < kLeastCells && !last) continue;
    if (end - begin < kLeastCells && !out.empty()) {
      out.back() = Cells(out.back().data(), out.back().size() + (end - begin));
    } else {
      out.push_back(Cells(cells).subspan(begin, end - begin));
    }
    begin = end;
  }
  return out;
}

/// One light's bins and the tree that finds them.
struct LightBins {
  std::vector<Cells> bins;
  std::vector<BinNode> tree;
};

/// Where to cut cells sorted by an angle: in a gap wider than `span` if there is one (two patches
/// far apart share no bin), else so that both sides' sectors get equal areas.
std::size_t cut_at(Cells cells, float BinCell::* angle, double span, int parts) {
  std::size_t widest = 0;
  float gap = static_cast<float>(span);
  for (std::size_t i = kLeastCells; i + kLeastCells <= cells.size(); ++i) {
    const float g = cells[i].*angle - cells[i - 1].*angle;
    if (g > gap) {
      gap = g;
      widest = i;
    }
  }
  if (widest > 0) return widest;
  return cells.size() * static_cast<std::size_t>(parts / 2) / static_cast<std::size_t>(parts);
}

float between(float below, float above) {
  return below + (above - below) / 2;
}

/// Cuts a ring into `parts` sectors of equal area: again and again across the angle that varies
/// most, measured in the spans over which reflectance hardly changes (3 deg of theta_d, 30 deg of
/// phi_d). phi_d is cut inside [0, pi), so no sector straddles its wrap.
void cut_sectors(Cells cells, int parts, LightBins& out) {
  if (parts <= 1 || cells.size() < 2 * kLeastCells) {
    out.tree.push_back({-1, 0, -1, static_cast<int>(out.bins.size())});
    out.bins.push_back(cells);
    return;
  }
  constexpr double kSpanD = 3.0 * kPi / 180.0;
  constexpr double kSpanP = 30.0 * kPi / 180.0;
  const auto extent = [&cells](float BinCell::* angle) {
    const auto [least, most] = std::minmax_element(
        cells.begin(), cells.end(),
        [angle](const BinCell& a, const BinCell& b) { return a.*angle < b.*angle; });
    return *most.*angle - *least.*angle;
  };
  const bool across_p = extent(&BinCell::phi_d) / kSpanP >= extent(&BinCell::theta_d) / kSpanD;
  float BinCell::* angle = across_p ? &BinCell::phi_d : &BinCell::theta_d;
  std::sort(cells.begin(), cells.end(), [angle](const BinCell& a, const BinCell& b) {
    return a.*angle < b.*angle || (a.*angle == b.*angle && a.at < b.at);
  });
  const std::size_t cut = cut_at(cells, angle, across_p ? kSpanP : kSpanD, parts);
  const double share = static_cast<double>(cut) / static_cast<double>(cells.size());
  const int first = std::clamp(static_cast<int>(std::lround(share * parts)), 1, parts - 1);
  const std::size_t node = out.tree.size();
  out.tree.push_back({across_p ? 2 : 1, between(cells[cut - 1].*angle, cells[cut].*angle), -1, -1});
  cut_sectors(cells.first(cut), first, out);
  out.tree[node].other = static_cast<int>(out.tree.size());
  cut_sectors(cells.subspan(cut), parts - first, out);
}

/// Mean angles; phi_d as the axial mean, through twice the angle, because 0 and pi are the same.
HalfDiff mean_angles(const CellGeometry& cells, std::size_t light, Cells bin) {
  HalfDiff mean;
  double cos2 = 0;
  double sin2 = 0;
  for (const BinCell& c : bin) {
    const auto& a =
        cells.angles[light].at<cv::Vec3f>(c.at / cells.inside.cols, c.at % cells.inside.cols);
    mean.theta_h += a[0];
    mean.theta_d += a[1];
    cos2 += std::cos(2.0 * a[2]);
    sin2 += std::sin(2.0 * a[2]);
  }
  const double n = static_cast<double>(bin.size());
  mean.theta_h /= n;
  mean.theta_d /= n;
  mean.phi_d = 0.5 * std::atan2(sin2, cos2);
  if (mean.phi_d < 0) mean.phi_d += kPi;
  return mean;
}

/// The bins of all cells of one light, by rising theta_h.
LightBins cut_light(std::vector<BinCell>& all) {
  const double sector =
      std::max(double(kLeastCells), static_cast<double>(all.size()) / kSectorsPerLight);
  LightBins out;
  const std::vector<Cells> ring = rings(all);
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const std::size_t node = out.tree.size();
    const bool last = i + 1 == ring.size();
    if (!last) {
      // Cutting a ring sorts it anew, so its edge is taken before.
      const auto by_axis = [](const BinCell& a, const BinCell& b) { return a.axis < b.axis; };
      const float most = std::max_element(ring[i].begin(), ring[i].end(), by_axis)->axis;
      const float least = std::min_element(ring[i + 1].begin(), ring[i + 1].end(), by_axis)->axis;
      out.tree.push_back({0, between(most, least), -1, -1});
    }
    cut_sectors(ring[i],
                std::max(1, static_cast<int>(std::lround(double(ring[i].size()) / sector))), out);
    if (!last) out.tree[node].other = static_cast<int>(out.tree.size());
  }
  return out;
}

void add_light(const CellGeometry& cells, std::size_t light, BinMap& map) {
  std::vector<BinCell> all = inspected_cells(cells, light);
  LightBins cut = cut_light(all);
  const int first = map.bins();
  for (BinNode& node : cut.tree) {
    if (node.axis < 0) node.bin += first;
  }
  cv::Mat id(cells.inside.size(), CV_32SC1, cv::Scalar(-1));
  for (const Cells& bin : cut.bins) {
    for (const BinCell& c : bin)
      id.at<int>(c.at / id.cols, c.at % id.cols) = map.bins();
    map.mean_angles.push_back(mean_angles(cells, light, bin));
    map.light.push_back(static_cast<int>(light) + 1);
  }
  map.id.push_back(id);
  map.trees.push_back(std::move(cut.tree));
}

}  // namespace

BinMap make_bin_map(const CellGeometry& cells) {
  if (cells.angles.empty() || cells.inside.empty()) {
    throw InputError("bin map", "no light or no cell in the station's geometry",
                     "the geometry of at least one light");
  }
  BinMap map;
  for (std::size_t light = 0; light < cells.angles.size(); ++light)
    add_light(cells, light, map);
  return map;
}

int BinMap::find(std::size_t from_light, const cv::Vec3f& angles) const {
  const std::vector<BinNode>& tree = trees[from_light];
  const float value[] = {axis_of(angles[0]), angles[1], angles[2]};
  std::size_t at = 0;
  while (tree[at].axis >= 0) {
    const BinNode& node = tree[at];
    at = value[node.axis] < node.edge ? at + 1 : static_cast<std::size_t>(node.other);
  }
  return tree[at].bin;
}

}  // namespace brdfgate
