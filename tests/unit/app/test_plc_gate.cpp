#include <array>
#include <atomic>
#include <optional>
#include <thread>

#include "app/plc/plc_gate.hpp"
#include "catch.hpp"
#include "support/plc_part.hpp"

using namespace brdfgate;
using namespace brdfgate::command_bit;
using namespace brdfgate::test;
using std::chrono::milliseconds;

namespace {

constexpr ModbusClient kPlc = 1;
constexpr ModbusClient kOther = 2;
constexpr auto kAddress = ModbusException::illegal_data_address;
constexpr auto kValue = ModbusException::illegal_data_value;
constexpr auto kBusy = ModbusException::server_device_busy;

/// A gate on a clock of its own, and the PLC's view of it.
struct Bench {
  SteadyTime now{};
  std::vector<std::string> notes;
  PlcGate gate;
  StationStatus station;

  explicit Bench(PlcGateSettings settings = {}) : gate(RegisterMap::built_in(), on(settings), {}) {
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

/// What must hold of anything a PLC reads at any time.
void check_fail_safe(Bench& bench) {
  const RegisterImage view = bench.view();
  const std::uint32_t status = view.get("station.status_bits");
  const bool passes = (status & status_bit::kPass) != 0;
  if (passes) {
    CHECK((status & status_bit::kResultValid) != 0);
    CHECK(view.get("result.verdict") == 1);
    CHECK(view.get("result.result_state") == 1);
    CHECK(view.get("result.result_id") != 0);
  }
}

}  // namespace

TEST_CASE("At power-on the map says who it is, and nothing reads as a result") {
  Bench bench;
  const RegisterImage view = bench.view();
  CHECK(view.get("station.magic") == 0x42524446);
  CHECK(view.get("station.map_version") == 0x0100);
  CHECK(view.get("check.word_check") == 0x01020304);
  CHECK(view.get_real("check.float_check") == 1.0F);
  CHECK(view.get("result.result_state") == 0);
  CHECK(view.get("result.verdict") == 0);
  CHECK(view.get("station.status_bits") == 0);
  CHECK(view.get("station.state") == 4);
}

TEST_CASE("The station's status stands in its registers") {
  Bench bench;
  StationStatus& s = bench.station;
  s.state = StationState::initialized;
  s.warning_bits = warning_bit::kTilt;
  s.recipe_id = 3;
  s.clusters = 2;
  s.components = 40;
  s.channels = 1;
  s.calibration_due = s.simulated = s.time_valid = true;
  bench.gate.set_station(s);
  const RegisterImage view = bench.view();
  CHECK(view.get("station.state") == 3);
  CHECK(view.get("station.warning_bits") == warning_bit::kTilt);
  CHECK(view.get("station.recipe_id") == 3);
  CHECK(view.get("station.clusters") == 2);
  CHECK(view.get("station.components") == 40);
  CHECK(view.get("station.channels") == 1);
  CHECK(view.get("station.config_hash", 0, 0) == 0x0123);
  CHECK(view.get("station.config_hash", 0, 3) == 0xcdef);
  CHECK(view.get("station.status_bits") == (status_bit::kWarning | status_bit::kCalibrationDue |
                                            status_bit::kSimulated | status_bit::kTimeValid));
}

TEST_CASE("An accepted trigger brings a fresh result block before trigger_ack can be read") {
  Bench bench;
  bench.trigger(41);
  bench.gate.publish(scripted_part(Verdict::pass, 8));
  bench.acknowledge();
  const std::uint32_t before = bench.get("result.seq_head");
  bench.trigger(42);
  const RegisterImage view = bench.view();
  CHECK(view.get("result.seq_head") == before + 1);
  CHECK(view.get("result.seq_tail") == before + 1);
  CHECK(view.get("result.trigger_id") == 42);
  CHECK(view.get("result.result_state") == 2);
  for (int i = 107; i < 124; ++i)
    CHECK(view.words()[static_cast<std::size_t>(i)] == 0);
  for (int c = 0; c < 8; ++c) {
    CHECK(view.get("cluster.seq_head", c) == before + 1);
    CHECK(view.get("cluster.seq_tail", c) == before + 1);
    const auto block = view.words(view.map().block("cluster", c));
    for (std::size_t i = 2; i + 2 < block.size(); ++i)
      REQUIRE(block[i] == 0);
  }
  CHECK(view.get("station.status_bits") == (status_bit::kBusy | status_bit::kTriggerAck));
  CHECK(view.get("station.state") == 5);
  const PlcCommand first = bench.take();
  CHECK(std::get<TriggerAccepted>(first).trigger_id == 42);
  CHECK(std::holds_alternative<std::monostate>(bench.take()));
}

TEST_CASE("A result is published with its times, counted, and acknowledged") {
  Bench bench;
  bench.now += milliseconds(1000);
  bench.trigger(7);
  bench.now += milliseconds(300);
  bench.gate.acquisition_done();
  CHECK(bench.status(status_bit::kAcquisitionDone));
  CHECK_FALSE(bench.status(status_bit::kResultValid));
  bench.now += milliseconds(50);
  const auto times = bench.gate.publish(scripted_part(Verdict::pass));
  REQUIRE(times);
  CHECK(times->trigger_id == 7);
  CHECK(times->acquisition_ms == 300);
  CHECK(times->processing_ms == 50);
  CHECK(times->cycle_ms == 350);
  const RegisterImage view = bench.view();
  CHECK(view.get("result.result_state") == 1);
  CHECK(view.get("result.result_id") == times->result_id);
  CHECK(view.get("result.verdict") == 1);
  CHECK(view.get("result.acquisition_ms") == 300);
  CHECK(view.get("result.processing_ms") == 50);
  CHECK(view.get("result.cycle_ms") == 350);
  CHECK(view.get("cluster.seq_head", 7) == view.get("result.seq_head"));
  CHECK(view.get("station.status_bits") == (status_bit::kTriggerAck | status_bit::kAcquisitionDone |
                                            status_bit::kResultValid | status_bit::kPass));
  CHECK(view.get("counters.inspected") == 1);
  CHECK(view.get("counters.passed") == 1);
  check_fail_safe(bench);
  bench.command(kTriggerEnable | kTrigger | kResultAck);
  CHECK_FALSE(bench.status(status_bit::kResultValid | status_bit::kPass));
  CHECK(bench.status(status_bit::kTriggerAck));
  bench.command(kTriggerEnable | kResultAck);
  CHECK_FALSE(bench.status(status_bit::kTriggerAck | status_bit::kReady));
  bench.command(kTriggerEnable);
  CHECK(bench.status(status_bit::kReady));
  CHECK_FALSE(bench.gate.publish(scripted_part(Verdict::pass)));
}

TEST_CASE("Verdicts are counted, and result ids rise") {
  Bench bench;
  std::uint32_t last = 0;
  for (const Verdict verdict :
       {Verdict::pass, Verdict::reject, Verdict::not_judged, Verdict::reject}) {
    bench.trigger(1);
    const auto times = bench.gate.publish(scripted_part(verdict));
    REQUIRE(times);
    CHECK(times->result_id > last);
    last = times->result_id;
    check_fail_safe(bench);
    bench.acknowledge();
  }
  const Counters counters = bench.gate.counters();
  CHECK(counters.inspected == 4);
  CHECK(counters.passed == 1);
  CHECK(counters.rejected == 2);
  CHECK(counters.not_judged == 1);
  CHECK(counters.last_result_id == last);
}

TEST_CASE("An abort or fault ends the inspection as not judged") {
  Bench bench;
  bench.trigger(1);
  CHECK(bench.gate.abort(bit(Reason::part_absent), ResultState::aborted));
  CHECK(bench.get("result.result_state") == 3);
  CHECK(bench.get("result.verdict") == 3);
  CHECK(bench.get("result.reason_bits") == bit(Reason::part_absent));
  CHECK(bench.status(status_bit::kNotJudged));
  CHECK(bench.gate.counters().faults == 0);
  bench.acknowledge();
  bench.trigger(2);
  CHECK(bench.gate.abort(bit(Reason::hardware), ResultState::failed, ErrorCode::camera));
  CHECK(bench.get("result.result_state") == 4);
  CHECK(bench.get("station.error_code") == 10);
  CHECK(bench.status(status_bit::kError));
  CHECK(bench.gate.counters().faults == 1);
  CHECK(bench.gate.counters().not_judged == 2);
  CHECK_FALSE(bench.gate.abort(bit(Reason::hardware), ResultState::failed));
  CHECK(bench.gate.counters().faults == 1);
  CHECK(std::holds_alternative<std::monostate>(bench.take()));  // nothing is left to inspect
}

TEST_CASE("A fault withdraws a pass, and a part judged during one is not judged") {
  Bench bench;
  bench.trigger(1);
  bench.gate.publish(scripted_part(Verdict::pass));
  const std::uint32_t sequence = bench.get("result.seq_head");
  bench.station.state = StationState::error;
  bench.station.error_code = ErrorCode::lights;
  bench.gate.set_station(bench.station);
  CHECK(bench.get("result.verdict") == 3);
  CHECK(bench.get("result.result_state") == 4);
  CHECK(bench.get("result.seq_head") == sequence + 1);
  CHECK(bench.get("cluster.seq_tail") == sequence + 1);
  CHECK(bench.status(status_bit::kNotJudged));
  CHECK_FALSE(bench.status(status_bit::kPass));
  CHECK_FALSE(bench.status(status_bit::kReady));
  bench.station.state = StationState::ready;
  bench.station.error_code = ErrorCode::none;
  bench.gate.set_station(bench.station);
  CHECK(bench.get("station.error_code") == 11);  // kept until cleared
  bench.acknowledge();
  bench.trigger(2);
  bench.station.state = StationState::error;
  bench.gate.set_station(bench.station);
  CHECK(bench.get("station.state") == 2);
  const auto times = bench.gate.publish(scripted_part(Verdict::pass));
  REQUIRE(times);
  CHECK(times->verdict == Verdict::not_judged);
  CHECK(bench.get("result.result_state") == 4);
  CHECK(bench.get("result.reason_bits") == bit(Reason::hardware));
}

TEST_CASE("clear_error clears the code and tells the daemon") {
  Bench bench;
  bench.station.error_code = ErrorCode::camera;
  bench.gate.set_station(bench.station);
  bench.station.error_code = ErrorCode::none;
  bench.gate.set_station(bench.station);
  CHECK(bench.get("station.error_code") == 10);
  CHECK(bench.status(status_bit::kReady) == false);
  bench.command(kTriggerEnable | kClearError);
  CHECK(bench.get("station.error_code") == 0);
  CHECK_FALSE(bench.status(status_bit::kError));
  CHECK(std::holds_alternative<ErrorCleared>(bench.take()));
}

TEST_CASE("A missed trigger is counted and starts nothing") {
  Bench bench;
  bench.command(kTrigger);
  CHECK(bench.status(status_bit::kMissedTrigger));
  CHECK(bench.get("counters.missed_triggers") == 1);
  CHECK(std::holds_alternative<std::monostate>(bench.take()));
  bench.command(0);
  CHECK_FALSE(bench.gate.external_trigger());
  CHECK(bench.get("counters.missed_triggers") == 2);
}

TEST_CASE("The hardware line carries the last written trigger_id") {
  Bench bench;
  bench.write(1000, {kTriggerEnable, 0x0001, 0x0002});
  CHECK(bench.gate.external_trigger());
  CHECK(bench.get("result.trigger_id") == 0x00010002);
  CHECK(std::get<TriggerAccepted>(bench.take()).trigger_id == 0x00010002);
}

TEST_CASE(
    "Without a PLC the line alone starts an inspection, and its result stands until the next") {
  PlcGateSettings settings;
  settings.without_plc = true;
  Bench bench(settings);
  CHECK(bench.status(status_bit::kReady));
  REQUIRE(bench.gate.external_trigger());
  CHECK_FALSE(bench.gate.external_trigger());  // busy: missed, not queued
  CHECK(bench.get("counters.missed_triggers") == 1);
  bench.take();
  REQUIRE(bench.gate.publish(scripted_part(Verdict::pass)));
  CHECK(bench.status(status_bit::kPass));
  CHECK(bench.status(status_bit::kReady));
  bench.now += std::chrono::hours(1);
  CHECK_FALSE(bench.gate.tick(bench.now, {}).handshake_released);
  CHECK(bench.status(status_bit::kPass));
  REQUIRE(bench.gate.external_trigger());
  CHECK_FALSE(bench.status(status_bit::kPass));
  bench.take();
  bench.gate.abort(bit(Reason::hardware), ResultState::failed, ErrorCode::lights);
  CHECK(bench.get("station.error_code") == 11);
  // Nobody else clears it.
  REQUIRE(bench.gate.external_trigger());
  CHECK(bench.get("station.error_code") == 0);
}

TEST_CASE("The machine's lines say pass only of a pass, and the safe thing of everything else") {
  std::optional<GpioOutputState> shown;
  PlcGateSettings settings;
  settings.show = [&](const GpioOutputState& state) { shown = state; };
  Bench bench(settings);
  using S = GpioOutputState;
  CHECK(shown == S{.pass = false, .reject = false, .busy = true});  // not enabled
  bench.command(kTriggerEnable);
  CHECK(shown == S{.pass = false, .reject = false, .busy = false});
  const auto judge = [&](Verdict verdict) {
    bench.trigger(1);
    CHECK(shown == S{.pass = false, .reject = false, .busy = true});
    bench.take();
    bench.gate.publish(scripted_part(verdict));
    const S result = *shown;
    bench.acknowledge();
    return result;
  };
  CHECK(judge(Verdict::pass) == S{.pass = true, .reject = false, .busy = true});
  CHECK(shown == S{.pass = false, .reject = false, .busy = false});
  CHECK(judge(Verdict::reject) == S{.pass = false, .reject = true, .busy = true});
  CHECK(judge(Verdict::not_judged) == S{.pass = false, .reject = true, .busy = true});
  bench.trigger(2);
  bench.take();
  bench.gate.publish(scripted_part(Verdict::pass));
  bench.station.state = StationState::error;
  bench.gate.set_station(bench.station);
  CHECK(shown == S{.pass = false, .reject = true, .busy = true});
}

TEST_CASE("recipe_select: an unknown number is exception 03, while busy 06, nothing applied") {
  Bench bench;
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
  Bench bench;
  CHECK_FALSE(bench.write(1000, {kTriggerEnable | kTrigger | kRecipeSelect, 0, 5, 3}));
  CHECK(std::get<RecipeSelected>(bench.take()).recipe == 3);
  CHECK(std::get<TriggerAccepted>(bench.take()).trigger_id == 5);
}

TEST_CASE("Addresses: reads and writes end where the map says") {
  Bench bench;
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
  Bench bench;
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
  Bench bench;
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
  Bench bench(settings);
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
  Bench bench;
  CHECK(bench.write(1000, {0xFF}, kOther) == kValue);
  CHECK_FALSE(bench.write(1000, {0}, kPlc));
}

TEST_CASE("The heartbeat counts ten times a second while everything moves") {
  PlcGateSettings settings;
  settings.progress_limit = milliseconds(1000);
  Bench bench(settings);
  ProgressMarks marks;
  const auto run = [&](int ticks, bool capture, bool judging, bool server) {
    const std::uint32_t before = bench.get("station.heartbeat");
    for (int i = 0; i < ticks; ++i) {
      bench.now += milliseconds(50);
      marks.capture += capture ? 1 : 0;
      marks.judging += judging ? 1 : 0;
      if (server) bench.gate.server_alive();
      bench.gate.tick(bench.now, marks);
    }
    return bench.get("station.heartbeat") - before;
  };
  CHECK(run(40, true, true, true) == 20);
  CHECK(run(19, false, true, true) == 9);
  CHECK(run(200, false, true, true) == 0);
  CHECK(bench.gate.tick(bench.now, marks).stalled);
  CHECK(run(40, true, true, true) >= 19);
  run(20, true, false, true);
  CHECK(run(200, true, false, true) == 0);
  run(20, true, true, true);
  run(20, true, true, false);
  CHECK(run(200, true, true, false) == 0);
  CHECK(bench.get("station.uptime_s") > 20);
}

TEST_CASE("A PLC heartbeat that stands still is a fault, when it is watched") {
  PlcGateSettings settings;
  settings.plc_heartbeat_timeout = milliseconds(1000);
  Bench bench(settings);
  bench.now += std::chrono::seconds(100);  // nobody there yet
  CHECK_FALSE(bench.gate.tick(bench.now, {}).plc_heartbeat_lost);
  bench.trigger(1);
  bench.gate.publish(scripted_part(Verdict::pass));
  for (std::uint16_t beat = 1; beat < 10; ++beat) {
    bench.write(1004, {beat});
    bench.now += milliseconds(500);
    CHECK_FALSE(bench.gate.tick(bench.now, {}).plc_heartbeat_lost);
  }
  bench.now += milliseconds(600);
  CHECK(bench.gate.tick(bench.now, {}).plc_heartbeat_lost);
  CHECK(bench.get("station.error_code") == static_cast<std::uint16_t>(ErrorCode::plc_heartbeat));
  CHECK(bench.get("station.state") == 2);
  CHECK_FALSE(bench.status(status_bit::kPass));
  CHECK(bench.gate.counters().faults == 1);
  CHECK_FALSE(bench.gate.tick(bench.now, {}).plc_heartbeat_lost);  // told once
  bench.command(kTriggerEnable | kClearError);
  CHECK(bench.get("station.state") == 4);
  bench.now += milliseconds(1000);
  CHECK(bench.gate.tick(bench.now, {}).plc_heartbeat_lost);
}

TEST_CASE("A handshake that the PLC does not finish is released and counted") {
  PlcGateSettings settings;
  settings.handshake_timeout = milliseconds(2000);
  Bench bench(settings);
  bench.trigger(1);
  bench.gate.publish(scripted_part(Verdict::reject));
  bench.now += milliseconds(1999);
  CHECK_FALSE(bench.gate.tick(bench.now, {}).handshake_released);
  bench.now += milliseconds(1);
  CHECK(bench.gate.tick(bench.now, {}).handshake_released);
  CHECK_FALSE(bench.status(status_bit::kResultValid | status_bit::kTriggerAck));
  CHECK(bench.gate.counters().faults == 1);
  bench.command(kTriggerEnable);
  CHECK(bench.status(status_bit::kReady));
}

TEST_CASE("Refused clients are counted and noted") {
  Bench bench;
  bench.gate.client_refused("192.0.2.9", "not on the allow-list");
  CHECK(bench.get("counters.clients_refused") == 1);
  REQUIRE(bench.notes.size() == 1);
  CHECK(bench.notes[0] == "Modbus client 192.0.2.9 refused: not on the allow-list");
}

TEST_CASE("Counters start where the last run left them") {
  Counters counters;
  counters.inspected = 100000;
  counters.restarts = 3;
  counters.last_result_id = 777;
  PlcGate gate(RegisterMap::built_in(), {}, counters);
  std::array<std::uint16_t, 16> words{};
  REQUIRE_FALSE(gate.read_words(1, WordTable::input, 40, words));
  CHECK(words[0] == 1);
  CHECK(words[1] == 34464);
  CHECK(words[13] == 3);
}

TEST_CASE("wake ends a wait, and a trigger ends it with the trigger") {
  PlcGate gate(RegisterMap::built_in(), {}, {});
  StationStatus station;
  station.state = StationState::ready;
  gate.set_station(station);
  std::thread waker([&] { gate.wake(); });
  CHECK(std::holds_alternative<std::monostate>(gate.wait_for_command(std::chrono::seconds(20))));
  waker.join();
  std::thread plc([&] {
    const std::array<std::uint16_t, 3> words{kTriggerEnable | kTrigger, 0, 9};
    gate.write_words(kPlc, 1000, words);
  });
  const PlcCommand command = gate.wait_for_command(std::chrono::seconds(20));
  plc.join();
  CHECK(std::get<TriggerAccepted>(command).trigger_id == 9);
}

TEST_CASE("A reader on another thread never sees a block of two results") {
  PlcGate gate(RegisterMap::built_in(), {}, {});
  StationStatus station;
  station.state = StationState::ready;
  gate.set_station(station);
  std::atomic<bool> done{false};
  std::atomic<int> torn{0};
  std::atomic<int> unsafe{0};
  std::thread reader([&] {
    RegisterImage image(RegisterMap::built_in(), WordOrder::abcd);
    while (!done) {
      gate.read_words(kOther, WordTable::input, 0, image.words({0, 125}));
      gate.read_words(kOther, WordTable::input, 100, image.words({100, 26}));
      gate.read_words(kOther, WordTable::input, 200, image.words({200, 76}));
      // Part n carries its number in every published value.
      const auto number = static_cast<float>(image.get("result.trigger_id"));
      const bool finished = image.get("result.result_state") == 1;
      if (image.get("result.seq_head") != image.get("result.seq_tail")) ++torn;
      if (image.get("cluster.seq_head") != image.get("cluster.seq_tail")) ++torn;
      if (finished && image.get_real("result.t2_ratio") != number) ++torn;
      if (!finished && image.get("result.verdict") != 0) ++unsafe;
      if (image.get_real("cluster.weights", 0, 0) != image.get_real("cluster.weights", 0, 23)) {
        ++torn;
      }
    }
  });
  PartResult part = scripted_part(Verdict::pass, 8);
  for (std::uint32_t n = 1; n <= 500; ++n) {
    const auto id = split_u32(n, WordOrder::abcd);
    const std::array<std::uint16_t, 3> words{kTriggerEnable | kTrigger, id[0], id[1]};
    gate.write_words(kPlc, 1000, words);
    part.t2_ratio = n;
    for (ClusterResult& c : part.clusters)
      c.weights.setConstant(n);
    REQUIRE(gate.publish(part));
    const std::array<std::uint16_t, 1> acknowledge{kTriggerEnable | kResultAck};
    gate.write_words(kPlc, 1000, acknowledge);
    const std::array<std::uint16_t, 1> enable{kTriggerEnable};
    gate.write_words(kPlc, 1000, enable);
  }
  done = true;
  reader.join();
  CHECK(torn == 0);
  CHECK(unsafe == 0);
}
