// What every Trigger keeps, simulated or real.
#pragma once

#include <functional>
#include <memory>
#include <thread>

#include "catch.hpp"
#include "hal/trigger.hpp"

namespace brdfgate::test {

/// A trigger, and the hand that makes an edge on its line.
struct TriggerUnderTest {
  std::shared_ptr<void> owner;
  Trigger* trigger = nullptr;
  std::function<void()> fire;
};

/// Call it inside a TEST_CASE; `make` gives a fresh trigger whose line was quiet.
inline void check_trigger_contract(const std::function<TriggerUnderTest()>& make) {
  const TriggerUnderTest under_test = make();
  Trigger& trigger = *under_test.trigger;
  const std::chrono::milliseconds at_once(0);
  const std::chrono::milliseconds patient(30000);

  SECTION("a quiet line times out") {
    CHECK_FALSE(trigger.wait(at_once));
  }
  SECTION("an edge is taken once") {
    under_test.fire();
    CHECK(trigger.wait(patient));
    CHECK_FALSE(trigger.wait(at_once));
  }
  SECTION("edges before the wait are not lost") {
    under_test.fire();
    under_test.fire();
    CHECK(trigger.wait(patient));
    CHECK(trigger.wait(patient));
    CHECK_FALSE(trigger.wait(at_once));
  }
  SECTION("an edge from another thread ends the wait") {
    std::thread other(under_test.fire);
    CHECK(trigger.wait(patient));
    other.join();
  }
}

}  // namespace brdfgate::test
