// Values of one reading for a gauge study: by name from results, or from a table.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "model/gauge_study.hpp"

namespace brdfgate {

/// A reading by name, of one cluster where it is a cluster's.
struct ReadingChoice {
  std::string name = "gloss_60";
  int cluster = 0;
};

/// What `name` may be, in words, for help and errors.
std::string reading_names();

/// From one part of a brdfgate.result/1 document: gloss_20, gloss_60, gloss_85, L*, a*, b*,
/// delta_e00, t2, spe, area_share, weight_R_1 (channel, component from 1) of the cluster; t2_ratio,
/// spe_ratio, tilt_x, tilt_y, height, ambient of the part; or a JSON pointer (/gloss_gu/60) into
/// the cluster. Throws InputError naming `where` and the reading: unknown, absent, marked as not
/// valid, or not a number.
double reading_of(const nlohmann::json& part, const ReadingChoice& choice,
                  const std::string& where);

/// One value with what it belongs to; texts are empty where a study has none.
struct StudyValue {
  std::string operator_name;
  std::string part;
  double value = 0;
};

/// A CSV file with a heading: a column `value`, and `part` and `operator` where there are such.
/// Blank lines and lines that begin with # are skipped. Throws InputError with file and line.
std::vector<StudyValue> read_study_table(const std::filesystem::path& file);

/// Groups by part and operator in the order of first appearance.
struct GrrLayout {
  std::vector<std::string> parts;
  std::vector<std::string> operators;
  GrrInput input;
};
/// Throws InputError naming part and operator: values without a part, unequal numbers of trials.
GrrLayout grr_layout(const std::vector<StudyValue>& values);

}  // namespace brdfgate
