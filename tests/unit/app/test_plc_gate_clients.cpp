// What clients may read and write, and whose word counts.
#include <array>

#include "support/gate_bench.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

TEST_CASE("recipe_select: an unknown number is exception 03, while busy 06, nothing applied") {
  GateBench bench;
  CHECK(bench.write(1000, {kTriggerEnable | kRecipeSelect, 0, 9, 4}) == kValue);
  CHECK(bench.get("control.command_bits") == 0);
  CHECK(bench.get("control.trigger_id") == 0);
  CHECK(bench.get("control.recipe") == 0);
  CHECK_FALSE(bench.write(1003, {4}));  // stored, not selected
  CHECK(bench.command(kRecipeSelect) == kValue);
  CHECK_FALSE(bench.write(1000, {kRecipeSelect, 0, 9, 500}));
  CHECK(std::get<RecipeSelected>(bench.take()).recipe == 500);
  CHECK_FALSE(bench.command(kTriggerEnable | kRecipeSelect));  // no edge
  CHECK(std::holds_alternative<std::monostate>(bench.take()));
  bench.trigger(1);
  bench.take();
  CHECK(bench.write(1000, {kTriggerEnable | kRecipeSelect, 0, 10, 3}) == kBusy);
  CHECK(bench.get("control.trigger_id") == 1);
  CHECK(bench.get("control.recipe") == 500);
  CHECK(bench.get("control.command_bits") == (kTriggerEnable | kTrigger));
  CHECK(std::holds_alternative<std::monostate>(bench.take()));
}

TEST_CASE("A recipe and a trigger in one request are taken in that order") {
  GateBench bench;
  CHECK_FALSE(bench.write(1000, {kTriggerEnable | kTrigger | kRecipeSelect, 0, 5, 3}));
  CHECK(std::get<RecipeSelected>(bench.take()).recipe == 3);
  CHECK(std::get<TriggerAccepted>(bench.take()).trigger_id == 5);
}

TEST_CASE("Addresses: reads and writes end where the map says") {
  GateBench bench;
  std::array<std::uint16_t, 125> words{};
  const auto read = [&](WordTable table, int address, std::size_t count) {
    words.fill(0xAAAA);
    return bench.gate.read_words(kPlc, table, static_cast<std::uint16_t>(address),
                                 std::span(words).first(count));
  };
  CHECK_FALSE(read(WordTable::input, 18, 22));
  for (std::size_t i = 0; i < 22; ++i)
    CHECK(words[i] == 0);
  CHECK_FALSE(read(WordTable::input, 999, 1));
  CHECK(read(WordTable::input, 999, 2) == kAddress);
  CHECK(read(WordTable::input, 1000, 1) == kAddress);
  CHECK_FALSE(read(WordTable::holding, 999, 6));
  CHECK(read(WordTable::holding, 1004, 2) == kAddress);
  CHECK(read(WordTable::holding, 1005, 1) == kAddress);
  CHECK(read(WordTable::holding, 65535, 1) == kAddress);
  for (const int address : {0, 4, 100, 999, 1005, 65535})
    CHECK(bench.write(address, {1}) == kAddress);
  CHECK(bench.write(999, {0, 0}) == kAddress);
  CHECK(bench.write(1004, {0, 0}) == kAddress);
  CHECK_FALSE(bench.write(1000, {0, 0, 0, 0, 0}));
  CHECK(bench.write(1000, {0x20}) == kValue);
  CHECK(bench.write(1000, {0x8001}) == kValue);
  CHECK(bench.get("control.command_bits") == 0);
}

TEST_CASE("Mirrored holding registers read like the input registers") {
  GateBench bench;
  bench.trigger(77);
  bench.gate.publish(scripted_part(Verdict::reject, 8));
  for (int from = 0; from < kReadOnlyRegisters; from += 125) {
    std::array<std::uint16_t, 125> input{};
    std::array<std::uint16_t, 125> holding{};
    const auto address = static_cast<std::uint16_t>(from);
    CHECK_FALSE(bench.gate.read_words(kPlc, WordTable::input, address, input));
    CHECK_FALSE(bench.gate.read_words(kPlc, WordTable::holding, address, holding));
    CHECK(input == holding);
  }
}

