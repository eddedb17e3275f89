#include "model/rules.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace brdfgate {
namespace {

std::string number(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", v);
  return text;
}

std::vector<RuleReadingInfo> make_infos() {
  std::vector<RuleReadingInfo> infos{
      {"gloss_20_gu", "GU", 0, 2000, false, true, Reason::gloss},
      {"gloss_60_gu", "GU", 0, 2000, false, true, Reason::gloss},
      {"gloss_85_gu", "GU", 0, 2000, false, true, Reason::gloss},
      {"haze_gu", "GU", -2000, 2000, false, true, Reason::gloss},
      {"l_star", "L*", 0, 1000, false, true, Reason::colour},
      {"a_star", "a*", -1000, 1000, false, true, Reason::colour},
      {"b_star", "b*", -1000, 1000, false, true, Reason::colour},
      {"delta_e00", "dE00", 0, 100, false, false, Reason::colour},
  };
  for (const char* angle : {"15", "25", "45", "75", "110"}) {
    for (const char* axis : {"l", "a", "b"}) {
      const bool level = *axis == 'l';
      infos.push_back({std::string("aspecular_") + angle + "_" + axis + "_star",
                       level ? "L*" : std::string(axis) + "*", level ? 0.0 : -1000.0, 1000, false,
                       true, Reason::colour});
    }
  }
  infos.insert(infos.end(), {{"flop_index", "1", 0, 1000, false, true, Reason::colour},
                             {"area_share", "1", 0, 1, false, true, Reason::missing_cluster},
                             {"residual_rms", "ln", 0, 10, false, false, Reason::spe},
                             {"unknown_share", "1", 0, 1, true, false, Reason::unknown_region},
                             {"defects", "1", 0, 1e6, true, false, Reason::local_defect},
                             {"defect_size_mm", "mm", 0, 1000, true, false, Reason::local_defect},
                             {"defect_area_mm2", "mm2", 0, 1e6, true, false, Reason::local_defect},
                             {"tilt_deg", "deg", 0, 45, true, false, Reason::tilt}});
  return infos;
}

const std::vector<RuleReadingInfo>& infos() {
  static const std::vector<RuleReadingInfo> made = make_infos();
  return made;
}

/// " GU", or nothing for what has no unit.
std::string unit_of(RuleReading reading) {
  const std::string& unit = rule_reading_info(reading).unit;
  return unit == "1" ? "" : " " + unit;
}

/// "gloss_60_gu is 12.3 GU (sigma 0.4)"
std::string said(const RuleOutcome& out) {
  std::string text = rule_reading_info(out.rule.reading).name;
  if (!out.rule.kind.empty()) text += " (" + out.rule.kind + ")";
  text += " is " + number(out.value) + unit_of(out.rule.reading);
  return std::isfinite(out.sigma) ? text + " (sigma " + number(out.sigma) + ")" : text;
}

/// "11 GU (taught 9 + 2)"
std::string limit_text(const RuleOutcome& out, bool upper) {
  std::string text = number(upper ? out.high : out.low) + unit_of(out.rule.reading);
  if (out.rule.tolerance) {
    text += " (taught " + number(out.taught) + (upper ? " + " : " - ") +
            number(*out.rule.tolerance) + ")";
  }
  return text;
}

void not_judged(RuleOutcome& out, Reason reason, std::string text) {
  out.verdict = Verdict::not_judged;
  out.reason = reason;
  out.text = std::move(text);
}

/// Value and deviation that the limits are compared with, and these. False where one is not known.
bool take_values(RuleOutcome& out, const RuleValue& seen) {
  out.taught = seen.taught;
  out.value = seen.value;
  std::optional<double> sigma = seen.sigma;
  out.low = out.rule.low;
  out.high = out.rule.high;
  if (out.rule.tolerance) {
    if (seen.change) out.value = seen.taught + *seen.change;
    if (seen.change_sigma) sigma = seen.change_sigma;
    out.low = seen.taught - *out.rule.tolerance;
    out.high = seen.taught + *out.rule.tolerance;
  }
  out.sigma = sigma.value_or(std::numeric_limits<double>::quiet_NaN());
  const bool sigma_usable = !sigma || (std::isfinite(*sigma) && *sigma >= 0) || out.guard == 0;
  return std::isfinite(out.value) && sigma_usable && !std::isnan(out.low) && !std::isnan(out.high);
}

/// How far the value is beyond its nearer limit: negative inside.
struct Excess {
  double by;
  bool upper;
};

Excess excess(const RuleOutcome& out) {
  const double over = out.value - out.high, under = out.low - out.value;
  return over >= under ? Excess{over, true} : Excess{under, false};
}

/// Gloss errs by factors (Reading::interval_by_factor).
bool errs_by_factors(RuleReading reading) {
  return reading <= RuleReading::gloss_85_gu;
}

/// Where the true value may lie: the guard band around the value seen.
struct Band {
  double low, high;
};

Band guard_band(const RuleOutcome& out) {
  const double width = std::isfinite(out.sigma) ? out.guard * out.sigma : 0;
  if (!errs_by_factors(out.rule.reading) || out.value <= 0)
    return {out.value - width, out.value + width};
  const double factor = std::exp(width / out.value);
  return {out.value / factor, out.value * factor};
}

void compare(RuleOutcome& out, const std::string& place) {
  const Reason reason = rule_reading_info(out.rule.reading).reason;
  const Band band = guard_band(out);
  if (band.low >= out.low && band.high <= out.high) {
    out.verdict = Verdict::pass;
    return;
  }
  const Excess e = excess(out);
  const std::string unit = unit_of(out.rule.reading);
  const std::string limit = limit_text(out, e.upper) + " by " + number(std::abs(e.by)) + unit;
  if (band.low > out.high || band.high < out.low) {
    // A tilted part is no bad part: it can only not be judged.
    out.verdict = (bit(reason) & kRejectBits) != 0 ? Verdict::reject : Verdict::not_judged;
    out.reason = reason;
    out.text = place + said(out) + (e.upper ? ", over its limit " : ", under its limit ") + limit;
    return;
  }
  const bool hopeless = out.high - out.low < band.high - band.low;
  not_judged(out, Reason::coverage,
             place + said(out) + (e.by > 0 ? ", beyond its limit " : ", within its limit ") +
                 limit + ": too near to tell, its guard band of " + number(out.guard) +
                 " sigmas spans " + number(band.low) + " to " + number(band.high) + unit +
                 (hopeless ? ", which is wider than its limits are apart" : ""));
}

}  // namespace

