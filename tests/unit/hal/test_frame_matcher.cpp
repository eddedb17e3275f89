#include "catch.hpp"
#include "hal/camera_settings.hpp"
#include "hal/frame_matcher.hpp"

using namespace brdfgate;

namespace {

constexpr double kLine = 15e-6;

FrameFacts frame(std::uint64_t number, std::optional<AppliedSettings> applied) {
  const auto at = static_cast<std::int64_t>(1000 * number);
  return {number, at, at, applied};
}

MatchRule rule() {
  return {.exposure_tolerance_s = kLine, .gain_tolerance = 0.01, .not_before_ns = 0};
}

}  // namespace

TEST_CASE("A frame counts for what it had, in whatever order it comes") {
  FrameMatcher matcher({{0.001, 1}, {0.004, 1}, {0.001, 2}}, rule());
  CHECK(matcher.missing() == std::vector<std::size_t>{0, 1, 2});
  CHECK(matcher.offer(frame(1, AppliedSettings{0.004, 1})).index == 1);
  CHECK(matcher.offer(frame(2, AppliedSettings{0.004, 1})).fate == FrameFate::unwanted);
  CHECK(matcher.offer(frame(3, AppliedSettings{0.001, 2})).index == 2);
  CHECK(matcher.missing() == std::vector<std::size_t>{0});
  CHECK(matcher.offer(frame(4, std::nullopt)).fate == FrameFate::unknown);
  CHECK(matcher.offer(frame(5, AppliedSettings{0.001, 1})).fate == FrameFate::taken);
  CHECK(matcher.missing().empty());
}

TEST_CASE("Exposures that are asked for twice need two frames") {
  FrameMatcher matcher({{0.001, 1}, {0.001, 1}}, rule());
  CHECK(matcher.offer(frame(1, AppliedSettings{0.001, 1})).index == 0);
  CHECK(matcher.offer(frame(2, AppliedSettings{0.001, 1})).index == 1);
  CHECK(matcher.offer(frame(3, AppliedSettings{0.001, 1})).fate == FrameFate::unwanted);
}

TEST_CASE("Reported settings must equal those asked for within one line") {
  struct Case {
    AppliedSettings applied;
    bool fits;
  };
  const auto c = GENERATE(values<Case>({{{0.004, 1}, true},
                                        {{0.004 + 0.99 * kLine, 1}, true},
                                        {{0.004 - 0.99 * kLine, 1}, true},
                                        {{0.004 + 1.01 * kLine, 1}, false},
                                        {{0.004, 1.009}, true},
                                        {{0.004, 1.011}, false}}));
  CAPTURE(c.applied.exposure_s, c.applied.gain);
  FrameMatcher matcher({{0.004, 1}}, rule());
  CHECK((matcher.offer(frame(1, c.applied)).fate == FrameFate::taken) == c.fits);
}

TEST_CASE("A frame that began too early does not count") {
  MatchRule late = rule();
  late.not_before_ns = 3000;
  FrameMatcher matcher({{0.001, 1}}, late);
  CHECK(matcher.offer(frame(2, AppliedSettings{0.001, 1})).fate == FrameFate::early);
  CHECK(matcher.offer(frame(3, AppliedSettings{0.001, 1})).fate == FrameFate::taken);
}

TEST_CASE("A frozen camera is seen by its number or its clock, a lossy one by its numbers") {
  FrameMatcher matcher({{0.001, 1}, {0.002, 1}}, rule());
  matcher.offer(frame(5, AppliedSettings{0.001, 1}));
  FrameFacts again = frame(5, AppliedSettings{0.002, 1});
  CHECK(matcher.offer(again).fate == FrameFate::repeated);
  again.sequence = 6;  // a driver that counts on, over a sensor that does not
  CHECK(matcher.offer(again).fate == FrameFate::repeated);
  CHECK(matcher.offer(frame(9, AppliedSettings{0.002, 1})).fate == FrameFate::taken);
  CHECK(matcher.repeated() == 2);
  CHECK(matcher.lost() == 3);
}

TEST_CASE("A setting is certain so many frames after the first one begun after it was set") {
  ControlDelay delay(2);
  delay.restart(0.01);
  CHECK_FALSE(delay.in_effect(0, 100));
  CHECK(delay.longest_s() == 0.01);
  delay.set({0.005, 1}, 150);
  CHECK_FALSE(delay.in_effect(1, 140));  // begun before
  CHECK_FALSE(delay.in_effect(2, 200));  // the first after
  CHECK_FALSE(delay.in_effect(3, 300));
  REQUIRE(delay.in_effect(4, 400));
  CHECK(delay.in_effect(5, 500)->exposure_s == 0.005);
  CHECK(delay.longest_s() == 0.005);

  SECTION("while it changes nothing is known, and the longest of all is what may be in effect") {
    delay.set({0.001, 1}, 550);
    CHECK_FALSE(delay.in_effect(6, 600));
    CHECK(delay.longest_s() == 0.005);
    delay.set({0.02, 1}, 650);
    CHECK_FALSE(delay.in_effect(7, 700));
    CHECK_FALSE(delay.in_effect(8, 800));
    CHECK(delay.longest_s() == 0.02);
    CHECK(delay.in_effect(9, 900)->exposure_s == 0.02);
  }
  SECTION("lost frames count by their numbers") {
    delay.set({0.001, 1}, 550);
    CHECK_FALSE(delay.in_effect(6, 600));
    CHECK(delay.in_effect(8, 800)->exposure_s == 0.001);
  }
  SECTION("lost before any was seen: the wait starts with the first one seen") {
    delay.set({0.001, 1}, 550);
    CHECK_FALSE(delay.in_effect(9, 900));
    CHECK_FALSE(delay.in_effect(10, 1000));
    CHECK(delay.in_effect(11, 1100));
  }
}

TEST_CASE("Gain laws go to codes and back") {
  struct Case {
    GainLaw law;
    double code;
    double gain;
  };
  const auto c = GENERATE(values<Case>({{{GainLaw::Kind::linear, 16}, 32, 2},
                                        {{GainLaw::Kind::decibel, 0.1}, 60.206, 2},
                                        {{GainLaw::Kind::decibel, 0.3}, 0, 1},
                                        {{GainLaw::Kind::reciprocal, 1024}, 512, 2},
                                        {{GainLaw::Kind::reciprocal, 1024}, 0, 1}}));
  CHECK(c.law.gain_of(c.code) == Approx(c.gain).epsilon(1e-4));
  CHECK(c.law.code_of(c.gain) == Approx(c.code).margin(1e-3));
}