TEST_CASE("Coils are the command bits and discrete inputs the status bits") {
  GateBench bench;
  const std::array<std::uint8_t, 1> on{1};
  const std::array<std::uint8_t, 1> off{0};
  CHECK_FALSE(bench.gate.write_bits(kPlc, 0, on));
  CHECK(bench.get("control.command_bits") == kTriggerEnable);
  CHECK_FALSE(bench.gate.write_bits(kPlc, 1, on));
  CHECK(bench.status(status_bit::kBusy));
  std::array<std::uint8_t, 16> bits{};
  CHECK_FALSE(bench.gate.read_bits(kPlc, BitTable::discretes, 0, bits));
  std::uint32_t status = 0;
  for (std::size_t i = 0; i < bits.size(); ++i)
    status |= std::uint32_t{bits[i]} << i;
  CHECK(status == bench.get("station.status_bits"));
  CHECK_FALSE(bench.gate.write_bits(kPlc, 1, off));
  std::array<std::uint8_t, 5> coils{};
  CHECK_FALSE(bench.gate.read_bits(kPlc, BitTable::coils, 0, coils));
  CHECK(coils == std::array<std::uint8_t, 5>{1, 0, 0, 0, 0});
  CHECK(bench.gate.write_bits(kPlc, 5, on) == kAddress);
  CHECK(bench.gate.read_bits(kPlc, BitTable::discretes, 1, bits) == kAddress);
  CHECK(bench.gate.read_bits(kPlc, BitTable::coils, 1, coils) == kAddress);
  CHECK(bench.gate.write_bits(kOther, 0, on) == kBusy);
}

TEST_CASE("One client owns the control block until it leaves or falls silent") {
  PlcGateSettings settings;
  settings.owner_silence = milliseconds(5000);
  GateBench bench(settings);
  CHECK(bench.write(1003, {99}, kOther) == std::nullopt);
  CHECK(bench.write(1003, {1}, kPlc) == kBusy);
  CHECK(bench.get("control.recipe") == 99);
  CHECK(bench.get("station.warning_bits") == warning_bit::kSecondWriter);
  CHECK(bench.status(status_bit::kWarning));
  CHECK(bench.write(5, {1}, kPlc) == kAddress);
  SECTION("it leaves") {
    bench.gate.client_left(kOther);
  }
  SECTION("it falls silent") {
    bench.now += milliseconds(4999);
    CHECK_FALSE(bench.gate.tick(bench.now, {}).owner_released);
    std::array<std::uint16_t, 1> word{};
    bench.gate.read_words(kOther, WordTable::input, 0, word);  // it asks for something
    bench.now += milliseconds(4999);
    CHECK_FALSE(bench.gate.tick(bench.now, {}).owner_released);
    bench.now += milliseconds(1);
    CHECK(bench.gate.tick(bench.now, {}).owner_released);
  }
  CHECK_FALSE(bench.write(1000, {kClearError}, kPlc));
  CHECK(bench.get("station.warning_bits") == 0);
  CHECK(bench.write(1003, {2}, kOther) == kBusy);
  bench.gate.client_left(kOther);  // not the owner: nothing changes
  CHECK(bench.write(1003, {2}, 3) == kBusy);
}

TEST_CASE("A refused write does not make its client the owner") {
  GateBench bench;
  CHECK(bench.write(1000, {0xFF}, kOther) == kValue);
  CHECK_FALSE(bench.write(1000, {0}, kPlc));
}

TEST_CASE("Refused clients are counted and noted") {
  GateBench bench;
  bench.gate.client_refused("192.0.2.9", "not on the allow-list");
  CHECK(bench.get("counters.clients_refused") == 1);
  REQUIRE(bench.notes.size() == 1);
  CHECK(bench.notes[0] == "Modbus client 192.0.2.9 refused: not on the allow-list");
}
