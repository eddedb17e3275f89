// How often the gate rejects good parts and how often it finds bad ones, in simulated production.
//
//   stability --config STATION [--only KIND] [--fault NAME...] [--good 1500] [--bad 300] [--some
//   60] --out DIR
//
// Every part is rendered, captured and measured once; teaching sets drawn from the pool of good
// parts, limits and verdicts are then matrix work. Bins and monitored directions are those of one
// recipe taught from twelve other parts. Prints Markdown; DIR gets CSV and pictures.
#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <numeric>
#include <random>

#include "app/plot.hpp"
#include "app/session.hpp"
#include "app/teacher.hpp"
#include "tests/stability/production.hpp"

namespace {

using namespace brdfgate;
using namespace brdfgate::stability;

constexpr std::uint64_t kTeachSeed = 7, kGoodSeed = 1, kBadSeed = 2;
constexpr int kFirstTaught = 12;
constexpr double kRates[] = {0.001, 0.01};

struct Options {
  SessionOptions session;
  std::string only;
  std::vector<std::string> only_faults;  ///< empty: all
  std::filesystem::path out = ".";
  int good = 1500, bad = 300, some = 60, sets = 50, taught = 50;
};

/// One-sided 95 % bounds of a share seen k times (perhaps not whole) of n: Wilson's interval.
double lower_bound(double k, double n) {
  constexpr double z = 1.645;
  const double p = k / n, d = 1 + z * z / n;
  if (k >= n) return std::pow(0.05, 1 / n);  // exact
  return std::max(0.0,
                  (p + z * z / (2 * n) - z * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n))) / d);
}
double upper_bound(double k, double n) {
  return 1 - lower_bound(n - k, n);
}

/// A part's verdict by one recipe.
struct Judged {
  Verdict verdict = Verdict::none;
  ReasonBits bits = 0;
  double ratio =
      0;  ///< largest of T2 and SPE over its limit; infinite where another reason rejects
};

Judged judge_part(const Recipe& recipe, const MeasuredPart& part) {
  std::vector<ClusterResult> clusters = part.clusters;
  const Judgement j = judge(&recipe, recipe.settings, clusters, part.observed, part.facts);
  constexpr ReasonBits kOther =
      kRejectBits & static_cast<ReasonBits>(~(bit(Reason::t2) | bit(Reason::spe)));
  const double ratio = (j.reason_bits & kOther) != 0 ? std::numeric_limits<double>::infinity()
                                                     : std::max(j.t2_ratio, j.spe_ratio);
  return {j.verdict, j.reason_bits, ratio};
}

TaughtCluster taught_from(const std::vector<const MeasuredPart*>& parts, std::size_t cluster,
                          const Recipe& first, const JudgeSettings& settings) {
  std::vector<ClusterObservation> seen;
  for (const MeasuredPart* part : parts)
    if (part->observed[cluster]) seen.push_back(*part->observed[cluster]);
  TaughtCluster taught = teach_observed(seen, settings, static_cast<int>(first.clusters.size()));
  const double n = double(parts.size());
  taught.name = first.clusters[cluster].name;
  taught.directions = first.clusters[cluster].directions;
  for (const MeasuredPart* part : parts) {
    const ClusterResult& c = part->clusters[cluster];
    taught.area_share += c.area_share / n;
    taught.lab += c.lab / n;
    for (std::size_t g = 0; g < 3; ++g)
      taught.gloss_gu[g] += c.gloss_gu[g] / n;
  }
  return taught;
}

Recipe recipe_from(const std::vector<const MeasuredPart*>& parts, const Recipe& first,
                   double rate) {
  Recipe recipe = first;
  recipe.settings.false_reject_rate = rate;
  recipe.parts = static_cast<int>(parts.size());
  for (std::size_t i = 0; i < recipe.clusters.size(); ++i)
    recipe.clusters[i] = taught_from(parts, i, first, recipe.settings);
  return recipe;
}

/// One teaching set's recipe at each rate, and which pool parts it was taught from.
struct TeachingSet {
  std::vector<Recipe> recipes;
  std::vector<char> used;
};

