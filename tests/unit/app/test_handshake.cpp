#include "app/plc/handshake.hpp"
#include "app/plc/plc_bits.hpp"
#include "catch.hpp"

using namespace brdfgate;
using namespace brdfgate::command_bit;
using namespace brdfgate::status_bit;
using std::chrono::seconds;

namespace {

const Handshake::TimePoint kStart{};
constexpr std::uint16_t kEnable = kTriggerEnable;
constexpr std::uint16_t kDone = kAcquisitionDone;

/// One thing that happens, and the status bits that stand after it.
struct Step {
  enum class Event { command, line, last_frame, result, tick, station } event;
  int value;  ///< command word, verdict, seconds since the start, station ready
  std::uint16_t status;
};
using E = Step::Event;

void apply(Handshake& handshake, const Step& step, Handshake::TimePoint& now) {
  switch (step.event) {
    case E::command:
      handshake.command(static_cast<std::uint16_t>(step.value), 7);
      break;
    case E::line:
      handshake.external_trigger(7);
      break;
    case E::last_frame:
      handshake.acquisition_done();
      break;
    case E::result:
      handshake.complete(static_cast<Verdict>(step.value), now);
      break;
    case E::tick:
      now = kStart + seconds(step.value);
      handshake.tick(now);
      break;
    case E::station:
      handshake.set_station_ready(step.value != 0);
      break;
  }
}

void run(const std::vector<Step>& steps) {
  Handshake handshake(seconds(10));
  handshake.set_station_ready(true);
  Handshake::TimePoint now = kStart;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    apply(handshake, steps[i], now);
    INFO("step " << i);
    CHECK(handshake.status() == steps[i].status);
    const auto verdicts = handshake.status() & (kPass | kReject | kNotJudged);
    CHECK((verdicts != 0) == ((handshake.status() & kResultValid) != 0));
  }
}

constexpr int kPassed = static_cast<int>(Verdict::pass);
constexpr int kRejected = static_cast<int>(Verdict::reject);

}  // namespace

TEST_CASE("A whole handshake goes step by step, twice") {
  run({{E::command, kEnable, kReady},
       {E::command, kEnable | kTrigger, kBusy | kTriggerAck},
       {E::last_frame, 0, kBusy | kTriggerAck | kDone},
       {E::result, kPassed, kTriggerAck | kDone | kResultValid | kPass},
       {E::command, kEnable | kTrigger | kResultAck, kTriggerAck | kDone},
       {E::command, kEnable | kResultAck, kDone},
       {E::command, kEnable, kReady | kDone},
       {E::command, kEnable | kTrigger, kBusy | kTriggerAck},
       {E::last_frame, 0, kBusy | kTriggerAck | kDone},
       {E::result, kRejected, kTriggerAck | kDone | kResultValid | kReject},
       {E::command, kEnable | kResultAck, kDone},
       {E::command, kEnable, kReady | kDone}});
}

TEST_CASE("Ready needs every one of its conditions") {
  run({{E::command, 0, 0},
       {E::command, kEnable, kReady},
       {E::station, 0, 0},
       {E::station, 1, kReady},
       {E::command, kEnable | kResultAck, 0},
       {E::command, kEnable, kReady},
       {E::command, kResultAck, 0}});
}

TEST_CASE("A trigger while not enabled is missed, and a high one does not count once enabled") {
  run({{E::command, kTrigger, kMissedTrigger},
       {E::command, kEnable | kTrigger, kMissedTrigger},
       {E::command, kEnable, kReady | kMissedTrigger},
       {E::command, kEnable | kTrigger, kBusy | kTriggerAck}});
}

TEST_CASE("Triggers while busy are missed, never queued") {
  run({{E::command, kEnable, kReady},
       {E::command, kEnable | kTrigger, kBusy | kTriggerAck},
       {E::command, kEnable, kBusy},
       {E::command, kEnable | kTrigger, kBusy | kMissedTrigger},
       {E::line, 0, kBusy | kMissedTrigger},
       {E::result, kPassed, kMissedTrigger | kDone | kResultValid | kPass},
       {E::command, kEnable | kResultAck, kMissedTrigger | kDone},
       {E::command, kEnable, kReady | kMissedTrigger | kDone}});
}

TEST_CASE("missed_trigger clears on clear_error") {
  run({{E::command, kTrigger, kMissedTrigger},
       {E::command, kClearError, 0},
       {E::command, kTrigger | kClearError, kMissedTrigger},
       {E::command, kClearError, kMissedTrigger},
       {E::command, 0, kMissedTrigger},
       {E::command, kClearError, 0}});
}

TEST_CASE("A stale acknowledgement does nothing and keeps ready low") {
  run({{E::command, kEnable, kReady},
       {E::command, kEnable | kTrigger, kBusy | kTriggerAck},
       {E::command, kEnable | kTrigger | kResultAck, kBusy | kTriggerAck},
       {E::result, kPassed, kTriggerAck | kDone | kResultValid | kPass},
       {E::command, kEnable | kResultAck, kDone | kResultValid | kPass},
       {E::command, kEnable, kReady | kDone | kResultValid | kPass},
       {E::command, kEnable | kResultAck, kDone},
       {E::command, kEnable, kReady | kDone}});
}

TEST_CASE("A trigger beside a high acknowledgement is missed; one beside its fall is not") {
  run({{E::command, kEnable | kResultAck, 0},
       {E::command, kEnable | kResultAck | kTrigger, kMissedTrigger},
       {E::command, kEnable | kResultAck, kMissedTrigger},
       {E::command, kEnable | kTrigger, kBusy | kTriggerAck}});
}

