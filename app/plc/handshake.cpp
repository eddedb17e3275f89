#include "app/plc/handshake.hpp"

namespace brdfgate {

bool Handshake::can_accept() const {
  return station_ready_ && !busy_ && enabled() && !level(command_bit::kResultAck) && !trigger_ack_;
}

bool Handshake::ready() const {
  return can_accept() && !level(command_bit::kTrigger);
}

Handshake::Edges Handshake::command(std::uint16_t bits, std::uint32_t trigger_id) {
  const auto rising = static_cast<std::uint16_t>(bits & ~command_);
  command_ = bits;
  Edges edges;
  if ((rising & command_bit::kClearError) != 0) {
    edges.clear_error = true;
    missed_ = false;
  }
  edges.recipe_select = (rising & command_bit::kRecipeSelect) != 0;
  if ((rising & command_bit::kResultAck) != 0 && result_valid_) {
    edges.acknowledged = true;
    acknowledge();
  }
  if ((rising & command_bit::kTrigger) != 0) {
    if (can_accept()) {
      accept(trigger_id, false, edges);
    } else {
      edges.missed = missed_ = true;
    }
  }
  settle();
  return edges;
}

Handshake::Edges Handshake::external_trigger(std::uint32_t trigger_id) {
  Edges edges;
  if (ready()) {
    accept(trigger_id, true, edges);
  } else {
    edges.missed = missed_ = true;
  }
  return edges;
}

void Handshake::accept(std::uint32_t trigger_id, bool external, Edges& edges) {
  edges.accepted = trigger_id;
  external_ = external;
  busy_ = trigger_ack_ = true;
  acquisition_done_ = result_valid_ = missed_ = false;
  verdict_ = Verdict::none;
}

void Handshake::acknowledge() {
  result_valid_ = false;
  verdict_ = Verdict::none;
  if (external_) trigger_ack_ = false;
}

void Handshake::settle() {
  if (!external_ && !level(command_bit::kTrigger)) trigger_ack_ = false;
}

void Handshake::acquisition_done() {
  if (busy_) acquisition_done_ = true;
}

void Handshake::complete(Verdict verdict, TimePoint now) {
  if (!busy_) return;
  busy_ = false;
  acquisition_done_ = true;
  result_valid_ = true;
  verdict_ = verdict == Verdict::none ? Verdict::not_judged : verdict;
  completed_ = now;
  if (without_plc_ && external_) trigger_ack_ = false;
}

void Handshake::withdraw_pass() {
  if (verdict_ == Verdict::pass) verdict_ = Verdict::not_judged;
}

bool Handshake::tick(TimePoint now) {
  const bool stands = without_plc_ && external_;
  const bool open = (result_valid_ && !stands) || trigger_ack_;
  if (busy_ || !open || now - completed_ < release_after_) return false;
  result_valid_ = trigger_ack_ = false;
  verdict_ = Verdict::none;
  return true;
}

std::uint16_t Handshake::status() const {
  std::uint16_t bits = 0;
  const auto set = [&bits](bool on, std::uint16_t bit) {
    if (on) bits |= bit;
  };
  set(ready(), status_bit::kReady);
  set(busy_, status_bit::kBusy);
  set(trigger_ack_, status_bit::kTriggerAck);
  set(acquisition_done_, status_bit::kAcquisitionDone);
  set(result_valid_, status_bit::kResultValid);
  set(result_valid_ && verdict_ == Verdict::pass, status_bit::kPass);
  set(result_valid_ && verdict_ == Verdict::reject, status_bit::kReject);
  set(result_valid_ && verdict_ == Verdict::not_judged, status_bit::kNotJudged);
  set(missed_, status_bit::kMissedTrigger);
  return bits;
}

}  // namespace brdfgate
