// What every Lights keeps, simulated or real.
#pragma once

#include <functional>
#include <memory>
#include <stdexcept>

#include "catch.hpp"
#include "hal/camera.hpp"
#include "hal/lights.hpp"

namespace brdfgate::test {

/// Lights, and an eye that sees which one burns (kNoLight: none; throws when several do).
struct LightsUnderTest {
  std::shared_ptr<void> owner;
  Lights* lights = nullptr;
  std::function<LightIndex()> burning;
};

inline void check_settling(Lights& lights, const std::function<LightIndex()>& burning) {
  const std::int64_t settle_ns = lights.settled_at_ns() - lights.switched_at_ns();
  CHECK(settle_ns >= 0);
  lights.on(1);
  static_cast<void>(burning());
  lights.on(2);
  const std::int64_t second = lights.switched_at_ns();
  static_cast<void>(burning());
  lights.on(2);
  CHECK(lights.switched_at_ns() == second);
  CHECK(lights.settled_at_ns() == second + settle_ns);
  lights.all_off();
  const std::int64_t off = lights.switched_at_ns();
  CHECK(off > second);
  static_cast<void>(burning());
  lights.all_off();
  CHECK(lights.switched_at_ns() == off);
  CHECK(lights.settled_at_ns() == off + settle_ns);
}

/// Call it inside a TEST_CASE; `make` gives fresh lights, at least two.
inline void check_lights_contract(const std::function<LightsUnderTest()>& make) {
  const LightsUnderTest under_test = make();
  Lights& lights = *under_test.lights;
  const auto& burning = under_test.burning;
  REQUIRE(lights.count() >= 2);

  SECTION("all are off after construction") {
    CHECK(burning() == kNoLight);
  }
  SECTION("switching one on switches every other off") {
    for (LightIndex light = 1; light <= lights.count(); ++light) {
      lights.on(light);
      CHECK(burning() == light);
    }
    lights.on(1);
    CHECK(burning() == 1);
  }
  SECTION("all_off leaves the dark, however often") {
    lights.on(2);
    lights.all_off();
    CHECK(burning() == kNoLight);
    lights.all_off();
    CHECK(burning() == kNoLight);
  }
  SECTION("a light that does not exist is an error and lights nothing") {
    for (const LightIndex light : {-1, 0, lights.count() + 1}) {
      CHECK_THROWS_AS(lights.on(light), LightsError);
      CHECK(burning() == kNoLight);
    }
  }
  SECTION("only a change moves the time from which frames count, by the settle time") {
    check_settling(lights, burning);
  }
  SECTION("what was switched stands") {
    CHECK_NOTHROW(lights.verify());
    lights.on(1);
    CHECK_NOTHROW(lights.verify());
    lights.all_off();
    CHECK_NOTHROW(lights.verify());
  }
  SECTION("a scope guard leaves the dark, also by an exception") {
    const auto fail = [&] {
      const LightsOffAtExit guard(lights);
      lights.on(1);
      throw std::runtime_error("fault");
    };
    CHECK_THROWS_AS(fail(), std::runtime_error);
    CHECK(burning() == kNoLight);
  }
}

}  // namespace brdfgate::test
