#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

#include "catch.hpp"
#include "config/register_map.hpp"
#include "support/input_error.hpp"
#include "support/shipped.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

const std::string kHead = "block,address,type,count,name,access,meaning\n";

std::string parse_error(const std::string& rows) {
  return input_error([&] { return RegisterMap::parse(kHead + rows, "map.csv"); });
}

std::string read(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  INFO(file.string());
  REQUIRE(in);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::filesystem::path source_root() {
  return shipped_file("..");
}

}  // namespace

TEST_CASE("The table that the programs carry is the one in the source tree") {
  CHECK(RegisterMap::built_in_csv() == read(source_root() / "config" / "modbus_map.csv"));
}

TEST_CASE("The manual's tables are the ones that the map makes") {
  const std::string manual = read(source_root() / "docs" / "plc-map.md");
  const std::string begin = "<!-- brdfgate plc map --markdown -->\n";
  const std::string end = "<!-- end -->";
  const std::size_t from = manual.find(begin);
  REQUIRE(from != std::string::npos);
  const std::size_t to = manual.find(end, from);
  REQUIRE(to != std::string::npos);
  CHECK(manual.substr(from + begin.size(), to - from - begin.size()) ==
        RegisterMap::built_in().markdown());
}

TEST_CASE("Version 1.0 of the map keeps its addresses") {
  const RegisterMap& map = RegisterMap::built_in();
  struct Row {
    const char* key;
    int instance;
    int address;
    RegisterType type;
    int count;
  };
  using T = RegisterType;
  for (const Row& row :
       std::initializer_list<Row>{{"station.magic", 0, 0, T::u32, 1},
                                  {"station.map_version", 0, 2, T::u16, 1},
                                  {"station.state", 0, 3, T::u16, 1},
                                  {"station.status_bits", 0, 4, T::u16, 1},
                                  {"station.heartbeat", 0, 5, T::u16, 1},
                                  {"station.error_code", 0, 6, T::u16, 1},
                                  {"station.warning_bits", 0, 7, T::u16, 1},
                                  {"station.recipe_id", 0, 8, T::u16, 1},
                                  {"station.config_hash", 0, 9, T::u16, 4},
                                  {"station.clusters", 0, 13, T::u16, 1},
                                  {"station.components", 0, 14, T::u16, 1},
                                  {"station.channels", 0, 15, T::u16, 1},
                                  {"station.uptime_s", 0, 16, T::u32, 1},
                                  {"counters.inspected", 0, 40, T::u32, 1},
                                  {"counters.clients_refused", 0, 54, T::u32, 1},
                                  {"check.float_check", 0, 90, T::f32, 1},
                                  {"check.word_check", 0, 92, T::u32, 1},
                                  {"result.seq_head", 0, 100, T::u32, 1},
                                  {"result.trigger_id", 0, 102, T::u32, 1},
                                  {"result.result_id", 0, 104, T::u32, 1},
                                  {"result.result_state", 0, 106, T::u16, 1},
                                  {"result.verdict", 0, 107, T::u16, 1},
                                  {"result.reason_bits", 0, 108, T::u16, 1},
                                  {"result.worst_cluster", 0, 109, T::u16, 1},
                                  {"result.t2_ratio", 0, 110, T::f32, 1},
                                  {"result.spe_ratio", 0, 112, T::f32, 1},
                                  {"result.tilt_x_deg", 0, 114, T::f32, 1},
                                  {"result.tilt_y_deg", 0, 116, T::f32, 1},
                                  {"result.ambient", 0, 118, T::f32, 1},
                                  {"result.acquisition_ms", 0, 120, T::u16, 1},
                                  {"result.processing_ms", 0, 121, T::u16, 1},
                                  {"result.cycle_ms", 0, 122, T::u16, 1},
                                  {"result.defects", 0, 123, T::u16, 1},
                                  {"result.seq_tail", 0, 124, T::u32, 1},
                                  {"cluster.seq_head", 0, 200, T::u32, 1},
                                  {"cluster.valid_bits", 1, 302, T::u16, 1},
                                  {"cluster.pixels_16", 2, 403, T::u16, 1},
                                  {"cluster.gloss_85", 7, 914, T::f32, 1},
                                  {"cluster.weight_uncertainty", 0, 224, T::f32, 1},
                                  {"cluster.weights", 7, 926, T::f32, 24},
                                  {"cluster.seq_tail", 7, 974, T::u32, 1},
                                  {"control.command_bits", 0, 1000, T::u16, 1},
                                  {"control.trigger_id", 0, 1001, T::u32, 1},
                                  {"control.recipe", 0, 1003, T::u16, 1},
                                  {"control.plc_heartbeat", 0, 1004, T::u16, 1},
                                  {"coil.recipe_select", 0, 4, T::bit, 1},
                                  {"discrete.time_valid", 0, 13, T::bit, 1}}) {
    INFO(row.key);
    const RegisterField field = map.field(row.key, row.instance);
    CHECK(field.address == row.address);
    CHECK(field.type == row.type);
    CHECK(field.count == row.count);
  }
  CHECK(map.block("result").address == 100);
  CHECK(map.block("result").count == 26);
  CHECK(map.block("cluster", 7).address == 900);
  CHECK(map.block("cluster", 7).count == 76);
  CHECK(map.instances("cluster") == 8);
}

