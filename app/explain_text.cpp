#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "app/checked_values.hpp"
#include "app/explain.hpp"
#include "app/reading_words.hpp"

namespace brdfgate {
namespace {

constexpr int kBarWidth = 20;  ///< characters; the limit stands in the middle

/// "#####|     ": value over limit; "?" where it is not known.
std::string text_bar(double ratio) {
  std::string bar(kBarWidth + 1, ' ');
  if (std::isfinite(ratio)) {
    const int filled = static_cast<int>(std::lround(std::clamp(ratio, 0.0, 2.0) / 2 * kBarWidth));
    std::fill(bar.begin(), bar.begin() + filled + (filled > kBarWidth / 2 ? 1 : 0), '#');
  } else {
    bar[0] = '?';
  }
  bar[kBarWidth / 2] = '|';
  return bar;
}

std::string state_words(CheckedValue::State state) {
  return state == CheckedValue::State::within   ? "ok"
         : state == CheckedValue::State::beyond ? "BEYOND"
                                                : "NOT KNOWN";
}

std::string cluster_name(const Inspection& part, int index) {
  return index == kWholePart ? "part" : part.result.clusters[static_cast<std::size_t>(index)].name;
}

std::string values_text(const ExplainSource& s) {
  std::string out;
  for (const CheckedValue& v : checked_values(s.part, s.recipe, s.inspector)) {
    out +=
        fmt::format("  {:<12} {:<22} {:>16} of {:>16} [{}] {}\n", cluster_name(s.part, v.cluster),
                    v.name, v.value, v.limit, text_bar(v.ratio), state_words(v.state));
  }
  return out;
}

std::string changes_text(const ExplainSource& s) {
  std::string out;
  if (s.recipe == nullptr) return out;
  for (std::size_t i = 0; i < s.part.observed.size(); ++i) {
    const auto& seen = s.part.observed[i];
    if (!seen || i >= s.recipe->recipe.clusters.size()) continue;
    for (const MonitoredShift& shift : monitored_shifts(s.recipe->recipe.clusters[i], *seen)) {
      out += fmt::format("  {:<12} {:<22} {:+7.2f} % ({:+.1f} sigma), {:.2f} of T2\n",
                         cluster_name(s.part, static_cast<int>(i)), shift.name, 100 * shift.change,
                         shift.sigmas, shift.part);
    }
  }
  return out;
}

std::string readings_text(const ExplainSource& s) {
  std::string out;
  for (const ClusterResult& c : s.part.result.clusters) {
    const auto i = static_cast<std::size_t>(c.index);
    const bool taught = s.recipe != nullptr && i < s.recipe->recipe.clusters.size();
    for (const ReadingWords& r :
         reading_words(c, taught ? &s.recipe->recipe.clusters[i] : nullptr)) {
      out += fmt::format("  {:<12} {:<22} {:>10}, 90 %: {}{}, {}\n", c.name, r.name, r.value,
                         r.interval.empty() ? "not known" : r.interval,
                         r.taught.empty() ? "" : ", taught " + r.taught,
                         r.measured ? "measured" : "extrapolated");
    }
  }
  return out;
}

void add_section(std::string& out, const std::string& title, const std::string& lines) {
  if (!lines.empty()) out += " " + title + "\n" + lines;
}

}  // namespace

std::string explain_text(const ExplainSource& s) {
  std::string out = s.recording + ": " + verdict_words(s.part.result.verdict) + "\n";
  for (const Finding& f : s.part.result.findings)
    out += "  " + f.text + "\n";
  std::string missing;
  for (const std::string& m : missing_evidence(s.part, s.recipe, s.inspector))
    missing += "  " + m + "\n";
  std::string defects;
  for (const Defect& d : s.part.result.defects) {
    defects +=
        fmt::format("  {:<8} at {:+.1f}, {:+.1f} mm, {:.1f} mm wide, {:.1f} times the limit\n",
                    d.kind, d.at_mm[0], d.at_mm[1], d.size_mm, d.score);
  }
  add_section(out, "missing", missing);
  add_section(out, "values against limits", values_text(s));
  add_section(out, "changes from the taught material", changes_text(s));
  add_section(out, "local defects", defects);
  add_section(out, "readings", readings_text(s));
  return out;
}

}  // namespace brdfgate
