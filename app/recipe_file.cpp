#include "app/recipe_file.hpp"

#include <Eigen/Cholesky>
#include <array>
#include <charconv>
#include <cmath>
#include <string>
#include <vector>

#include "app/result_json.hpp"
#include "config/judge_yaml.hpp"
#include "config/yaml_reader.hpp"

namespace brdfgate {
namespace {

using Eigen::Index;

constexpr const char* kSchema = "brdfgate.recipe/1";
/// The PLC publishes eight clusters; its recipe numbers are 16 bits.
constexpr std::size_t kMaxClusters = 8;
constexpr int kMaxId = 65535;
constexpr int kMaxParts = 100000;
constexpr int kMaxComponents = 1000;
constexpr int kMaxBinId = 10'000'000;

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
    key("clusters") << YAML::BeginSeq;
    for (const TaughtCluster& taught : r.clusters)
      cluster(taught);
    out_ << YAML::EndSeq << YAML::EndMap;
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

  void cluster(const TaughtCluster& c) {
    out_ << YAML::BeginMap;
    quoted("name", c.name);
    put("parts", std::to_string(c.parts));
    matrix("mean", c.mean);
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

TaughtCluster read_cluster(const YamlNode& node, const Recipe& recipe) {
  constexpr YamlRange kOverZero{0, 1e300, true};
  TaughtCluster c;
  c.name = node.text("name");
  c.parts = node.integer("parts", 1, kMaxParts);
  c.mean = matrix(node, "mean", recipe.components, recipe.channels);
  const int leading = std::min(recipe.settings.monitored_weights, recipe.components);
  const auto monitored =
      node.numbers("monitored_mean", static_cast<std::size_t>(leading) * recipe.channels);
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
  root.finish();
  return r;
}

}  // namespace brdfgate
