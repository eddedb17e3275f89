// Heartbeats, time-outs, and threads.
#include <array>
#include <atomic>
#include <thread>

#include "support/gate_bench.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

TEST_CASE("The heartbeat counts ten times a second while everything moves") {
  PlcGateSettings settings;
  settings.progress_limit = milliseconds(1000);
  GateBench bench(settings);
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
  GateBench bench(settings);
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
  GateBench bench(settings);
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
