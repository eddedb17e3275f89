#include "app/evidence.hpp"
#include "catch.hpp"

using namespace brdfgate;

TEST_CASE("What the PLC was not told as a pass is not shown as one", "[evidence]") {
  Inspection part;
  part.result.verdict = Verdict::pass;
  const Inspection same = as_published(part, Verdict::pass);
  CHECK(same.result.verdict == Verdict::pass);
  CHECK(same.result.findings.empty());
  CHECK(same.result.reason_bits == 0);
  const Inspection withdrawn = as_published(part, Verdict::not_judged);
  CHECK(withdrawn.result.verdict == Verdict::not_judged);
  CHECK(withdrawn.result.reason_bits == bit(Reason::hardware));
  REQUIRE(withdrawn.result.findings.size() == 1);
  CHECK(withdrawn.result.findings[0].reason == Reason::hardware);
}
