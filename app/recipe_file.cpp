#include "app/recipe_file.hpp"

#include <Eigen/Cholesky>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "app/defect_yaml.hpp"
#include "app/result_json.hpp"
#include "config/judge_yaml.hpp"
#include "config/rules_yaml.hpp"
#include "config/yaml_reader.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

constexpr const char* kSchema = "brdfgate.recipe/2";
/// The PLC publishes eight clusters; its recipe numbers are 16 bits.
constexpr std::size_t kMaxClusters = 8;
constexpr int kMaxId = 65535;
constexpr int kMaxParts = 100000;
constexpr int kMaxComponents = 1000;
constexpr int kMaxBinId = 10'000'000;

/// theta_h, theta_d, phi_d in columns.
Eigen::MatrixXd angles_of(const BinFrame& frame) {
  Eigen::MatrixXd angles(std::ssize(frame.directions), 3);
  for (Index j = 0; j < angles.rows(); ++j) {
    const HalfDiff& a = frame.directions[static_cast<std::size_t>(j)];
    angles.row(j) << a.theta_h, a.theta_d, a.phi_d;
  }
  return angles;
}

/// The look in steps of 1/8192 (ln units) as CV_16SC1, kNothingSeen where nothing was.
constexpr double kLookSteps = 8192;
constexpr std::int16_t kNothingSeen = -32768;

cv::Mat packed_look(const TaughtLayout& layout) {
  cv::Mat packed;
  layout.look.convertTo(packed, CV_16S, kLookSteps);
  packed.setTo(kNothingSeen, layout.seen == 0);
  return packed;
}

// ---- writing

/// Nine digits: far under any measurement's noise, and readable.
std::string measured_text(double value) {
  if (!std::isfinite(value)) throw InputError("recipe", "holds a number that is not finite");
  std::array<char, 40> text{};
  const auto end =
      std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general, 9)
          .ptr;
  return {text.data(), end};
}

class Writer {
 public:
  std::string recipe(const Recipe& r) {
    out_ << YAML::BeginMap;
    put("schema", kSchema);
    put("id", std::to_string(r.id));
    quoted("name", r.name);
    quoted("created", r.created);
    put("parts", std::to_string(r.parts));
    quoted("calibration_hash", r.calibration_hash);
    quoted("basis_checksum", r.basis_checksum);
    put("channels", std::to_string(r.channels));
    put("components", std::to_string(r.components));
    if (r.part_height_mm != 0) put("part_height_mm", number_text(r.part_height_mm));
    key("warnings") << YAML::BeginSeq;
    for (const std::string& warning : r.warnings)
      out_ << YAML::DoubleQuoted << warning;
    out_ << YAML::EndSeq;
    settings(r.settings);
    if (!r.rules.rules.empty()) {
      key("rules");
      write_rule_set(out_, r.rules, r.clusters);
    }
    if (!r.layout.empty()) layout(r.layout);
    key("clusters") << YAML::BeginSeq;
    for (const TaughtCluster& taught : r.clusters)
      cluster(taught);
    out_ << YAML::EndSeq;
    if (r.defects.parts > 0) {
      key("defects");
      write_defect_reference(out_, r.defects);
    }
    out_ << YAML::EndMap;
    if (!out_.good())
      throw InputError("recipe", "cannot be written as YAML: " + out_.GetLastError());
    return std::string(out_.c_str()) + "\n";
  }

 private:
  YAML::Emitter& key(const char* name) { return out_ << YAML::Key << name << YAML::Value; }
  void put(const char* name, const std::string& plain) { key(name) << plain; }
  void quoted(const char* name, const std::string& text) {
    key(name) << YAML::DoubleQuoted << text;
  }

  void settings(const JudgeSettings& s) {
    key("settings") << YAML::BeginMap;
    for (const auto& [name, value] : judge_settings_text(s))
      put(name.c_str(), value);
    out_ << YAML::EndMap;
  }

