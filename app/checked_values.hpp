// What a verdict rests on, value by value beside its limit: the figures behind the findings, for
// people to read (explain.hpp). The verdict itself is judge()'s.
#pragma once

#include <string>
#include <vector>

#include "app/inspector.hpp"

namespace brdfgate {

inline constexpr int kWholePart = -1;

struct CheckedValue {
  enum class State { within, beyond, unknown };
  int cluster = kWholePart;  ///< index
  std::string name;
  std::string value;  ///< with its unit
  std::string limit;
  double ratio = 0;  ///< value over limit, 0 or more; NaN: not known
  std::string note;  ///< e.g. the taught value
  State state = State::within;
};

/// Of the part as a whole, then cluster by cluster. Without a recipe only what the station's own
/// settings bound; of a part that was not measured (no light, absent) nothing.
std::vector<CheckedValue> checked_values(const Inspection& part, const RecipeInForce* recipe,
                                         const Inspector& inspector);

/// What could not be seen, taught or measured, and what follows from it; empty: nothing is missing.
std::vector<std::string> missing_evidence(const Inspection& part, const RecipeInForce* recipe,
                                          const Inspector& inspector);

/// "pass", "reject", "not judged", "measured".
std::string verdict_words(Verdict verdict);

}  // namespace brdfgate
