// From a judged part to the PLC's result block and cluster blocks.
#pragma once

#include <cstdint>

#include "app/plc/plc_bits.hpp"
#include "app/plc/register_image.hpp"
#include "model/verdict.hpp"

namespace brdfgate {

/// What identifies a result and when it came; everything in milliseconds stops at 65535.
struct ResultHead {
  std::uint32_t sequence = 0;
  std::uint32_t trigger_id = 0;
  std::uint32_t result_id = 0;
  ResultState state = ResultState::undefined;
  std::uint64_t acquisition_ms = 0;
  std::uint64_t processing_ms = 0;
  std::uint64_t cycle_ms = 0;
};

/// Clears the result block and every cluster block: nothing in them is valid.
void clear_result(RegisterImage& image);
/// The head's fields, and its sequence number into every block.
void write_head(RegisterImage& image, const ResultHead& head);
/// Everything else of the result block, with `verdict` rather than the part's own.
void write_part(RegisterImage& image, const PartResult& part, Verdict verdict);
/// Copies result and cluster blocks from one image to another.
void swap_in(const RegisterImage& from, RegisterImage& to);

/// The verdict that may be published: "none" and a pass with reasons against it are "not judged".
Verdict publishable_verdict(const PartResult& part);

}  // namespace brdfgate
