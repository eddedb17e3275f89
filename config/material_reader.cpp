#include "config/material_reader.hpp"

#include <algorithm>
#include <mutex>

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

BrdfPtr read_lambert(const YamlNode& material) {
  return make_brdf(LambertParameters{read_rgb(material, "lambert", kAlbedo)});
}

BrdfPtr read_ggx(const YamlNode& node) {
  GgxParameters p;
  p.diffuse = read_rgb(node, "diffuse", kAlbedo);
  p.f0 = read_rgb(node, "f0", kAlbedo);
  p.alpha = node.number("alpha");
  if (p.alpha <= 0 || p.alpha > 1) {
    node.fail_at("alpha", number_text(p.alpha) + " is out of range", "above 0 and at most 1");
  }
  node.finish();
  return make_brdf(p);
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

BrdfPtr read_brdf(const YamlNode& material, const fs::path& folder) {
  std::vector<std::string> models;
  for (const char* model : {"brdf", "lambert", "ggx", "abc", "sgd"}) {
    if (material.has(model)) models.emplace_back(model);
  }
  if (models.size() != 1) {
    std::string seen = "no model";
    if (models.size() > 1) seen = "both " + models[0] + " and " + models[1];
    material.finish();  // a misspelt model is the likelier mistake
    material.fail(seen, "exactly one of brdf, lambert, ggx, abc, sgd");
  }
  const std::string& model = models.front();
  if (model == "lambert") return read_lambert(material);
  const YamlNode node = material.at(model);
  if (model == "ggx") return read_ggx(node);
  if (model == "abc") return read_abc(node);
  if (model == "sgd") return read_sgd(node);
  return read_merl(node, folder);
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
