// Results as JSON (brdfgate.result/1 of the command reference).
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "app/inspector.hpp"

namespace brdfgate {

/// How long one part took; the PLC's _ms registers.
struct CycleTimes {
  double acquisition_ms = 0;  ///< trigger to last frame
  double processing_ms = 0;   ///< last frame to verdict
  double cycle_ms() const { return acquisition_ms + processing_ms; }
};

/// One element of "parts". `brdf_files`: per cluster, empty where none was exported.
nlohmann::json part_to_json(const std::string& recording, const PartResult& result,
                            const CycleTimes& times,
                            const std::vector<std::string>& brdf_files = {});

/// {schema: brdfgate.result/1, parts}.
nlohmann::json result_document(std::vector<nlohmann::json> parts);

std::string to_text(Verdict verdict);  ///< none, pass, reject, not_judged

/// Writes `text` to `file` atomically (temporary file in the same folder, then rename). Throws
/// InputError.
void write_text_file(const std::filesystem::path& file, const std::string& text);

}  // namespace brdfgate
