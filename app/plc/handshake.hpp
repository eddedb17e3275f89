// The trigger and result handshake with the PLC, as a pure state machine: command words and the
// station's events go in, status bits come out. It has no clock, no lock and no registers.
//
//   ready = station in state 4, trigger_enable, no trigger, no result_ack, no trigger_ack
//   trigger edge while ready   -> trigger_ack, busy; every result bit and missed_trigger drop
//   trigger edge while not     -> missed_trigger
//   last frame                 -> acquisition_done
//   result                     -> result_valid with exactly one verdict bit; busy drops
//   result_ack edge            -> result_valid and its verdict bit drop
//   trigger 0                  -> trigger_ack drops (after a hardware trigger: on the
//   acknowledgement) neither, for too long      -> both drop
//
// Levels and edges are taken from the command word as a whole: an edge is judged with the levels
// that came in the same request, so one request may acknowledge and re-arm at once.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "app/plc/plc_bits.hpp"
#include "model/verdict.hpp"

namespace brdfgate {

class Handshake {
 public:
  using TimePoint = std::chrono::steady_clock::time_point;

  /// What one event set off.
  struct Edges {
    std::optional<std::uint32_t> accepted;  ///< the trigger_id of the inspection that begins
    bool missed = false;
    bool acknowledged = false;
    bool clear_error = false;
    bool recipe_select = false;
  };

  /// @param release_after  how long result_valid or trigger_ack may stand after a result
  /// @param without_plc  there is nobody to enable triggers and to acknowledge: the hardware line
  ///     alone starts an inspection, its result stands until the next one
  explicit Handshake(std::chrono::nanoseconds release_after, bool without_plc = false)
      : release_after_(release_after), without_plc_(without_plc) {}

  /// Whether the station is in state 4 (ready) but for this handshake.
  void set_station_ready(bool ready) { station_ready_ = ready; }
  /// The PLC wrote the command word.
  Edges command(std::uint16_t bits, std::uint32_t trigger_id);
  /// The hardware line fired.
  Edges external_trigger(std::uint32_t trigger_id);
  void acquisition_done();
  /// Ends an inspection. Ignored when none is under way; Verdict::none becomes not judged.
  void complete(Verdict verdict, TimePoint now);
  /// A result that reads as pass becomes "not judged": the station failed.
  void withdraw_pass();
  /// True when a handshake that the PLC did not finish was released.
  bool tick(TimePoint now);

  /// Bits 0 to 7 and 10 of status_bits.
  std::uint16_t status() const;
  bool busy() const { return busy_; }
  bool result_valid() const { return result_valid_; }
  std::uint16_t command_bits() const { return command_; }

 private:
  bool level(std::uint16_t bit) const { return (command_ & bit) != 0; }
  bool enabled() const { return without_plc_ || level(command_bit::kTriggerEnable); }
  bool can_accept() const;
  bool ready() const;
  void accept(std::uint32_t trigger_id, bool external, Edges& edges);
  void acknowledge();
  void settle();

  std::chrono::nanoseconds release_after_;
  bool without_plc_;
  std::uint16_t command_ = 0;
  bool station_ready_ = false;
  bool busy_ = false;
  bool trigger_ack_ = false;
  bool external_ = false;  ///< the inspection under way or last done came from the hardware line
  bool acquisition_done_ = false;
  bool result_valid_ = false;
  bool missed_ = false;
  Verdict verdict_ = Verdict::none;
  TimePoint completed_{};
};

}  // namespace brdfgate