  void layout(const TaughtLayout& l) {
    key("layout") << YAML::BeginMap;
    put("pitch_m", measured_text(l.pitch_m));
    put("side", std::to_string(l.label.cols));
    row("taught_shift_m", l.taught.shift_m);
    put("taught_rotation_rad", measured_text(l.taught.rotation));
    const cv::Mat label = l.label.isContinuous() ? l.label : l.label.clone();
    base64("label", label.data, label.total());
    const cv::Mat look = packed_look(l);
    base64("look", look.data, look.total() * look.elemSize());
    out_ << YAML::EndMap;
  }

  void base64(const char* name, const unsigned char* bytes, std::size_t size) {
    static_assert(std::endian::native == std::endian::little);
    key(name) << YAML::DoubleQuoted << YAML::EncodeBase64(bytes, size);
  }

  void cluster(const TaughtCluster& c) {
    out_ << YAML::BeginMap;
    quoted("name", c.name);
    put("parts", std::to_string(c.parts));
    matrix("mean", c.mean);
    directions(c.directions);
    row("monitored_mean", c.monitored_mean);
    matrix("monitored_covariance", c.monitored_covariance);
    put("t2_limit", measured_text(c.t2_limit));
    key("bin_id") << YAML::Flow << c.bin_id;
    matrix("bin_residual", c.bin_residual);
    matrix("bin_residual_sigma", c.bin_residual_sigma);
    put("spe_limit", measured_text(c.spe_limit));
    put("area_share", measured_text(c.area_share));
    row("gloss_gu", Eigen::Map<const Eigen::Vector3d>(c.gloss_gu.data()));
    row("lab", c.lab.matrix());
    out_ << YAML::EndMap;
  }

  void directions(const MonitoredDirections& d) {
    key("directions") << YAML::BeginMap;
    key("names") << YAML::Flow << YAML::BeginSeq;
    for (const std::string& name : d.names)
      out_ << YAML::DoubleQuoted << name;
    out_ << YAML::EndSeq;
    key("bin_id") << YAML::Flow << d.frame.id;
    key("light") << YAML::Flow << d.frame.light;
    binary("angles", angles_of(d.frame));
    binary("reference", d.reference);
    binary("weight", d.weight);
    binary("response", d.response);
    out_ << YAML::EndMap;
  }

  /// Base64 of little-endian float64, column by column.
  void binary(const char* name, const Eigen::MatrixXd& m) {
    if (!m.allFinite()) throw InputError("recipe", "holds a number that is not finite");
    base64(name, reinterpret_cast<const unsigned char*>(m.data()),
           static_cast<std::size_t>(m.size()) * sizeof(double));
  }

  void row(const char* name, const Eigen::VectorXd& values) {
    key(name);
    numbers(values);
  }
  void matrix(const char* name, const Eigen::MatrixXd& m) {
    key(name) << YAML::BeginSeq;
    for (Index i = 0; i < m.rows(); ++i)
      numbers(m.row(i).transpose());
    out_ << YAML::EndSeq;
  }
  void numbers(const Eigen::VectorXd& values) {
    out_ << YAML::Flow << YAML::BeginSeq;
    for (const double value : values)
      out_ << measured_text(value);
    out_ << YAML::EndSeq;
  }

  YAML::Emitter out_;
};

// ---- reading

Eigen::MatrixXd matrix(const YamlNode& node, const char* key, Index rows, Index columns) {
  const std::vector<YamlNode> lines = node.at(key).items();
  if (std::ssize(lines) != rows) {
    node.fail_at(key, std::to_string(lines.size()) + " rows", std::to_string(rows));
  }
  Eigen::MatrixXd m(rows, columns);
  for (Index i = 0; i < rows; ++i) {
    const std::vector<YamlNode> cells = lines[static_cast<std::size_t>(i)].items();
    if (std::ssize(cells) != columns) {
      lines[static_cast<std::size_t>(i)].fail(std::to_string(cells.size()) + " numbers",
                                              std::to_string(columns));
    }
    for (Index j = 0; j < columns; ++j)
      m(i, j) = cells[static_cast<std::size_t>(j)].as_number();
  }
  return m;
}

