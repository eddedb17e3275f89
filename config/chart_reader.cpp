#include "config/chart_reader.hpp"

#include <iterator>

#include "config/yaml_reader.hpp"

namespace brdfgate {
namespace {

constexpr int kMostAcross = 100;

ChartPatch read_patch(const YamlNode& node, bool d50) {
  ChartPatch patch;
  patch.name = node.text("name");
  if (node.has("lab")) {
    const auto values = node.numbers("lab", 3, {-200, 200});
    const Lab lab(values.data());
    patch.xyz = d50 ? d50_to_d65(lab_d50_to_xyz(lab)) : lab_to_xyz(lab);
  } else {
    const auto values = node.numbers("xyz", 3, {0, 2});
    const Eigen::Array3d xyz(values.data());
    patch.xyz = d50 ? d50_to_d65(xyz) : xyz;
  }
  node.finish();
  return patch;
}

}  // namespace

ColourChart read_chart(const std::filesystem::path& file) {
  const YamlNode root = YamlNode::load_file(file);
  root.choice("schema", {"brdfgate.chart/1"});
  ColourChart chart;
  chart.name = root.text("name");
  const std::vector<std::string> illuminants{"D50", "D65"};
  chart.illuminant = illuminants[root.choice("illuminant", illuminants)];
  root.choice("observer_deg", {"2"});
  chart.columns = root.integer("columns", 1, kMostAcross);
  chart.rows = root.integer("rows", 1, kMostAcross);
  chart.pitch_m = root.number("pitch_mm", {0, 1000, true}) / 1000;
  chart.patch_m = root.number("patch_mm", {0, 1000, true}) / 1000;
  if (chart.patch_m > chart.pitch_m) {
    root.fail_at("patch_mm", "patches larger than their pitch", "at most pitch_mm");
  }
  const YamlNode patches = root.at("patches");
  for (const YamlNode& node : patches.items())
    chart.patches.push_back(read_patch(node, chart.illuminant == "D50"));
  if (std::ssize(chart.patches) != chart.columns * chart.rows) {
    patches.fail(std::to_string(chart.patches.size()) + " patches",
                 std::to_string(chart.columns * chart.rows) + ", columns times rows");
  }
  root.finish();
  return chart;
}

}  // namespace brdfgate