TEST_CASE("The next accepted trigger clears a result that nobody acknowledged") {
  run({{E::command, kEnable, kReady},
       {E::command, kEnable | kTrigger, kBusy | kTriggerAck},
       {E::result, kPassed, kTriggerAck | kDone | kResultValid | kPass},
       {E::command, kEnable, kReady | kDone | kResultValid | kPass},
       {E::command, kEnable | kTrigger, kBusy | kTriggerAck}});
}

TEST_CASE("A PLC that never drops trigger or never acknowledges is released") {
  run({{E::command, kEnable, kReady},
       {E::command, kEnable | kTrigger, kBusy | kTriggerAck},
       {E::tick, 100, kBusy | kTriggerAck},  // an inspection takes as long as it takes
       {E::result, kPassed, kTriggerAck | kDone | kResultValid | kPass},
       {E::tick, 109, kTriggerAck | kDone | kResultValid | kPass},
       {E::tick, 110, kDone},
       {E::command, kEnable, kReady | kDone}});
}

TEST_CASE("A hardware trigger needs trigger_enable, and its trigger_ack falls when acknowledged") {
  run({{E::line, 0, kMissedTrigger},
       {E::command, kEnable, kReady | kMissedTrigger},
       {E::line, 0, kBusy | kTriggerAck},
       {E::command, kEnable, kBusy | kTriggerAck},
       {E::last_frame, 0, kBusy | kTriggerAck | kDone},
       {E::result, kRejected, kTriggerAck | kDone | kResultValid | kReject},
       {E::line, 0, kTriggerAck | kDone | kResultValid | kReject | kMissedTrigger},
       {E::command, kEnable | kResultAck, kDone | kMissedTrigger},
       {E::command, kEnable, kReady | kDone | kMissedTrigger}});
}

TEST_CASE("Events out of turn change nothing") {
  run({{E::last_frame, 0, 0}, {E::result, kPassed, 0}, {E::tick, 1000, 0}});
}

TEST_CASE("No verdict is published as not judged") {
  run({{E::command, kEnable | kTrigger, kBusy | kTriggerAck},
       {E::result, 0, kTriggerAck | kDone | kResultValid | kNotJudged}});
}

TEST_CASE("A withdrawn pass reads as not judged") {
  Handshake handshake(seconds(10));
  handshake.set_station_ready(true);
  handshake.command(kEnable | kTrigger, 1);
  handshake.complete(Verdict::pass, kStart);
  handshake.withdraw_pass();
  CHECK((handshake.status() & (kPass | kReject | kNotJudged)) == kNotJudged);
}

TEST_CASE("Edges tell what a command set off") {
  Handshake handshake(seconds(10));
  handshake.set_station_ready(true);
  CHECK_FALSE(handshake.command(kEnable, 1).accepted);
  const auto accepted = handshake.command(kEnable | kTrigger, 42);
  CHECK(accepted.accepted == 42u);
  CHECK_FALSE(handshake.command(kEnable | kTrigger, 43).accepted);
  CHECK(handshake.command(kEnable, 43).missed == false);
  CHECK(handshake.command(kEnable | kTrigger, 43).missed);
  handshake.complete(Verdict::pass, kStart);
  CHECK(handshake.command(kEnable | kResultAck, 43).acknowledged);
  CHECK_FALSE(handshake.command(kEnable, 43).acknowledged);
  CHECK_FALSE(handshake.command(kEnable | kResultAck, 43).acknowledged);
  const auto both = handshake.command(kEnable | kClearError | kRecipeSelect, 43);
  CHECK(both.clear_error);
  CHECK(both.recipe_select);
  const auto again = handshake.command(kEnable | kClearError | kRecipeSelect, 43);
  CHECK_FALSE(again.clear_error);
  CHECK_FALSE(again.recipe_select);
}

TEST_CASE("Whatever a PLC writes, pass stands only beside result_valid after a completed pass") {
  Handshake handshake(seconds(10));
  handshake.set_station_ready(true);
  std::uint32_t state = 99;
  const auto next = [&state] { return (state = state * 1664525u + 1013904223u) >> 16; };
  bool completed_pass = false;
  Handshake::TimePoint now = kStart;
  for (int i = 0; i < 20000; ++i) {
    const std::uint32_t dice = next() % 8;
    if (dice < 5) {
      const auto edges = handshake.command(static_cast<std::uint16_t>(next() % 32), next());
      if (edges.accepted) completed_pass = false;
    } else if (dice == 5 && handshake.busy()) {
      const auto verdict = static_cast<Verdict>(next() % 4);
      handshake.complete(verdict, now);
      completed_pass = verdict == Verdict::pass;
    } else if (dice == 6) {
      now += seconds(next() % 8);
      handshake.tick(now);
    } else if (handshake.external_trigger(next()).accepted) {
      completed_pass = false;
    }
    const std::uint16_t status = handshake.status();
    const int verdicts = (status >> 5 & 1) + (status >> 6 & 1) + (status >> 7 & 1);
    REQUIRE(verdicts == (status >> 4 & 1));
    if ((status & kPass) != 0) REQUIRE(completed_pass);
    if ((status & kBusy) != 0) REQUIRE((status & (kReady | kResultValid)) == 0);
    if ((status & kReady) != 0) REQUIRE((status & kTriggerAck) == 0);
  }
}