TEST_CASE("Every discrete input and coil is named like its bit") {
  const RegisterMap& map = RegisterMap::built_in();
  const auto meaning = [&](const std::string& block, const std::string& name) {
    for (const RegisterRow& row : map.rows()) {
      if (row.block == block && row.name == name) return row.meaning;
    }
    return std::string();
  };
  for (const RegisterRow& row : map.rows()) {
    if (row.type != RegisterType::bit || row.name == "reserved") continue;
    const std::string bits =
        row.writable ? meaning("control", "command_bits") : meaning("station", "status_bits");
    INFO(row.name);
    CHECK(contains(bits, std::to_string(row.address) + " " + row.name));
  }
}

TEST_CASE("Symbols name every element of every block once, with its own address") {
  const std::string csv = RegisterMap::built_in().symbols_csv();
  CHECK(contains(csv, "\ncluster7_weights_23,input,972,f32,r,"));
  CHECK(contains(csv, "\nstation_config_hash_3,input,12,u16,r,"));
  CHECK(contains(csv, "\ncontrol_trigger_id,holding,1001,u32,rw,"));
  CHECK(contains(csv, "\ndiscrete_ready,discrete,0,bit,r,"));
  CHECK(contains(csv, "\ncoil_trigger,coil,1,bit,rw,"));
  std::set<std::string> symbols;
  std::size_t lines = 0;
  for (std::size_t at = 0; at < csv.size(); at = csv.find('\n', at) + 1, ++lines) {
    symbols.insert(csv.substr(at, csv.find(',', at) - at));
  }
  CHECK(symbols.size() == lines);
}

TEST_CASE("Quoted fields keep their commas and quotes") {
  const RegisterMap map =
      RegisterMap::parse(kHead + "a,1,u16,1,x,r,\"one, \"\"two\"\"\"\n", "map.csv");
  CHECK(map.rows().at(0).meaning == "one, \"two\"");
  CHECK(contains(map.symbols_csv(), "a_x,input,1,u16,r,\"one, \"\"two\"\"\""));
}

TEST_CASE("A table that cannot be right is refused by line and reason") {
  CHECK(contains(parse_error("a,1,u16,1,x,r\n"), "map.csv:2"));
  CHECK(contains(parse_error("a,one,u16,1,x,r,m\n"), "address is 'one'"));
  CHECK(contains(parse_error("a,-1,u16,1,x,r,m\n"), "address is '-1'"));
  CHECK(contains(parse_error("a,1,i16,1,x,r,m\n"), "type is 'i16'"));
  CHECK(contains(parse_error("a,1,u16,1,x,w,m\n"), "access is 'w'"));
  CHECK(contains(parse_error("a,1,u16,0,x,r,m\n"), "count of 0"));
  CHECK(contains(parse_error("a,1,u16,1,,r,m\n"), "empty"));
  CHECK(contains(parse_error("a x8,1,u16,1,x,r,m\n"), "xCOUNT +STRIDE"));
  CHECK(contains(parse_error("a,1,u32,1,x,r,m\na,2,u16,1,y,r,m\n"), "map.csv:3: y overlaps"));
  CHECK(contains(parse_error("a x2 +1,1,u32,1,x,r,m\n"), "overlaps"));
  CHECK(contains(parse_error("a,1,u16,1,x,r,m\na,2,u16,1,x,r,m\n"), "named twice"));
  CHECK(contains(parse_error("a,999,u32,1,x,r,m\n"), "999 is out of range"));
  CHECK(contains(parse_error("a,999,u16,1,x,rw,m\n"), "1000 to 1004"));
  CHECK(contains(parse_error("a,1004,u32,1,x,rw,m\n"), "1004 is out of range"));
  CHECK(contains(parse_error("a,5,bit,1,x,rw,m\n"), "0 to 4"));
  CHECK(contains(parse_error("a,16,bit,1,x,r,m\n"), "0 to 15"));
  CHECK(contains(parse_error("a,0,u16,126,x,r,m\n"), "126 registers"));
  CHECK(contains(parse_error("a,0,u32,1,seq_head,r,m\na,2,u16,1,x,r,m\n"), "seq_head first"));
  CHECK(contains(parse_error("a,0,u16,1,x,r,m\na,1,u32,1,seq_head,r,m\na,3,u32,1,seq_tail,r,m\n"),
                 "seq_head first"));
  CHECK(contains(parse_error(""), "no rows"));
  CHECK(contains(input_error([] { return RegisterMap::parse("x\n", "map.csv"); }), "header"));
}

TEST_CASE("Fields and blocks that do not exist are refused by name") {
  const RegisterMap& map = RegisterMap::built_in();
  CHECK(
      contains(input_error([&] { return map.field("result.nothing").address; }), "result.nothing"));
  CHECK(contains(input_error([&] { return map.field("cluster.t2", 8).address; }), "instance 8"));
  CHECK(contains(input_error([&] { return map.block("nothing").address; }), "nothing"));
  CHECK(contains(input_error([&] { return map.instances("nothing"); }), "nothing"));
}
