#include "config/judge_yaml.hpp"

#include <variant>

namespace brdfgate {
namespace {

struct SettingField {
  const char* key;
  std::variant<double JudgeSettings::*, int JudgeSettings::*> value;
  YamlRange range;
  bool optional = false;  ///< the default stands where the key is missing
};

const std::vector<SettingField>& setting_fields() {
  using S = JudgeSettings;
  static const std::vector<SettingField> fields{
      {"false_reject_rate", &S::false_reject_rate, {0, 0.5, true}},
      {"change_floor", &S::change_floor, {0, 1, true}, true},
      {"colour_limit_de00", &S::colour_limit_de00, {0, 100, true}},
      {"gloss_limit_gu", &S::gloss_limit_gu, {0, 2000, true}},
      {"area_share_limit", &S::area_share_limit, {0, 1}},
      {"unknown_share_limit", &S::unknown_share_limit, {0, 1}},
      {"assign_tolerance", &S::assign_tolerance, {0, 10, true}},
      {"defect_log_threshold", &S::defect_log_threshold, {0, 10, true}},
      {"defect_min_mm2", &S::defect_min_mm2, {0, 1e6, true}},
      {"max_ambient", &S::max_ambient, {0, 1}},
      {"max_clipped", &S::max_clipped, {0, 1}},
      {"min_coverage", &S::min_coverage, {0, 1}},
      {"min_bins", &S::min_bins, {1, 100000}},
      {"max_shift_mm", &S::max_shift_mm, {0, 1000, true}, true},
      {"max_rotation_deg", &S::max_rotation_deg, {0, 45, true}, true},
      {"max_tilt_deg", &S::max_tilt_deg, {0, 45, true}, true},
  };
  return fields;
}

struct ReadField {
  const YamlNode& node;
  const SettingField& field;
  JudgeSettings& into;
  void operator()(double JudgeSettings::* member) const {
    if (field.optional && !node.has(field.key)) return;
    into.*member = node.number(field.key, field.range);
  }
  void operator()(int JudgeSettings::* member) const {
    into.*member = node.integer(field.key, static_cast<int>(field.range.least),
                                static_cast<int>(field.range.most));
  }
};

}  // namespace

JudgeSettings read_judge_settings(const YamlNode& node) {
  JudgeSettings settings;
  for (const SettingField& field : setting_fields())
    std::visit(ReadField{node, field, settings}, field.value);
  node.finish();
  return settings;
}

std::vector<std::pair<std::string, std::string>> judge_settings_text(
    const JudgeSettings& settings) {
  std::vector<std::pair<std::string, std::string>> text;
  for (const SettingField& field : setting_fields()) {
    text.emplace_back(
        field.key,
        std::visit([&](auto member) { return number_text(settings.*member); }, field.value));
  }
  return text;
}

}  // namespace brdfgate
