// Why a part got its verdict, for people: as text and as one page to file or to show a customer.
#pragma once

#include <filesystem>
#include <string>

#include "app/inspector.hpp"
#include "app/result_json.hpp"

namespace brdfgate {

/// What there is to say of one inspected part. References live as long as the call.
struct ExplainSource {
  const Inspection& part;
  const Inspector& inspector;
  const RecipeInForce* recipe;  ///< nullptr: none in force
  std::string recording;        ///< the part's name
  std::string station_hash;     ///< of the configuration's station
  std::string recipe_hash;      ///< SHA-256 of the recipe file; empty: none
  CycleTimes times;
};

/// Verdict, reasons, every value beside its limit with a bar, the named changes, readings with
/// their uncertainty, what is missing. One line each, ending in a newline.
std::string explain_text(const ExplainSource& source);

/// The same and pictures (regions, residuals with the defects marked, spheres of taught and found
/// material), rules and provenance, as one HTML page that needs nothing else: pictures within it,
/// no script, no link. Parts that were not judged, or not even seen, have a page too.
std::string explain_page(const ExplainSource& source);

/// Writes <dir>/explain.html. Throws InputError where it cannot.
std::filesystem::path write_explanation(const std::filesystem::path& dir,
                                        const ExplainSource& source);

}  // namespace brdfgate