/// The writer's base64().
std::vector<unsigned char> bytes_of(const YamlNode& node, const char* key, std::size_t expected) {
  std::vector<unsigned char> bytes = YAML::DecodeBase64(node.text(key));
  if (bytes.size() != expected) {
    node.fail_at(key, std::to_string(bytes.size()) + " bytes of base64", std::to_string(expected));
  }
  return bytes;
}

/// The writer's binary().
Eigen::MatrixXd binary(const YamlNode& node, const char* key, Index rows, Index columns) {
  const std::size_t expected = static_cast<std::size_t>(rows * columns) * sizeof(double);
  const std::vector<unsigned char> bytes = bytes_of(node, key, expected);
  Eigen::MatrixXd m(rows, columns);
  std::memcpy(m.data(), bytes.data(), expected);
  if (!m.allFinite()) node.fail_at(key, "holds a number that is not finite", "finite numbers");
  return m;
}

std::vector<int> bin_ids(const YamlNode& node) {
  std::vector<int> ids;
  for (const YamlNode& item : node.at("bin_id").items()) {
    ids.push_back(static_cast<int>(item.as_integer(0, kMaxBinId)));
    if (ids.size() > 1 && ids.back() <= ids[ids.size() - 2]) {
      item.fail(std::to_string(ids.back()), "bins in rising order, each once");
    }
  }
  if (ids.empty()) node.fail_at("bin_id", "no bins", "at least one");
  return ids;
}

void read_covariance(const YamlNode& node, TaughtCluster& c) {
  constexpr const char* kKey = "monitored_covariance";
  const Index p = c.monitored_mean.size();
  c.monitored_covariance = matrix(node, kKey, p, p);
  if (!c.monitored_covariance.isApprox(c.monitored_covariance.transpose(), 1e-6)) {
    node.fail_at(kKey, "not symmetric", "a covariance");
  }
  if (Eigen::LLT<Eigen::MatrixXd>(c.monitored_covariance).info() != Eigen::Success) {
    node.fail_at(kKey, "not positive definite", "a covariance");
  }
}

void read_residuals(const YamlNode& node, TaughtCluster& c, Index channels) {
  c.bin_id = bin_ids(node);
  c.bin_residual = matrix(node, "bin_residual", std::ssize(c.bin_id), channels);
  c.bin_residual_sigma = matrix(node, "bin_residual_sigma", std::ssize(c.bin_id), channels);
  if (!(c.bin_residual_sigma.minCoeff() > 0)) {
    node.fail_at("bin_residual_sigma", "holds a value of 0 or less", "deviations over 0");
  }
}

TaughtLayout read_layout(const YamlNode& node, std::size_t clusters) {
  constexpr int kMostSide = 4000;
  TaughtLayout l;
  l.pitch_m = node.number("pitch_m", {0, 1, true});
  const int side = node.integer("side", 3, kMostSide);
  const auto shift = node.numbers("taught_shift_m", 2, {-1, 1});
  l.taught = {{shift[0], shift[1]}, node.number("taught_rotation_rad", {-4, 4})};
  const std::size_t cells = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
  std::vector<unsigned char> label = bytes_of(node, "label", cells);
  for (const unsigned char k : label) {
    if (k >= clusters && k < kUnknown) {
      node.fail_at("label", "names cluster " + std::to_string(k),
                   "less than " + std::to_string(clusters));
    }
  }
  l.label = cv::Mat(side, side, CV_8UC1, label.data()).clone();
  std::vector<unsigned char> look = bytes_of(node, "look", 2 * cells);
  const cv::Mat packed(side, side, CV_16SC1, look.data());
  l.seen = packed != kNothingSeen;
  packed.convertTo(l.look, CV_32F, 1 / kLookSteps);
  node.finish();
  return l;
}

std::vector<std::string> direction_names(const YamlNode& node, Index channels) {
  std::vector<std::string> names = node.texts("names");
  if (names.empty() || std::ssize(names) > channels + 2) {
    node.fail_at("names", std::to_string(names.size()) + " directions",
                 "1 to " + std::to_string(channels + 2));
  }
  return names;
}

