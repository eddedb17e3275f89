#include "app/study_input.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <map>

#include "app/csv_table.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

using nlohmann::json;

/// Where a reading stands: of the cluster or the part, and what must be valid for it.
struct Place {
  const char* name;
  const char* pointer;
  bool of_cluster;
  const char* valid;  ///< key under the cluster's `valid`; null: nothing
};
constexpr std::array<Place, 16> kPlaces{{{"gloss_20", "/gloss_gu/20", true, "gloss"},
                                         {"gloss_60", "/gloss_gu/60", true, "gloss"},
                                         {"gloss_85", "/gloss_gu/85", true, "gloss"},
                                         {"L*", "/lab/0", true, "colour"},
                                         {"a*", "/lab/1", true, "colour"},
                                         {"b*", "/lab/2", true, "colour"},
                                         {"delta_e00", "/delta_e00", true, "colour"},
                                         {"t2", "/t2", true, "weights"},
                                         {"spe", "/spe", true, "weights"},
                                         {"area_share", "/area_share", true, nullptr},
                                         {"t2_ratio", "/t2_ratio", false, nullptr},
                                         {"spe_ratio", "/spe_ratio", false, nullptr},
                                         {"tilt_x", "/tilt_deg/0", false, nullptr},
                                         {"tilt_y", "/tilt_deg/1", false, nullptr},
                                         {"height", "/height_mm", false, nullptr},
                                         {"ambient", "/ambient", false, nullptr}}};

/// Pointer of weight_<channel>_<component>, empty where the name is none.
std::string weight_pointer(const std::string& name) {
  constexpr std::string_view kPrefix = "weight_";
  if (name.size() < kPrefix.size() + 3 || name.compare(0, kPrefix.size(), kPrefix) != 0) return {};
  const auto channel = std::string_view("RGB").find(name[kPrefix.size()]);
  if (channel == std::string_view::npos || name[kPrefix.size() + 1] != '_') return {};
  int component = 0;
  const char* begin = name.data() + kPrefix.size() + 2;
  const char* end = name.data() + name.size();
  const auto [stop, error] = std::from_chars(begin, end, component);
  if (error != std::errc() || stop != end || component < 1) return {};
  return fmt::format("/weights/{}/{}", channel, component - 1);
}

/// The name's place; pointers are those of clusters.
struct Found {
  std::string pointer;
  bool of_cluster = true;
  const char* valid = nullptr;
};

Found place_of(const std::string& name, const std::string& where) {
  for (const Place& place : kPlaces) {
    if (name == place.name) return {place.pointer, place.of_cluster, place.valid};
  }
  const std::string weight = weight_pointer(name);
  if (!weight.empty()) return {weight, true, "weights"};
  if (!name.empty() && name.front() == '/') return {name, true, nullptr};
  throw InputError(where, "there is no reading '" + name + "'", reading_names());
}

const json& cluster_of(const json& part, int index, const std::string& where) {
  if (part.contains("clusters") && part["clusters"].is_array()) {
    for (const json& cluster : part["clusters"]) {
      if (cluster.value("index", -1) == index) return cluster;
    }
  }
  throw InputError(where, "has no cluster " + std::to_string(index), "a cluster of the part");
}

std::size_t index_of(std::vector<std::string>& names, const std::string& name) {
  const auto at = std::find(names.begin(), names.end(), name);
  if (at != names.end()) return static_cast<std::size_t>(at - names.begin());
  names.push_back(name);
  return names.size() - 1;
}

}  // namespace

std::string reading_names() {
  std::string names;
  for (const Place& place : kPlaces)
    names += std::string(place.name) + ", ";
  return names + "weight_R_1 (channel, component) or a JSON pointer into the cluster (/spe)";
}

double reading_of(const json& part, const ReadingChoice& choice, const std::string& where) {
  const Found found = place_of(choice.name, where);
  const json& from = found.of_cluster ? cluster_of(part, choice.cluster, where) : part;
  if (found.valid != nullptr &&
      !(from.contains("valid") && from["valid"].value(found.valid, false))) {
    throw InputError(where, choice.name + " is not valid there",
                     "a part of which it could be measured");
  }
  json::json_pointer pointer;
  try {
    pointer = json::json_pointer(found.pointer);
  } catch (const json::exception& error) {
    throw InputError("--reading", error.what(), "a JSON pointer such as /gloss_gu/60");
  }
  if (!from.contains(pointer) || !from.at(pointer).is_number()) {
    throw InputError(where, "has no number for " + choice.name, "a result that holds it");
  }
  return from.at(pointer).get<double>();
}

std::vector<StudyValue> read_study_table(const std::filesystem::path& file) {
  const CsvTable table(file, {"value"});
  std::vector<StudyValue> values;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    values.push_back(
        {table.text(row, "operator"), table.text(row, "part"), table.number(row, "value")});
  }
  return values;
}

GrrLayout grr_layout(const std::vector<StudyValue>& values) {
  GrrLayout layout;
  std::map<std::pair<std::size_t, std::size_t>, std::vector<double>> trials;
  for (const StudyValue& value : values) {
    if (value.part.empty()) throw InputError("study", "a value without a part", "its part's name");
    const std::size_t part = index_of(layout.parts, value.part);
    trials[{part, index_of(layout.operators, value.operator_name)}].push_back(value.value);
  }
  const std::size_t count = trials.empty() ? 0 : trials.begin()->second.size();
  for (std::size_t p = 0; p < layout.parts.size(); ++p) {
    Eigen::ArrayXXd table(layout.operators.size(), count);
    for (std::size_t o = 0; o < layout.operators.size(); ++o) {
      const std::vector<double>& seen = trials[{p, o}];
      if (seen.size() != count) {
        throw InputError(
            fmt::format("part '{}', operator '{}'", layout.parts[p], layout.operators[o]),
            std::to_string(seen.size()) + " trial(s)", std::to_string(count) + " as the others");
      }
      for (std::size_t t = 0; t < count; ++t)
        table(static_cast<Eigen::Index>(o), static_cast<Eigen::Index>(t)) = seen[t];
    }
    layout.input.values.push_back(std::move(table));
  }
  return layout;
}

}  // namespace brdfgate