std::vector<TeachingSet> draw_sets(const std::vector<MeasuredPart>& pool, const Recipe& first,
                                   const Options& options) {
  std::mt19937 random(50);
  std::vector<std::size_t> order(pool.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::vector<TeachingSet> sets;
  for (int s = 0; s < options.sets; ++s) {
    std::shuffle(order.begin(), order.end(), random);
    TeachingSet set;
    set.used.assign(pool.size(), 0);
    std::vector<const MeasuredPart*> parts;
    for (int i = 0; i < options.taught; ++i) {
      parts.push_back(&pool[order[std::size_t(i)]]);
      set.used[order[std::size_t(i)]] = 1;
    }
    for (const double rate : kRates)
      set.recipes.push_back(recipe_from(parts, first, rate));
    sets.push_back(std::move(set));
  }
  return sets;
}

/// Shares of verdicts over parts and sets at one rate.
struct Tally {
  double rejected = 0, not_judged = 0, judged = 0;
  std::map<int, double> by_bit;
  std::vector<double> ratios;
  std::size_t parts = 0;

  double share() const { return rejected / std::max(1.0, judged); }
  /// Rejected parts out of `parts`: sets judge the same parts, they are not independent.
  double equivalent() const { return share() * double(parts); }
};

Tally tally(const std::vector<MeasuredPart>& parts, const std::vector<TeachingSet>& sets,
            std::size_t rate, bool pool) {
  Tally t;
  t.parts = parts.size();
  for (const TeachingSet& set : sets) {
    for (std::size_t i = 0; i < parts.size(); ++i) {
      if (pool && set.used[i]) continue;
      const Judged j = judge_part(set.recipes[rate], parts[i]);
      ++t.judged;
      t.rejected += j.verdict == Verdict::reject;
      t.not_judged += j.verdict == Verdict::not_judged;
      for (int b = 0; b < 16; ++b)
        if (j.bits >> b & 1) t.by_bit[b] += 1;
      t.ratios.push_back(j.ratio);
    }
  }
  return t;
}

std::string bits_text(const Tally& t) {
  static const char* names[] = {"T2",       "SPE",    "defect",  "missing", "unknown",  "colour",
                                "gloss",    "tilt",   "ambient", "clipped", "coverage", "basis",
                                "hardware", "absent", "pose",    "recipe"};
  std::string text;
  for (const auto& [b, n] : t.by_bit)
    text += fmt::format("{}{} {:.2f} %", text.empty() ? "" : ", ", names[b], 100 * n / t.judged);
  return text;
}

/// Detection against false rejects as the limits are scaled together.
PlotSeries roc(const std::string& label, std::vector<double> good, std::vector<double> bad) {
  std::sort(good.begin(), good.end(), std::greater<>());
  std::sort(bad.begin(), bad.end());
  PlotSeries s{label, {}, {}, PlotSeries::Style::Lines};
  for (double x = 1.0 / double(good.size()); x <= 1; x *= 1.1) {
    const auto rank = std::min(good.size() - 1, std::size_t(x * double(good.size())));
    const auto above = bad.end() - std::upper_bound(bad.begin(), bad.end(), good[rank]);
    s.x.push_back(x);
    s.y.push_back(double(above) / double(bad.size()));
  }
  return s;
}

struct Study {
  const Options& options;
  const StationConfig& config;
  const Inspector& inspector;
  std::ofstream csv;
};

void print_taught(const Kind& kind, const TeachingSet& set) {
  for (const TaughtCluster& c : set.recipes[0].clusters) {
    fmt::print(
        "\n{} / {}: {} monitored directions, T2 limit {:.1f} (0.1 %) and {:.1f} (1 %); "
        "part-to-part deviations",
        kind.name, c.name, c.directions.size(), c.t2_limit,
        set.recipes[1].clusters[std::size_t(&c - set.recipes[0].clusters.data())].t2_limit);
    for (Eigen::Index i = 0; i < c.directions.size(); ++i)
      fmt::print(", {} {:.2f} %", c.directions.names[std::size_t(i)],
                 100 * std::sqrt(c.monitored_covariance(i, i)));
    fmt::print("; area {:.1f} %, SPE limit {:.2f}\n", 100 * c.area_share, c.spe_limit);
  }
}

std::vector<Fault> faults_asked(const Study& study, const Kind& kind) {
  std::vector<Fault> all = faults(kind, study.config);
  const std::vector<std::string>& asked = study.options.only_faults;
  std::erase_if(all, [&asked](const Fault& f) {
    return !asked.empty() && std::find(asked.begin(), asked.end(), f.name) == asked.end();
  });
  return all;
}

/// A point of the fault's curve; one of a single size has none.
void add_detection(Plot& plot, const Fault& fault, double share) {
  if (fault.size == 1) return;
  if (plot.series.empty() || plot.series.back().label != fault.name)
    plot.series.push_back({fault.name, {}, {}, PlotSeries::Style::LinesPoints});
  plot.series.back().x.push_back(fault.size);
  plot.series.back().y.push_back(share);
}

void run_faults(Study& study, const Kind& kind, const RecipeInForce& force,
                const std::vector<TeachingSet>& sets, const Tally& good) {
  Plot detection{"Detected share, " + kind.name,
                 "size of the change over the size to find",
                 "detected",
                 {},
                 {},
                 {},
                 true,
                 false};
  Plot curves{"ROC of T2 and SPE with the other reasons, " + kind.name,
              "false rejects",
              "detected",
              {},
              {},
              {},
              true,
              false};
  const std::vector<Fault> all = faults_asked(study, kind);
  fmt::print(
      "\n| {} | size | parts | detected at 0.1 % | lower 95 % bound | at 1 % | reasons |\n"
      "|---|---|---|---|---|---|---|\n",
      kind.name);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const bool last = i + 1 == all.size() || all[i + 1].name != all[i].name;
    const int n = last ? study.options.bad : study.options.some;
    const auto parts =
        produce(all[i], study.config, study.inspector, &force, {kBadSeed + 10 * i, n});
    const Tally strict = tally(parts, sets, 0, false), loose = tally(parts, sets, 1, false);
    fmt::print("| {} | {:g} | {} | {:.2f} % | {:.2f} % | {:.2f} % | {} |\n", all[i].name,
               all[i].size, n, 100 * strict.share(), 100 * lower_bound(strict.equivalent(), n),
               100 * loose.share(), bits_text(strict));
    std::fflush(stdout);
    study.csv << kind.name << ',' << all[i].name << ',' << all[i].size << ',' << n << ','
              << strict.share() << ',' << loose.share() << '\n';
    add_detection(detection, all[i], strict.share());
    // What is always or never found draws no curve.
    if (const double share = strict.share(); share > 0.001 && share < 0.999)
      curves.series.push_back(
          roc(fmt::format("{} {:g}", all[i].name, all[i].size), good.ratios, strict.ratios));
    if (last && !detection.series.empty() && detection.series.back().label == all[i].name)
      for (double& x : detection.series.back().x)
        x /= all[i].size;
  }
  if (!detection.series.empty())
    write_plot(detection, study.options.out / ("gate-detection-" + kind.name + ".png"));
  if (!curves.series.empty())
    write_plot(curves, study.options.out / ("gate-roc-" + kind.name + ".png"));
}

