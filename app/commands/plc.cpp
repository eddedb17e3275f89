// brdfgate plc map and plc watch: the register map, and a small PLC stand-in.
#include <fmt/core.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>

#include "app/commands/commands.hpp"
#include "app/plc/plc_bits.hpp"
#include "app/plc/plc_client.hpp"
#include "app/result_json.hpp"
#include "app/session.hpp"
#include "config/register_map.hpp"

namespace brdfgate {
namespace {

struct MapOptions {
  bool csv = false;
  bool markdown = false;
  bool json = false;
};

nlohmann::json map_to_json(const RegisterMap& map) {
  nlohmann::json rows = nlohmann::json::array();
  for (const RegisterRow& row : map.rows()) {
    rows.push_back({{"block", row.block},
                    {"address", row.address},
                    {"type", name_of(row.type)},
                    {"count", row.count},
                    {"name", row.name},
                    {"writable", row.writable},
                    {"repeat", row.repeat},
                    {"stride", row.stride},
                    {"meaning", row.meaning}});
  }
  return {{"schema", "brdfgate.plc_map/1"},
          {"version", fmt::format("{}.{}", kMapVersion >> 8, kMapVersion & 0xFF)},
          {"rows", rows}};
}

void print_map_table(const RegisterMap& map) {
  fmt::print("{:<10} {:>7}  {:<8} {:<19} {}\n", "block", "address", "type", "name", "meaning");
  for (const RegisterRow& row : map.rows()) {
    const std::string type =
        row.count > 1 ? fmt::format("{}[{}]", name_of(row.type), row.count) : name_of(row.type);
    const std::string address = fmt::format("{}{}", row.address, row.repeat > 1 ? "+" : "");
    fmt::print("{:<10} {:>7}  {:<8} {:<19} {}\n", row.block, address, type, row.name, row.meaning);
  }
  for (const RegisterRow& row : map.rows()) {
    if (row.repeat > 1 && row.address == map.block(row.block).address) {
      fmt::print("+: block {} 0..{}, {} registers apart\n", row.block, row.repeat - 1, row.stride);
    }
  }
}

void add_map(CLI::App& plc, int& exit_code) {
  auto options = std::make_shared<MapOptions>();
  CLI::App* command = plc.add_subcommand("map", "print the Modbus register map");
  CLI::Option* csv = command->add_flag("--csv", options->csv,
                                       "as PLC symbols: one line for every element of every block");
  CLI::Option* markdown =
      command->add_flag("--markdown", options->markdown, "as the manual's tables");
  command->add_flag("--json", options->json, "print one JSON document on stdout")
      ->excludes(csv)
      ->excludes(markdown);
  csv->excludes(markdown);
  command->callback([options, &exit_code] {
    const RegisterMap& map = RegisterMap::built_in();
    if (options->json) {
      fmt::print("{}\n", map_to_json(map).dump(2));
    } else if (options->csv) {
      fmt::print("{}", map.symbols_csv());
    } else if (options->markdown) {
      fmt::print("{}", map.markdown());
    } else {
      print_map_table(map);
    }
    exit_code = kExitYes;
  });
}

struct WatchOptions {
  PlcClientSettings client;
  std::vector<std::uint32_t> triggers;
  std::uint32_t count = 1;
  int recipe = 0;
  bool recipe_given = false;
  std::string word_order = "abcd";
  double timeout_s = 30;
  bool json = false;
};

std::string joined(const std::vector<std::string>& words) {
  return std::accumulate(
      words.begin(), words.end(), std::string(),
      [](const std::string& a, const std::string& b) { return a.empty() ? b : a + ", " + b; });
}

void print_head() {
  fmt::print("{:>10} {:>10} {:<10} {:>8} {:>8} {:>7} {:>7} {:>7}  {}\n", "trigger_id", "result_id",
             "verdict", "T2 ratio", "SPE rat.", "acq ms", "proc ms", "cyc ms", "reasons");
}

void print_part(const PlcPart& part) {
  fmt::print("{:>10} {:>10} {:<10} {:>8.3f} {:>8.3f} {:>7} {:>7} {:>7}  {}\n", part.trigger_id,
             part.result_id, to_text(part.verdict), part.t2_ratio, part.spe_ratio,
             part.acquisition_ms, part.processing_ms, part.cycle_ms,
             joined(reasons_in_words(part.reason_bits)));
  for (const PlcCluster& c : part.clusters) {
    fmt::print("    cluster {}: {:5.1f} %, first weights", c.index, 100 * c.area_share);
    if ((c.valid_bits & valid_bit::kWeights) == 0) {
      fmt::print(" not valid\n");
      continue;
    }
    for (std::size_t i = 0; i < 3; ++i)
      fmt::print(" {:+.3f}", c.weights[i]);
    fmt::print(" (channel 1), uncertainty {:.3f}, gloss 60: {:.1f} GU\n", c.weight_uncertainty,
               c.gloss_gu[1]);
  }
  std::fflush(stdout);
}

nlohmann::json cluster_to_json(const PlcCluster& c) {
  return {{"index", c.index},
          {"valid_bits", c.valid_bits},
          {"pixels", c.pixels},
          {"area_share", c.area_share},
          {"t2", c.t2},
          {"spe", c.spe},
          {"gloss_gu", {{"20", c.gloss_gu[0]}, {"60", c.gloss_gu[1]}, {"85", c.gloss_gu[2]}}},
          {"lab", c.lab},
          {"delta_e00", c.delta_e00},
          {"weight_uncertainty", c.weight_uncertainty},
          {"weights", c.weights}};
}

nlohmann::json part_to_json(const PlcPart& part) {
  nlohmann::json clusters = nlohmann::json::array();
  for (const PlcCluster& c : part.clusters)
    clusters.push_back(cluster_to_json(c));
  return {{"trigger_id", part.trigger_id},
          {"result_id", part.result_id},
          {"sequence", part.sequence},
          {"result_state", part.result_state},
          {"verdict", to_text(part.verdict)},
          {"reasons", reasons_in_words(part.reason_bits)},
          {"reason_bits", part.reason_bits},
          {"worst_cluster", part.worst_cluster},
          {"t2_ratio", part.t2_ratio},
          {"spe_ratio", part.spe_ratio},
          {"tilt_deg", part.tilt_deg},
          {"ambient", part.ambient},
          {"defects", part.defects},
          {"acquisition_ms", part.acquisition_ms},
          {"processing_ms", part.processing_ms},
          {"cycle_ms", part.cycle_ms},
          {"clusters", clusters}};
}

int watch(WatchOptions& options) {
  options.client.word_order = options.word_order == "cdab" ? WordOrder::cdab : WordOrder::abcd;
  options.client.step_timeout =
      std::chrono::milliseconds(static_cast<std::int64_t>(1000 * options.timeout_s));
  if (options.triggers.empty()) {
    options.triggers.resize(options.count);
    std::iota(options.triggers.begin(), options.triggers.end(), 1u);
  }
  PlcClient client(options.client);
  client.read_station();
  client.enable();
  if (options.recipe_given) client.select_recipe(static_cast<std::uint16_t>(options.recipe));
  std::vector<Verdict> verdicts;
  nlohmann::json parts = nlohmann::json::array();
  if (!options.json) print_head();
  for (const std::uint32_t id : options.triggers) {
    const PlcPart part = client.inspect(id);
    verdicts.push_back(part.verdict);
    if (options.json) {
      parts.push_back(part_to_json(part));
    } else {
      print_part(part);
    }
  }
  client.release();
  if (options.json) {
    const nlohmann::json document = {{"schema", "brdfgate.plc_watch/1"}, {"parts", parts}};
    fmt::print("{}\n", document.dump(2));
  }
  return exit_code_of(verdicts);
}

void add_watch(CLI::App& plc, int& exit_code) {
  auto options = std::make_shared<WatchOptions>();
  CLI::App* command = plc.add_subcommand(
      "watch", "stand in for the PLC: trigger, wait, read and acknowledge part after part");
  command->add_option("host", options->client.host, "name or address of the gate")->required();
  command->add_option("--port", options->client.port, "Modbus TCP port")
      ->check(CLI::Range(1, 65535))
      ->capture_default_str();
  command->add_option("--unit", options->client.unit_id, "unit identifier")
      ->check(CLI::Range(1, 247))
      ->capture_default_str();
  CLI::Option* triggers =
      command->add_option("--trigger", options->triggers, "trigger_id of each part");
  command->add_option("--count", options->count, "number of parts, with trigger_id 1, 2, ...")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str()
      ->excludes(triggers);
  CLI::Option* recipe = command->add_option("--recipe", options->recipe, "select this recipe first")
                            ->check(CLI::Range(0, 65535));
  command->add_option("--word-order", options->word_order, "of 32-bit values, as configured there")
      ->check(CLI::IsMember({"abcd", "cdab"}))
      ->capture_default_str();
  command->add_option("--timeout", options->timeout_s, "seconds for each step of the handshake")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  command->add_flag("--json", options->json, "print one JSON document on stdout");
  command->callback([options, recipe, &exit_code] {
    options->recipe_given = recipe->count() > 0;
    exit_code = watch(*options);
  });
}

}  // namespace

void add_plc(CLI::App& tool, int& exit_code) {
  CLI::App* plc = tool.add_subcommand("plc", "the PLC's interface");
  plc->require_subcommand(1);
  add_map(*plc, exit_code);
  add_watch(*plc, exit_code);
}

}  // namespace brdfgate
