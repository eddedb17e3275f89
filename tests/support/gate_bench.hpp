// The PLC's gate on a clock of its own, and the PLC's view of it.
#pragma once

#include <string>
#include <vector>

#include "app/plc/plc_gate.hpp"
#include "catch.hpp"
#include "support/plc_part.hpp"

namespace brdfgate::test {

using namespace command_bit;
using std::chrono::milliseconds;

inline constexpr ModbusClient kPlc = 1;
inline constexpr ModbusClient kOther = 2;
inline constexpr auto kAddress = ModbusException::illegal_data_address;
inline constexpr auto kValue = ModbusException::illegal_data_value;
inline constexpr auto kBusy = ModbusException::server_device_busy;

struct GateBench {
  SteadyTime now{};
  std::vector<std::string> notes;
  PlcGate gate;
  StationStatus station;

  explicit GateBench(PlcGateSettings settings = {})
      : gate(RegisterMap::built_in(), on(settings), {}) {
    station.state = StationState::ready;
    station.config_hash = "0123456789abcdef0000";
    gate.set_station(station);
    gate.set_recipes({3, 500});
  }
  PlcGateSettings on(PlcGateSettings settings) {
    settings.clock = [this] { return now; };
    settings.note = [this](const std::string& text) { notes.push_back(text); };
    return settings;
  }
  RegisterImage view(WordOrder order = WordOrder::abcd) {
    RegisterImage image(RegisterMap::built_in(), order);
    for (int from = 0; from < kReadOnlyRegisters; from += 125) {
      REQUIRE_FALSE(gate.read_words(kOther, WordTable::input, static_cast<std::uint16_t>(from),
                                    image.words({from, 125})));
    }
    REQUIRE_FALSE(gate.read_words(kOther, WordTable::holding, 1000, image.words({1000, 5})));
    return image;
  }
  std::uint32_t get(const char* key) { return view().get(key); }
  bool status(std::uint16_t bit) { return (get("station.status_bits") & bit) != 0; }
  ModbusOutcome write(int address, std::vector<std::uint16_t> words, ModbusClient client = kPlc) {
    return gate.write_words(client, static_cast<std::uint16_t>(address), words);
  }
  ModbusOutcome command(int bits) { return write(1000, {static_cast<std::uint16_t>(bits)}); }
  void trigger(std::uint32_t id) {
    const auto words = split_u32(id, WordOrder::abcd);
    REQUIRE_FALSE(write(1000, {kTriggerEnable, words[0], words[1]}));
    REQUIRE_FALSE(command(kTriggerEnable | kTrigger));
  }
  void acknowledge() {
    command(kTriggerEnable | kResultAck);
    command(kTriggerEnable);
  }
  PlcCommand take() { return gate.wait_for_command(milliseconds(0)); }
};

}  // namespace brdfgate::test