const RuleReadingInfo& rule_reading_info(RuleReading reading) {
  return infos().at(static_cast<std::size_t>(reading));
}

const std::vector<std::string>& rule_reading_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> made;
    for (const RuleReadingInfo& info : infos())
      made.push_back(info.name);
    return made;
  }();
  return names;
}

bool is_about_defects(RuleReading reading) {
  return reading == RuleReading::defects || reading == RuleReading::defect_size_mm ||
         reading == RuleReading::defect_area_mm2;
}

bool RuleSet::has(RuleReading reading, int cluster) const {
  return std::any_of(rules.begin(), rules.end(),
                     [&](const Rule& rule) { return rule.is_about(reading, cluster); });
}

bool RuleSet::has_defects_of(const std::string& kind) const {
  return std::any_of(rules.begin(), rules.end(), [&](const Rule& rule) {
    return is_about_defects(rule.reading) && (rule.kind.empty() || rule.kind == kind);
  });
}

RuleOutcome judge_rule(const Rule& rule, double set_guard, const RuleValue& seen,
                       const std::string& place) {
  RuleOutcome out;
  out.rule = rule;
  out.guard = rule.guard.value_or(set_guard);
  out.measured = seen.measured;
  const std::string& name = rule_reading_info(rule.reading).name;
  if (!take_values(out, seen)) {
    not_judged(out, seen.missing_reason,
               place + name + " is not known" + (seen.missing.empty() ? "" : ": " + seen.missing));
  } else if (rule.measured && !seen.measured) {
    not_judged(out, Reason::coverage,
               place + said(out) + ", extrapolated by the basis; its rule demands a measured one");
  } else {
    compare(out, place);
  }
  return out;
}

}  // namespace brdfgate
