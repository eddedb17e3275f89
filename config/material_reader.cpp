#include "config/material_reader.hpp"

#include <algorithm>
#include <functional>
#include <mutex>

#include "model/analytic.hpp"
#include "model/lobes.hpp"
#include "model/merl.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

/// The few MERL files that the scenes in use name: 35 MB each and a diffuse table to compute, while
/// the simulated station reads its scene anew for every part.
class MerlCache {
 public:
  BrdfPtr open(const fs::path& file) {
    std::error_code error;
    const fs::path canonical = fs::canonical(file, error);
    if (error) throw InputError(file.string(), "cannot be opened: " + error.message());
    const fs::file_time_type changed = fs::last_write_time(canonical);
    const std::scoped_lock lock(mutex_);
    const auto known = std::find_if(entries_.begin(), entries_.end(),
                                    [&](const Entry& entry) { return entry.file == canonical; });
    if (known != entries_.end()) {
      if (known->changed == changed) {
        std::rotate(entries_.begin(), known, known + 1);
        return entries_.front().brdf;
      }
      entries_.erase(known);
    }
    entries_.insert(entries_.begin(), {canonical, changed, MerlBrdf::open(file)});
    if (entries_.size() > kEntries) entries_.pop_back();
    return entries_.front().brdf;
  }

 private:
  static constexpr std::size_t kEntries = 8;
  struct Entry {
    fs::path file;
    fs::file_time_type changed;
    BrdfPtr brdf;
  };
  std::mutex mutex_;
  std::vector<Entry> entries_;  ///< the last used first
};

BrdfPtr read_merl(const YamlNode& node, const fs::path& folder) {
  static MerlCache cache;
  const std::string name = node.as_text();
  if (name.empty()) node.fail("empty", "a MERL .binary file");
  try {
    return cache.open((folder / name).lexically_normal());
  } catch (const InputError& error) {
    node.fail(error.what());
  } catch (const fs::filesystem_error& error) {
    node.fail(error.code().message(), "a MERL .binary file");
  }
}

constexpr YamlRange kAlbedo{0, 1};
/// Published shifted gamma fits reach c = 1e38.
constexpr YamlRange kNotNegative{0, 1e40};
constexpr YamlRange kIor{1, 1000};

YamlRange range_of(const LobeParameter& p) {
  return {p.least, p.most};
}

double read_shape(const YamlNode& node, const LobeParameter& p) {
  if (!p.above_least) return node.number(p.name, range_of(p));
  const double value = node.number(p.name);
  if (value > p.least && value <= p.most) return value;
  node.fail_at(p.name, number_text(value) + " is out of range",
               "above " + number_text(p.least) + " and at most " + number_text(p.most));
}

/// lambert, ggx and the rest of model/lobes.hpp, by their descriptions.
BrdfPtr read_lobe(const YamlNode& material, const LobeDescription& description) {
  Lobe lobe;
  lobe.model = description.model;
  if (description.model == LobeModel::lambert) {
    lobe.diffuse = read_rgb(material, description.name, kAlbedo);
    return make_brdf(lobe);
  }
  const YamlNode node = material.at(description.name);
  lobe.diffuse = read_rgb(node, diffuse_parameter().name, range_of(diffuse_parameter()));
  lobe.specular = read_rgb(node, description.specular.name, range_of(description.specular));
  for (const LobeParameter& p : description.shape)
    lobe.shape.push_back(read_shape(node, p));
  node.finish();
  return make_brdf(lobe);
}

BrdfPtr read_abc(const YamlNode& node) {
  AbcParameters p;
  p.kd = read_rgb(node, "kd", kAlbedo);
  p.a = read_rgb(node, "a", kNotNegative);
  p.b = node.number("b", kNotNegative);
  p.c = node.number("c", {0, 100});
  p.ior = node.number("ior", kIor);
  node.finish();
  return make_brdf(p);
}

/// f1 and theta0 are offsets and negative in some of the published fits; the rest are not.
BrdfPtr read_sgd(const YamlNode& node) {
  constexpr YamlRange kOffset{-1e6, 1e6};
  SgdParameters p;
  p.rho_d = read_rgb(node, "rho_d", kAlbedo);
  p.rho_s = read_rgb(node, "rho_s", kNotNegative);
  p.alpha = read_rgb(node, "alpha", {0, 1e40, true});
  p.p = read_rgb(node, "p", kNotNegative);
  p.f0 = read_rgb(node, "f0", kNotNegative);
  p.f1 = read_rgb(node, "f1", kOffset);
  p.kap = read_rgb(node, "kap", kNotNegative);
  p.lambda = read_rgb(node, "lambda", kNotNegative);
  p.c = read_rgb(node, "c", kNotNegative);
  p.k = read_rgb(node, "k", kNotNegative);
  p.theta0 = read_rgb(node, "theta0", kOffset);
  node.finish();
  return make_brdf(p);
}

using ModelReader = std::function<BrdfPtr(const YamlNode& material)>;

/// Every model a material may have, by its key.
std::vector<std::pair<std::string, ModelReader>> model_readers(const fs::path& folder) {
  std::vector<std::pair<std::string, ModelReader>> readers{
      {"brdf", [&folder](const YamlNode& m) { return read_merl(m.at("brdf"), folder); }},
      {"abc", [](const YamlNode& m) { return read_abc(m.at("abc")); }},
      {"sgd", [](const YamlNode& m) { return read_sgd(m.at("sgd")); }}};
  for (const LobeModel model : lobe_models()) {
    const LobeDescription& description = describe(model);
    readers.emplace_back(std::string(description.name),
                         [&description](const YamlNode& m) { return read_lobe(m, description); });
  }
  return readers;
}

BrdfPtr read_brdf(const YamlNode& material, const fs::path& folder) {
  const auto readers = model_readers(folder);
  std::vector<const std::pair<std::string, ModelReader>*> present;
  std::string known;
  for (const auto& reader : readers) {
    known += (known.empty() ? "" : ", ") + reader.first;
    if (material.has(reader.first)) present.push_back(&reader);
  }
  if (present.size() == 1) return present.front()->second(material);
  std::string seen = "no model";
  if (present.size() > 1) seen = "both " + present[0]->first + " and " + present[1]->first;
  material.finish();  // a misspelt model is the likelier mistake
  material.fail(seen, "exactly one of " + known);
}

}  // namespace

Rgb read_rgb(const YamlNode& node, std::string_view key, YamlRange range) {
  const std::vector<double> values = node.numbers(key, 3, range);
  return {values[0], values[1], values[2]};
}

std::vector<SceneMaterial> read_materials(const YamlNode& list, const fs::path& folder) {
  constexpr std::size_t kMost = 256;  // regions.png indexes them with eight bits
  const std::vector<YamlNode> nodes = list.items();
  if (nodes.empty() || nodes.size() > kMost) {
    list.fail(std::to_string(nodes.size()) + " materials", "1 to " + std::to_string(kMost));
  }
  std::vector<SceneMaterial> out;
  for (const YamlNode& node : nodes) {
    const std::string name = node.text("name");
    if (name.empty()) node.fail_at("name", "empty", "a name");
    const bool taken =
        std::any_of(out.begin(), out.end(), [&](const SceneMaterial& m) { return m.name == name; });
    if (taken) node.fail_at("name", shown(name) + " a second time", "a name of its own");
    out.push_back({name, read_brdf(node, folder)});
    node.finish();
  }
  return out;
}

}  // namespace brdfgate
