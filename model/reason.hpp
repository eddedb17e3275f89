// Verdicts and their reasons, as the PLC reads them.
#pragma once

#include <cstdint>
#include <string>

namespace brdfgate {

enum class Verdict { none = 0, pass = 1, reject = 2, not_judged = 3 };

/// Reason bits of plc.md: 0-6 go with reject, 7-15 with not judged.
enum class Reason : int {
  t2 = 0,
  spe,
  local_defect,
  missing_cluster,
  unknown_region,
  colour,
  gloss,
  tilt,
  ambient,
  clipped,
  coverage,
  outside_basis,
  hardware,
  part_absent,
  pose_or_face,
  calibration_or_recipe,
};
using ReasonBits = std::uint16_t;
constexpr ReasonBits bit(Reason r) {
  return static_cast<ReasonBits>(1u << static_cast<int>(r));
}
inline constexpr ReasonBits kRejectBits = 0x007F;
inline constexpr ReasonBits kNotJudgedBits = 0xFF80;

/// What was found wrong, in words: one text per set bit, with value and limit.
struct Finding {
  Reason reason;
  std::string text;
};

/// Not judged outweighs reject outweighs pass: what could not be measured is not judged.
Verdict verdict_of(ReasonBits bits);

}  // namespace brdfgate
