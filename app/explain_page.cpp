// The page of explain.hpp. Sections are written in the order in which a reader asks: what is the
// verdict, what is over its limit, what changed, where, what does it look like, what does it read,
// and what was it measured with.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "app/checked_values.hpp"
#include "app/explain.hpp"
#include "app/html_page.hpp"
#include "app/pictures.hpp"
#include "app/reading_words.hpp"
#include "model/reconstruction.hpp"

namespace brdfgate {
namespace {

constexpr int kPictureWidth = 460;   ///< px
constexpr int kSphere = 150;         ///< px
constexpr double kShiftSpan = 6;     ///< sigmas at the end of a change's bar
constexpr double kUntaughtSpan = 6;  ///< sigmas in full colour where no limit was taught

constexpr const char* kStyle =
    "*{box-sizing:border-box}"
    "body{font:15px/1.45 system-ui,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;color:#1c2430;"
    "background:#fff;max-width:1040px;margin:0 auto;padding:24px 28px 48px}"
    "header{border-left:10px solid var(--c);background:#f5f7f9;padding:16px 20px;margin:0 0 8px}"
    "h1{font-size:22px;font-weight:600;margin:0 0 4px}"
    ".verdict{display:inline-block;background:var(--c);color:#fff;font-weight:700;font-size:20px;"
    "letter-spacing:.04em;padding:4px 14px;border-radius:4px;margin:6px 0 8px}"
    ".pass{--c:#00795a}.reject{--c:#b5390b}.not_judged{--c:#8a6100}.none{--c:#45566b}"
    "ul.reasons{margin:4px 0 0;padding-left:20px}"
    "h2{font-size:16px;font-weight:600;margin:30px 0 8px;padding-bottom:4px;"
    "border-bottom:1px solid #cfd6de}"
    "h3{font-size:14px;font-weight:600;margin:16px 0 4px}"
    "table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}"
    "th,td{text-align:left;padding:4px 12px 4px 0;border-bottom:1px solid #e8ecf0;"
    "vertical-align:middle}"
    "thead th{font-weight:600;font-size:12px;color:#5a6878;border-bottom:1px solid #cfd6de}"
    "tbody th{font-weight:normal}td.n{text-align:right;white-space:nowrap}"
    "th.n{text-align:right}td.note,p.note,figcaption{color:#5a6878;font-size:13px}"
    ".bar{position:relative;width:190px;height:12px;background:#e8ecf0;border-radius:2px}"
    ".bar i{position:absolute;top:0;bottom:0;background:#00795a;border-radius:2px}"
    ".bar.over i{background:#b5390b}.bar b{position:absolute;top:-3px;bottom:-3px;left:50%;"
    "width:2px;background:#1c2430}"
    ".tag{display:inline-block;font-size:12px;padding:1px 8px;border-radius:9px;"
    "border:1px solid #9aa7b5;color:#45566b;white-space:nowrap}"
    ".tag.good{border-color:#00795a;color:#00795a}.tag.bad{border-color:#b5390b;"
    "background:#b5390b;color:#fff}.tag.odd{border-color:#8a6100;color:#8a6100}"
    ".three{display:grid;grid-template-columns:repeat(3,1fr);gap:6px 18px;align-items:start}"
    ".two{display:grid;grid-template-columns:repeat(2,minmax(0,1fr));gap:0 26px;"
    "align-items:start;font-size:13px}.two .tag{font-size:11px;padding:0 6px}"
    ".two .bar{width:88px}.two th,.two td{padding-right:8px}.v{table-layout:fixed}.v "
    "th:nth-child(1){width:20%}"
    ".v th:nth-child(2),.v th:nth-child(3){width:14%}.v th:nth-child(4){width:22%}"
    ".v th:nth-child(5){width:10%}"
    ".row{display:flex;flex-wrap:wrap;gap:18px;align-items:flex-start}"
    "figure{margin:6px 0;max-width:470px}img{max-width:100%;display:block;border-radius:3px}"
    ".pair figure{max-width:160px}.swatch{display:inline-block;width:12px;height:12px;"
    "border-radius:2px;margin-right:6px}"
    "table.facts th{color:#5a6878;width:170px}table.facts td{font-family:ui-monospace,"
    "'DejaVu Sans Mono',monospace;font-size:13px;word-break:break-all}"
    "@media print{body{padding:0}h2{break-after:avoid}figure,tr{break-inside:avoid}}";

std::string tag(const std::string& text, const char* kind = "") {
  return fmt::format("<span class=\"tag {}\">{}</span>", kind, html_text(text));
}

std::string list_of(const std::vector<std::string>& lines, const char* kind) {
  std::string out = fmt::format("<ul class=\"{}\">", kind);
  for (const std::string& line : lines)
    out += "<li>" + html_text(line) + "</li>";
  return out + "</ul>\n";
}

/// From 0 at the left to twice the limit; the limit is the line in the middle.
std::string limit_bar(double ratio, bool beyond) {
  if (!std::isfinite(ratio)) return "<div class=\"bar\"><b></b></div>";
  return fmt::format("<div class=\"bar{}\"><i style=\"left:0;width:{:.1f}%\"></i><b></b></div>",
                     beyond ? " over" : "", 50 * std::clamp(ratio, 0.0, 2.0));
}

/// From the middle to either side.
std::string shift_bar(double sigmas) {
  if (!std::isfinite(sigmas)) return "<div class=\"bar\"><b></b></div>";
  const double width = 50 * std::min(1.0, std::abs(sigmas) / kShiftSpan);
  return fmt::format("<div class=\"bar\"><i style=\"left:{:.1f}%;width:{:.1f}%\"></i><b></b></div>",
                     sigmas < 0 ? 50 - width : 50.0, width);
}

std::string state_tag(CheckedValue::State state) {
  switch (state) {
    case CheckedValue::State::within:
      return tag("within", "good");
    case CheckedValue::State::beyond:
      return tag("beyond", "bad");
    case CheckedValue::State::unknown:
      break;
  }
  return tag("not known", "odd");
}

std::string header(const ExplainSource& s) {
  const PartResult& r = s.part.result;
  std::string words = verdict_words(r.verdict);
  std::transform(words.begin(), words.end(), words.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  std::string out = fmt::format("<header class=\"{}\"><h1>{}</h1><div class=\"verdict\">{}</div>",
                                to_text(r.verdict), html_text(s.recording), words);
  if (s.recipe != nullptr)
    out += " against recipe <strong>" + html_text(s.recipe->recipe.name) + "</strong>";
  std::vector<std::string> reasons;
  for (const Finding& f : r.findings)
    reasons.push_back(f.text);
  if (!reasons.empty()) {
    out += list_of(reasons, "reasons");
  } else if (r.verdict == Verdict::pass) {
    out +=
        "<p class=\"note\">Every taught material is in its place and every value within its "
        "limit.</p>";
  }
  return out + "</header>\n";
}

std::string missing_section(const ExplainSource& s) {
  const std::vector<std::string> missing = missing_evidence(s.part, s.recipe, s.inspector);
  if (missing.empty()) return {};
  return "<h2>What is missing</h2>\n" + list_of(missing, "missing");
}

std::string cluster_heading(const ExplainSource& s, int index) {
  if (index == kWholePart) return "<h3>The part as a whole</h3>";
  const auto i = static_cast<std::size_t>(index);
  const cv::Vec3b bgr = cluster_colour(i);
  return fmt::format("<h3><span class=\"swatch\" style=\"background:rgb({},{},{})\"></span>{}</h3>",
                     bgr[2], bgr[1], bgr[0], html_text(s.part.result.clusters[i].name));
}

std::string values_section(const ExplainSource& s) {
  const std::vector<CheckedValue> values = checked_values(s.part, s.recipe, s.inspector);
  std::string out = "<h2>Values against their limits</h2>\n";
  if (values.empty()) return out + "<p class=\"note\">Nothing was measured.</p>\n";
  int open = kWholePart - 1;
  for (const CheckedValue& v : values) {
    if (v.cluster != open) {
      if (open >= kWholePart) out += "</tbody></table>\n";
      open = v.cluster;
      out += cluster_heading(s, open) +
             "<table class=\"v\"><thead><tr><th>value</th><th class=\"n\">found</th><th "
             "class=\"n\">limit</th>"
             "<th>of the limit</th><th></th><th></th></tr></thead><tbody>\n";
    }
    out += fmt::format(
        "<tr><th>{}</th><td class=\"n\">{}</td><td class=\"n\">{}</td><td>{}</td><td>{}</td>"
        "<td class=\"note\">{}</td></tr>\n",
        html_text(v.name), html_text(v.value), html_text(v.limit),
        limit_bar(v.ratio, v.state == CheckedValue::State::beyond), state_tag(v.state),
        html_text(v.note));
  }
  return out +
         "</tbody></table>\n<p class=\"note\">A bar ends at twice the limit; the line in its "
         "middle is the limit.</p>\n";
}

std::string changes_of(const TaughtCluster& taught, const ClusterObservation& seen) {
  std::string out =
      "<table><thead><tr><th>change</th><th class=\"n\">from taught</th><th class=\"n\">sigmas"
      "</th><th>-6 to +6</th><th class=\"n\">part of T2</th></tr></thead><tbody>\n";
  for (const MonitoredShift& shift : monitored_shifts(taught, seen)) {
    out += fmt::format(
        "<tr><th>{}</th><td class=\"n\">{:+.2f} %</td><td class=\"n\">{:+.1f}</td><td>{}</td>"
        "<td class=\"n\">{:.2f}</td></tr>\n",
        html_text(shift.name), 100 * shift.change, shift.sigmas, shift_bar(shift.sigmas),
        shift.part);
  }
  return out + "</tbody></table>\n";
}

std::string changes_section(const ExplainSource& s) {
  if (s.recipe == nullptr) return {};
  std::string out;
  for (std::size_t i = 0; i < s.part.observed.size(); ++i) {
    if (!s.part.observed[i] || i >= s.recipe->recipe.clusters.size()) continue;
    const TaughtCluster& taught = s.recipe->recipe.clusters[i];
    if (taught.parts == 0) continue;
    out += "<div>" + cluster_heading(s, static_cast<int>(i)) +
           changes_of(taught, *s.part.observed[i]) + "</div>\n";
  }
  if (out.empty()) return out;
  return "<h2>What changed from the taught material</h2>\n<div class=\"two\">\n" + out + "</div>\n";
}

cv::Mat at_width(const cv::Mat& picture, int interpolation) {
  cv::Mat out;
  const double scale = double(kPictureWidth) / picture.cols;
  cv::resize(picture, out, {}, scale, scale, interpolation);
  return out;
}

std::string residual_pictures(const ExplainSource& s) {
  std::string out;
  if (s.recipe == nullptr || s.part.evidence.lights.empty()) return out;
  const DefectReference& taught = s.recipe->recipe.defects;
  const DefectBlocks& blocks = s.inspector.defect_blocks();
  const std::vector<cv::Mat1f> scores = largest_scores(s.part.evidence, blocks, taught);
  const double limit = taught.limit > 0 ? taught.limit : kUntaughtSpan;
  for (std::size_t l = 0; l < scores.size(); ++l) {
    out += image_tag(
        png_of(draw_defect_scores(scores[l], limit, blocks, s.part.result.defects, kPictureWidth)),
        fmt::format("Residual under light {}: blue darker, red lighter than the taught material, "
                    "full colour at the limit of {:.1f} deviations; grey is not looked at",
                    l + 1, limit));
  }
  return out;
}

std::string legend(const ExplainSource& s) {
  std::string out;
  for (const ClusterResult& c : s.part.result.clusters) {
    const cv::Vec3b bgr = cluster_colour(static_cast<std::size_t>(c.index));
    out += fmt::format(
        "<tr><th><span class=\"swatch\" style=\"background:rgb({},{},{})\"></span>{}</th>"
        "<td class=\"n\">{:.1f} %</td></tr>",
        bgr[2], bgr[1], bgr[0], html_text(c.name), 100 * c.area_share);
  }
  return "<table><thead><tr><th>material</th><th class=\"n\">of the part</th></tr></thead><tbody>" +
         out +
         "<tr><th><span class=\"swatch\" style=\"background:rgb(214,39,40)\"></span>none of the "
         "taught</th><td></td></tr></tbody></table>";
}

std::string pictures_section(const ExplainSource& s) {
  if (s.part.reflectance.size() < 2) return {};
  const std::vector<ClusterResult>& clusters = s.part.result.clusters;
  std::string out = "<h2>Where</h2>\n<div class=\"three\">\n";
  if (std::any_of(clusters.begin(), clusters.end(), [](const auto& c) { return c.present; })) {
    const cv::Mat regions = draw_regions(s.part.result.regions, kNothingGrey);
    out += image_tag(png_of(at_width(regions, cv::INTER_NEAREST)), "Regions of material as found") +
           residual_pictures(s);
  }
  for (std::size_t l = 0; l < 2; ++l) {
    out += image_tag(png_of(at_width(tone_map(s.part.reflectance[l]), cv::INTER_AREA)),
                     fmt::format("Reflectance under light {}, three decades{}", l + 1,
                                 l == 0 ? "; the highlight is here" : ""));
  }
  if (!clusters.empty()) out += "<div>" + legend(s) + "</div>\n";
  return out + "</div>\n";
}

std::string defects_section(const ExplainSource& s) {
  const std::vector<Defect>& defects = s.part.result.defects;
  if (defects.empty()) return {};
  std::string out =
      "<h2>Local defects</h2>\n<table><thead><tr><th>no.</th><th>kind</th><th class=\"n\">x, "
      "mm</th>"
      "<th class=\"n\">y, mm</th><th class=\"n\">size, mm</th><th class=\"n\">change</th>"
      "<th>of the limit</th><th class=\"n\"></th></tr></thead><tbody>\n";
  for (std::size_t i = 0; i < defects.size(); ++i) {
    const Defect& d = defects[i];
    out += fmt::format(
        "<tr><th>{}</th><td>{}</td><td class=\"n\">{:+.1f}</td><td class=\"n\">{:+.1f}</td>"
        "<td class=\"n\">{:.1f}</td><td class=\"n\">{:+.1f} %</td><td>{}</td>"
        "<td class=\"n\">{:.1f} x</td></tr>\n",
        i + 1, html_text(d.kind), d.at_mm[0], d.at_mm[1], d.size_mm, 100 * std::expm1(d.change),
        limit_bar(d.score, d.score > 1), d.score);
  }
  return out + "</tbody></table>\n";
}

std::string sphere_tag(const ExplainSource& s, const Weights& weights, const std::string& caption) {
  return image_tag(png_of(render_sphere(*s.inspector.seen_colour(weights), kSphere)), caption);
}

std::string spheres_section(const ExplainSource& s) {
  std::string out;
  const double to_c = 1 / std::sqrt(double(s.inspector.basis().info().observations));
  for (const ClusterResult& c : s.part.result.clusters) {
    const auto i = static_cast<std::size_t>(c.index);
    out += "<div>" + cluster_heading(s, c.index) + "<div class=\"row pair\">";
    if (s.recipe != nullptr && i < s.recipe->recipe.clusters.size()) {
      Weights taught;
      taught.c = to_c * s.recipe->recipe.clusters[i].mean;
      out += sphere_tag(s, taught, "taught");
    }
    out += c.valid.weights ? sphere_tag(s, c.raw, "found")
                           : "<p class=\"note\">Found: not reconstructed</p>";
    out += "</div></div>\n";
  }
  if (out.empty()) return out;
  return "<h2>What the materials look like</h2>\n<div class=\"row\">\n" + out +
         "</div>\n<p class=\"note\">The reconstructed reflectance on a sphere under a frontal and "
         "a "
         "grazing light.</p>\n";
}

std::string readings_of(const ClusterResult& c, const TaughtCluster* taught) {
  std::string out =
      "<table><thead><tr><th>reading</th><th class=\"n\">found</th><th class=\"n\">90 % interval"
      "</th><th class=\"n\">taught</th><th></th></tr></thead><tbody>\n";
  for (const ReadingWords& r : reading_words(c, taught)) {
    out += fmt::format(
        "<tr><th>{}</th><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>"
        "<td>{}</td></tr>\n",
        html_text(r.name), html_text(r.value),
        html_text(r.interval.empty() ? "not known" : r.interval), html_text(r.taught),
        r.measured ? tag("measured", "good") : tag("extrapolated", "odd"));
  }
  return out + "</tbody></table>\n";
}

std::string readings_section(const ExplainSource& s) {
  std::string out;
  for (const ClusterResult& c : s.part.result.clusters) {
    if (!c.valid.weights) continue;
    const auto i = static_cast<std::size_t>(c.index);
    const bool taught = s.recipe != nullptr && i < s.recipe->recipe.clusters.size();
    out += "<div>" + cluster_heading(s, c.index) +
           readings_of(c, taught ? &s.recipe->recipe.clusters[i] : nullptr) + "</div>\n";
  }
  if (out.empty()) return out;
  return "<h2>Readings</h2>\n<div class=\"two\">\n" + out +
         fmt::format(
             "</div>\n<p class=\"note\">Intervals hold the reconstruction's own uncertainty; what "
             "the "
             "white "
             "reference is uncertain by ({:.1f} % of reflectance) is common to all parts and comes "
             "on top. Measured: the rig looked there. Extrapolated: the basis of measured "
             "materials "
             "says so.</p>\n",
             100 * s.part.result.white_sigma);
}

std::string recipe_rows(const ExplainSource& s) {
  if (s.recipe == nullptr) return fact_row("recipe", "none in force");
  const Recipe& recipe = s.recipe->recipe;
  return fact_row("recipe", fmt::format("{} (number {}), {}, taught from {} parts", recipe.name,
                                        recipe.id, recipe.created, recipe.parts)) +
         (s.recipe_hash.empty() ? std::string() : fact_row("recipe hash", s.recipe_hash)) +
         fact_row("false-reject rate",
                  fmt::format("{:.2g} % of good parts", 100 * recipe.settings.false_reject_rate));
}

std::string provenance_section(const ExplainSource& s) {
  const PartResult& r = s.part.result;
  std::string out = "<h2>Measured with</h2>\n<table class=\"facts\"><tbody>\n" +
                    fact_row("program", "brdfgate " BRDFGATE_VERSION) +
                    fact_row("station hash", s.station_hash) +
                    fact_row("calibration", s.inspector.calibration().created) +
                    fact_row("calibration hash", r.calibration_hash) + recipe_rows(s) +
                    fact_row("basis", s.inspector.basis().info().checksum) +
                    fact_row("estimator", s.inspector.estimator().name());
  if (!s.part.reflectance.empty()) {
    out += fact_row(
        "pose", fmt::format("tilt {:+.2f}, {:+.2f} deg (deviations {:.2f}, {:.2f}); "
                            "shift {:+.2f}, {:+.2f} mm; turned {:+.2f} deg",
                            r.tilt_deg[0], r.tilt_deg[1], r.tilt_sigma_deg[0], r.tilt_sigma_deg[1],
                            r.shift_mm[0], r.shift_mm[1], r.rotation_deg));
  }
  if (s.times.acquisition_ms > 0)
    out += fact_row("acquisition", fmt::format("{:.0f} ms", s.times.acquisition_ms));
  out += fact_row("processing", fmt::format("{:.0f} ms", s.times.processing_ms));
  return out + "</tbody></table>\n";
}

}  // namespace

std::string explain_page(const ExplainSource& s) {
  return html_page(s.recording + ": " + verdict_words(s.part.result.verdict), kStyle,
                   header(s) + missing_section(s) + values_section(s) + changes_section(s) +
                       pictures_section(s) + defects_section(s) + spheres_section(s) +
                       readings_section(s) + provenance_section(s));
}

std::filesystem::path write_explanation(const std::filesystem::path& dir, const ExplainSource& s) {
  const auto file = dir / "explain.html";
  write_text_file(file, explain_page(s));
  return file;
}

}  // namespace brdfgate
