// brdfgate compare: how far are two BRDFs apart?
#include <fmt/core.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "app/commands/commands.hpp"
#include "app/session.hpp"
#include "model/colour.hpp"
#include "model/readings.hpp"
#include "model/reconstruction.hpp"

namespace brdfgate {
namespace {

struct Comparison {
  BrdfDifference difference;
  std::array<double, 3> gloss_a;
  std::array<double, 3> gloss_b;
  double delta_e00;
};

Comparison compare_files(const std::filesystem::path& a_file, const std::filesystem::path& b_file) {
  const auto a = MerlBrdf::open(a_file);
  const auto b = MerlBrdf::open(b_file);
  return {compare(*a, *b), gloss_gu(*a), gloss_gu(*b), delta_e00(lab_45_0(*a), lab_45_0(*b))};
}

nlohmann::json to_json(const Comparison& c) {
  nlohmann::json gloss = nlohmann::json::array();
  for (std::size_t i = 0; i < c.gloss_a.size(); ++i)
    gloss.push_back({{"a", c.gloss_a[i]}, {"b", c.gloss_b[i]}});
  return {{"schema", "brdfgate.compare/1"},
          {"mapped_rms", c.difference.mapped_rms},
          {"mapped_rms_per_channel", c.difference.mapped_rms_per_channel},
          {"missing_cells", c.difference.missing_cells},
          {"gloss_gu", gloss},
          {"delta_e00", c.delta_e00}};
}

void print(const Comparison& c) {
  const auto& rms = c.difference.mapped_rms_per_channel;
  fmt::print("mapped RMS     {:.4f} (R {:.4f}, G {:.4f}, B {:.4f})\n", c.difference.mapped_rms,
             rms[0], rms[1], rms[2]);
  if (c.difference.missing_cells > 0) {
    fmt::print("missing cells  {} (each counts as an error of 5)\n", c.difference.missing_cells);
  }
  constexpr std::array<int, 3> kDegrees{20, 60, 85};
  for (std::size_t i = 0; i < kDegrees.size(); ++i) {
    fmt::print("gloss {} deg   {:.1f} GU, {:.1f} GU\n", kDegrees[i], c.gloss_a[i], c.gloss_b[i]);
  }
  fmt::print("colour 45:0    CIEDE2000 {:.2f}\n", c.delta_e00);
}

}  // namespace

void add_compare(CLI::App& tool, int& exit_code) {
  struct Options {
    std::filesystem::path a;
    std::filesystem::path b;
    bool json = false;
  };
  auto options = std::make_shared<Options>();
  CLI::App* command =
      tool.add_subcommand("compare", "two BRDFs (MERL .binary): mapped RMS, gloss, colour");
  command->add_option("a", options->a, "MERL .binary")->required();
  command->add_option("b", options->b, "MERL .binary")->required();
  command->add_flag("--json", options->json, "print one JSON document on stdout");
  command->callback([options, &exit_code] {
    const Comparison c = compare_files(options->a, options->b);
    if (options->json) {
      fmt::print("{}\n", to_json(c).dump(2));
    } else {
      print(c);
    }
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
