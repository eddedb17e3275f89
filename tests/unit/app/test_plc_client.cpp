// The whole PLC side over a real socket: our gate and server, libmodbus's client.
#include <array>
#include <thread>

#include "app/plc/plc_bits.hpp"
#include "app/plc/plc_client.hpp"
#include "app/plc/plc_gate.hpp"
#include "catch.hpp"
#include "hal/modbus/tcp_server.hpp"
#include "support/input_error.hpp"
#include "support/plc_part.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using std::chrono::milliseconds;

namespace {

PlcGateSettings gate_settings(WordOrder order) {
  PlcGateSettings settings;
  settings.word_order = order;
  return settings;
}

TcpServerSettings server_settings() {
  TcpServerSettings settings;
  settings.port = 0;
  return settings;
}

/// A daemon that judges by trigger_id: the verdict is its remainder by 4, 0 an abort.
class ScriptedStation {
 public:
  explicit ScriptedStation(WordOrder order = WordOrder::abcd)
      : gate_(RegisterMap::built_in(), gate_settings(order), {}),
        server_(server_settings(), gate_, gate_) {
    status_.state = StationState::ready;
    gate_.set_station(status_);
    gate_.set_recipes({5});
    thread_ = std::jthread([this](std::stop_token stop) { work(stop); });
  }
  ~ScriptedStation() {
    thread_.request_stop();
    gate_.wake();
  }
  ScriptedStation(const ScriptedStation&) = delete;
  ScriptedStation& operator=(const ScriptedStation&) = delete;

  PlcClientSettings client(WordOrder order = WordOrder::abcd) const {
    PlcClientSettings settings;
    settings.port = server_.port();
    settings.word_order = order;
    settings.step_timeout = milliseconds(5000);
    settings.scan = milliseconds(0);
    return settings;
  }
  PlcGate& gate() { return gate_; }

 private:
  void work(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      const PlcCommand command = gate_.wait_for_command(milliseconds(1000));
      if (const auto* recipe = std::get_if<RecipeSelected>(&command)) {
        status_.recipe_id = recipe->recipe;
        gate_.set_station(status_);
      }
      if (const auto* trigger = std::get_if<TriggerAccepted>(&command)) judge(trigger->trigger_id);
    }
  }
  void judge(std::uint32_t id) {
    gate_.acquisition_done();
    if (id % 4 == 0) {
      gate_.abort(bit(Reason::part_absent), ResultState::aborted);
    } else {
      gate_.publish(scripted_part(static_cast<Verdict>(id % 4)));
    }
  }

  StationStatus status_;
  PlcGate gate_;
  TcpServer server_;
  std::jthread thread_;
};

}  // namespace

TEST_CASE("A PLC over libmodbus goes through whole handshakes, in both word orders") {
  for (const WordOrder order : {WordOrder::abcd, WordOrder::cdab}) {
    ScriptedStation station(order);
    PlcClient client(station.client(order));
    client.read_station();
    client.enable();
    std::uint32_t last_result = 0;
    for (const std::uint32_t id : {1u, 2u, 3u, 4u, 0x00010001u, 0xFFFFFFFEu}) {
      INFO(id);
      const PlcPart part = client.inspect(id);
      CHECK(part.trigger_id == id);
      CHECK(part.result_id > last_result);
      last_result = part.result_id;
      const Verdict expected = id % 4 == 0 ? Verdict::not_judged : static_cast<Verdict>(id % 4);
      CHECK(part.verdict == expected);
      CHECK(part.result_state == (id % 4 == 0 ? 3 : 1));
      if (id % 4 == 0) {
        CHECK(part.clusters.empty());
        continue;
      }
      CHECK(part.t2_ratio == 0.875);
      REQUIRE(part.clusters.size() == 2);
      CHECK(part.clusters[1].weights[23] == 3.5);
      CHECK(part.clusters[0].pixels == 16000);
    }
    CHECK(station.gate().counters().inspected == 6);
    client.release();
  }
}

TEST_CASE("A PLC selects a recipe, and an unknown one is refused") {
  ScriptedStation station;
  PlcClient client(station.client());
  client.enable();
  client.select_recipe(5);
  CHECK(client.read_station().get("station.recipe_id") == 5);
  CHECK(contains(input_error([&] {
                   client.select_recipe(6);
                   return 0;
                 }),
                 "Illegal data value"));
}

TEST_CASE("The wrong word order is told, not misread") {
  ScriptedStation station(WordOrder::cdab);
  PlcClient client(station.client(WordOrder::abcd));
  CHECK(contains(input_error([&] {
                   client.read_station();
                   return 0;
                 }),
                 "word order"));
}

TEST_CASE("Nobody there, or a step that does not come, is told with host, port and step") {
  PlcClientSettings nobody;
  {
    ScriptedStation station;
    nobody = station.client();
  }
  CHECK(contains(input_error([&] {
                   PlcClient client(nobody);
                   return 0;
                 }),
                 "127.0.0.1 port " + std::to_string(nobody.port) + ": cannot connect"));
  ScriptedStation station;
  PlcClientSettings settings = station.client();
  settings.step_timeout = milliseconds(20);
  PlcClient client(settings);
  CHECK(contains(input_error([&] {
                   client.inspect(1);
                   return 0;
                 }),
                 "no ready within 20 ms"));
}

TEST_CASE("A second client reads but does not write; the first one's end frees the control block") {
  ScriptedStation station;
  auto first = std::make_unique<PlcClient>(station.client());
  first->enable();
  PlcClient second(station.client());
  CHECK(second.read_station().get("station.state") == 4);
  CHECK(contains(input_error([&] {
                   second.enable();
                   return 0;
                 }),
                 "Slave device or server is busy"));
  CHECK(second.read_station().get("station.warning_bits") == warning_bit::kSecondWriter);
  first.reset();
  // The server hears of the end before or after the next request: ask until it has.
  std::string answer = "busy";
  for (int i = 0; i < 2000 && answer != "(no error)"; ++i) {
    answer = input_error([&] {
      second.enable();
      return 0;
    });
  }
  CHECK(answer == "(no error)");
  CHECK(second.inspect(1).verdict == Verdict::pass);
}

TEST_CASE("Reasons are put into words by bit") {
  CHECK(reasons_in_words(0).empty());
  CHECK(reasons_in_words(0x8001) ==
        std::vector<std::string>{"T2", "calibration or recipe missing, foreign, drifted or due"});
  CHECK(reasons_in_words(0xFFFF).size() == 16);
}
