#include <array>
#include <optional>

#include "support/gate_bench.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

/// What must hold of anything a PLC reads at any time.
void check_fail_safe(GateBench& bench) {
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
  GateBench bench;
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
  GateBench bench;
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
  GateBench bench;
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
  GateBench bench;
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
  GateBench bench;
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
  GateBench bench;
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
  GateBench bench;
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
  GateBench bench;
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
  GateBench bench;
  bench.command(kTrigger);
  CHECK(bench.status(status_bit::kMissedTrigger));
  CHECK(bench.get("counters.missed_triggers") == 1);
  CHECK(std::holds_alternative<std::monostate>(bench.take()));
  bench.command(0);
  CHECK_FALSE(bench.gate.external_trigger());
  CHECK(bench.get("counters.missed_triggers") == 2);
}

TEST_CASE("The hardware line carries the last written trigger_id") {
  GateBench bench;
  bench.write(1000, {kTriggerEnable, 0x0001, 0x0002});
  CHECK(bench.gate.external_trigger());
  CHECK(bench.get("result.trigger_id") == 0x00010002);
  CHECK(std::get<TriggerAccepted>(bench.take()).trigger_id == 0x00010002);
}

TEST_CASE(
    "Without a PLC the line alone starts an inspection, and its result stands until the next") {
  PlcGateSettings settings;
  settings.without_plc = true;
  GateBench bench(settings);
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
  GateBench bench(settings);
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