MonitoredDirections read_directions(const YamlNode& node, Index channels) {
  MonitoredDirections d;
  d.names = direction_names(node, channels);
  d.frame.id = bin_ids(node);
  const Index bins = std::ssize(d.frame.id);
  for (const YamlNode& item : node.at("light").items())
    d.frame.light.push_back(static_cast<int>(item.as_integer(1, 2)));
  if (std::ssize(d.frame.light) != bins) {
    node.fail_at("light", std::to_string(d.frame.light.size()) + " numbers", std::to_string(bins));
  }
  const Eigen::MatrixXd angles = binary(node, "angles", bins, 3);
  for (Index j = 0; j < bins; ++j)
    d.frame.directions.push_back({angles(j, 0), angles(j, 1), angles(j, 2)});
  d.reference = binary(node, "reference", bins, channels);
  d.weight = binary(node, "weight", bins, channels);
  if (!(d.weight.minCoeff() > 0)) node.fail_at("weight", "holds 0 or less", "weights over 0");
  d.response = binary(node, "response", bins * channels, std::ssize(d.names));
  node.finish();
  return d;
}

TaughtCluster read_cluster(const YamlNode& node, const Recipe& recipe) {
  constexpr YamlRange kOverZero{0, 1e300, true};
  TaughtCluster c;
  c.name = node.text("name");
  c.parts = node.integer("parts", 1, kMaxParts);
  c.mean = matrix(node, "mean", recipe.components, recipe.channels);
  c.directions = read_directions(node.at("directions"), recipe.channels);
  const auto monitored =
      node.numbers("monitored_mean", static_cast<std::size_t>(c.directions.size()));
  c.monitored_mean = Eigen::Map<const Eigen::VectorXd>(monitored.data(), std::ssize(monitored));
  read_covariance(node, c);
  c.t2_limit = node.number("t2_limit", kOverZero);
  read_residuals(node, c, recipe.channels);
  c.spe_limit = node.number("spe_limit", kOverZero);
  c.area_share = node.number("area_share", {0, 1});
  const auto gloss = node.numbers("gloss_gu", 3, {0, 1e6});
  std::copy(gloss.begin(), gloss.end(), c.gloss_gu.begin());
  const auto lab = node.numbers("lab", 3);
  c.lab = Eigen::Map<const Lab>(lab.data());
  node.finish();
  return c;
}

std::vector<TaughtCluster> read_clusters(const YamlNode& root, const Recipe& recipe) {
  const YamlNode node = root.at("clusters");
  const std::vector<YamlNode> items = node.items();
  if (items.empty() || items.size() > kMaxClusters) {
    node.fail(std::to_string(items.size()) + " clusters", "1 to " + std::to_string(kMaxClusters));
  }
  std::vector<TaughtCluster> clusters;
  for (const YamlNode& item : items)
    clusters.push_back(read_cluster(item, recipe));
  return clusters;
}

}  // namespace

void write_recipe(const std::filesystem::path& file, const Recipe& recipe) {
  write_text_file(file, Writer().recipe(recipe));
}

Recipe read_recipe(const std::filesystem::path& file) {
  const YamlNode root = YamlNode::load_file(file);
  root.choice("schema", {kSchema});
  Recipe r;
  r.id = root.integer("id", 1, kMaxId);
  r.name = root.text("name");
  r.created = root.text("created");
  r.parts = root.integer("parts", 1, kMaxParts);
  r.calibration_hash = root.text("calibration_hash");
  r.basis_checksum = root.text("basis_checksum");
  r.channels = root.choice("channels", {"1", "3"}) == 0 ? 1 : 3;
  r.components = root.integer("components", 1, kMaxComponents);
  r.part_height_mm = root.number_or("part_height_mm", 0, {-50, 50});
  r.warnings = root.texts("warnings");
  r.settings = read_judge_settings(root.at("settings"));
  r.clusters = read_clusters(root, r);
  if (root.has("rules")) r.rules = read_rule_set(root.at("rules"), &r.clusters);
  if (root.has("layout")) r.layout = read_layout(root.at("layout"), r.clusters.size());
  if (root.has("defects")) {
    r.defects =
        read_defect_reference(root.at("defects"), r.clusters.size(), r.components, r.channels);
  }
  root.finish();
  return r;
}

}  // namespace brdfgate