void run(Study& study, const Kind& kind) {
  Teacher teacher(study.inspector);
  for (int i = 0; i < kFirstTaught; ++i)
    teacher.add(kind.name, capture(kind.good, study.config, kTeachSeed, i));
  const RecipeInForce force = study.inspector.bring_into_force(teacher.recipe(kind.name, 1));
  const auto pool = produce({"good", 0, kind.good}, study.config, study.inspector, &force,
                            {kGoodSeed, study.options.good});
  const auto sets = draw_sets(pool, force.recipe, study.options);
  print_taught(kind, sets.front());
  const StationConfig& config = study.config;
  const auto shiny = [&](double share) {
    return places_of(kind.good, config.simulator.geometry, config.camera.sensor, share).size();
  };
  fmt::print("{}: the specular share is 30 % or more in one light on {:.0f} % of the part\n",
             kind.name, 100.0 * double(shiny(0.3)) / double(shiny(0)));
  Tally good;
  for (std::size_t rate = 0; rate < std::size(kRates); ++rate) {
    const Tally t = tally(pool, sets, rate, true);
    fmt::print(
        "{}: {} good parts, {} sets of {}: at {} % rejected {:.3f} % (upper 95 % bound "
        "{:.2f} %), not judged {:.3f} %: {}\n",
        kind.name, pool.size(), sets.size(), study.options.taught, 100 * kRates[rate],
        100 * t.share(), 100 * upper_bound(t.equivalent(), double(t.parts)),
        100 * t.not_judged / t.judged, bits_text(t));
    study.csv << kind.name << ",good," << kRates[rate] << ',' << pool.size() << ',' << t.share()
              << ",\n";
    if (rate == 0) good = t;
  }
  std::fflush(stdout);
  run_faults(study, kind, force, sets, good);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("False rejects and detected faults in simulated production");
  Options options;
  options.session.add_to(app);
  options.session.add_overrides_to(app);
  app.add_option("--only", options.only, "one kind of part");
  app.add_option("--fault", options.only_faults, "these ways to go wrong only, e.g. stain dull");
  app.add_option("--good", options.good, "good parts in the pool");
  app.add_option("--bad", options.bad, "parts of each fault's largest size");
  app.add_option("--some", options.some, "parts of each smaller size");
  app.add_option("--sets", options.sets, "teaching sets drawn");
  app.add_option("--out", options.out, "folder of CSV and pictures");
  if (const auto code = parse_command_line(app, argc, argv)) return *code;
  try {
    const StationConfig config = load_config(options.session);
    const Inspector inspector = load_inspector(config);
    std::filesystem::create_directories(options.out);
    Study study{options, config, inspector,
                std::ofstream(options.out / ("gate" + options.only + ".csv"))};
    study.csv << "kind,fault,size,parts,at_0.1_percent,at_1_percent\n";
    for (const Kind& kind : kinds())
      if (options.only.empty() || options.only == kind.name) run(study, kind);
    return 0;
  } catch (const std::exception& error) {
    fmt::print(stderr, "stability: {}\n", error.what());
    return 2;
  }
}
