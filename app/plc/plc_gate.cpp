// The daemon's side; the servers' side is plc_gate_wire.cpp.
#include "app/plc/plc_gate.hpp"

#include <algorithm>
#include <charconv>
#include <utility>

namespace brdfgate {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kBeat{100};          ///< 10 Hz
constexpr milliseconds kBeatCatchUp{1000};  ///< beats lost longer ago are not made up for

std::int64_t ms_between(SteadyTime from, SteadyTime to) {
  return std::chrono::duration_cast<milliseconds>(to - from).count();
}

std::uint64_t not_negative(std::int64_t value) {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(0, value));
}

/// Four hex digits of a hash; 0 where there are none.
std::uint16_t hex_word(const std::string& hash, std::size_t index) {
  std::uint16_t word = 0;
  if (hash.size() < 4 * index + 4) return 0;
  const char* const digits = hash.data() + 4 * index;
  std::from_chars(digits, digits + 4, word, 16);
  return word;
}

}  // namespace

PlcGate::PlcGate(const RegisterMap& map, PlcGateSettings settings, const Counters& counters)
    : settings_(std::move(settings)),
      image_(map, settings_.word_order),
      handshake_(settings_.handshake_timeout, settings_.without_plc),
      counters_(counters),
      started_(settings_.clock()),
      next_beat_(started_ + kBeat) {
  image_.put("station.magic", kMapMagic);
  image_.put("station.map_version", kMapVersion);
  image_.put_real("check.float_check", 1.0);
  image_.put("check.word_check", kMapWordCheck);
  capture_.moved = judging_.moved = server_.moved = started_;
  refresh();
}

void PlcGate::set_station(const StationStatus& status) {
  const std::lock_guard lock(mutex_);
  const bool failed_now = status.state == StationState::error && !faulty();
  station_ = status;
  latch_error(status.error_code);
  if (failed_now) withdraw_pass();
  refresh();
}

void PlcGate::set_recipes(std::vector<std::uint16_t> ids) {
  const std::lock_guard lock(mutex_);
  recipes_ = std::move(ids);
}

PlcCommand PlcGate::wait_for_command(milliseconds timeout) {
  std::unique_lock lock(mutex_);
  commanded_.wait_for(lock, timeout, [this] {
    return pending_.woken || pending_.error_cleared || pending_.recipe || pending_.trigger;
  });
  if (std::exchange(pending_.woken, false)) return std::monostate{};
  if (std::exchange(pending_.error_cleared, false)) return ErrorCleared{};
  if (const auto recipe = std::exchange(pending_.recipe, {})) return RecipeSelected{*recipe};
  if (const auto trigger = std::exchange(pending_.trigger, {})) return TriggerAccepted{*trigger};
  return std::monostate{};
}

void PlcGate::wake() {
  const std::lock_guard lock(mutex_);
  pending_.woken = true;
  commanded_.notify_all();
}

bool PlcGate::external_trigger() {
  const std::lock_guard lock(mutex_);
  const Handshake::Edges edges = handshake_.external_trigger(image_.get("control.trigger_id"));
  if (settings_.without_plc && edges.accepted) clear_error(settings_.clock());
  follow(edges, settings_.clock());
  return edges.accepted.has_value();
}

void PlcGate::acquisition_done() {
  const std::lock_guard lock(mutex_);
  if (!handshake_.busy() || acquired_) return;
  acquired_ = settings_.clock();
  handshake_.acquisition_done();
  refresh();
}

std::optional<PublishedTimes> PlcGate::publish(const PartResult& part) {
  RegisterImage result(image_.map(), settings_.word_order);
  const Verdict verdict = publishable_verdict(part);
  write_part(result, part, verdict);
  const std::lock_guard lock(mutex_);
  if (faulty()) {
    result.put("result.reason_bits", part.reason_bits | bit(Reason::hardware));
    return finish(result, ResultState::failed, Verdict::not_judged);
  }
  return finish(result, ResultState::completed, verdict);
}

std::optional<PublishedTimes> PlcGate::abort(ReasonBits reasons, ResultState state,
                                             ErrorCode error) {
  RegisterImage result(image_.map(), settings_.word_order);
  result.put("result.reason_bits", reasons);
  const std::lock_guard lock(mutex_);
  const bool new_error = error != ErrorCode::none && error != error_code_;
  if (handshake_.busy() && state == ResultState::failed && !new_error) ++counters_.faults;
  latch_error(error);
  return finish(result, state, Verdict::not_judged);
}

std::optional<PublishedTimes> PlcGate::finish(RegisterImage& result, ResultState state,
                                              Verdict verdict) {
  if (!handshake_.busy()) {
    refresh();
    return std::nullopt;
  }
  const SteadyTime now = settings_.clock();
  const SteadyTime acquired = acquired_.value_or(now);
  PublishedTimes times;
  times.trigger_id = head_.trigger_id;
  times.result_id = ++counters_.last_result_id;
  times.verdict = verdict;
  times.acquisition_ms = ms_between(triggered_, acquired);
  times.processing_ms = ms_between(acquired, now);
  times.cycle_ms = ms_between(triggered_, now);
  head_.sequence = ++sequence_;
  head_.result_id = times.result_id;
  head_.state = state;
  head_.acquisition_ms = not_negative(times.acquisition_ms);
  head_.processing_ms = not_negative(times.processing_ms);
  head_.cycle_ms = not_negative(times.cycle_ms);
  result.put("result.verdict", static_cast<std::uint16_t>(verdict));
  write_head(result, head_);
  swap_in(result, image_);
  count_verdict(verdict);
  handshake_.complete(verdict, now);
  pending_.trigger.reset();  // ended before it was taken
  refresh();
  return times;
}

void PlcGate::count_verdict(Verdict verdict) {
  ++counters_.inspected;
  if (verdict == Verdict::pass) {
    ++counters_.passed;
  } else if (verdict == Verdict::reject) {
    ++counters_.rejected;
  } else {
    ++counters_.not_judged;
  }
}

TickReport PlcGate::tick(SteadyTime now, const ProgressMarks& marks) {
  const std::lock_guard lock(mutex_);
  TickReport report;
  report.handshake_released = handshake_.tick(now);
  if (report.handshake_released) ++counters_.faults;
  report.plc_heartbeat_lost = watch_plc_heartbeat(now);
  report.owner_released = release_silent_owner(now);
  report.stalled = !beat(now, marks);
  const auto uptime = std::chrono::duration_cast<std::chrono::seconds>(now - started_).count();
  image_.put("station.uptime_s", not_negative(uptime));
  refresh();
  return report;
}

bool PlcGate::Watched::stalled(std::uint64_t now_mark, SteadyTime now, milliseconds limit) {
  if (now_mark != mark) {
    mark = now_mark;
    moved = now;
  }
  return now - moved >= limit;
}

bool PlcGate::beat(SteadyTime now, const ProgressMarks& marks) {
  const bool capture = capture_.stalled(marks.capture, now, settings_.progress_limit);
  const bool judging = judging_.stalled(marks.judging, now, settings_.progress_limit);
  const bool server = server_.stalled(server_turns_, now, settings_.progress_limit);
  if (capture || judging || server) {
    next_beat_ = now + kBeat;
    return false;
  }
  if (now - next_beat_ > kBeatCatchUp) next_beat_ = now;
  for (; now >= next_beat_; next_beat_ += kBeat)
    ++heartbeat_;
  return true;
}

bool PlcGate::watch_plc_heartbeat(SteadyTime now) {
  if (settings_.plc_heartbeat_timeout.count() == 0 || plc_heartbeat_lost_) return false;
  // A PLC that still boots beats no heart: the watch begins when it enables triggers or beats.
  const bool enabled = (handshake_.command_bits() & command_bit::kTriggerEnable) != 0;
  if (!plc_heartbeat_armed_ && enabled) {
    plc_heartbeat_armed_ = true;
    plc_heartbeat_moved_ = now;
  }
  const bool still = now - plc_heartbeat_moved_ >= settings_.plc_heartbeat_timeout;
  if (!plc_heartbeat_armed_ || !still) return false;
  plc_heartbeat_lost_ = true;
  latch_error(ErrorCode::plc_heartbeat);
  return true;
}

bool PlcGate::release_silent_owner(SteadyTime now) {
  if (!owner_ || now - owner_heard_ < settings_.owner_silence) return false;
  owner_.reset();
  return true;
}

void PlcGate::latch_error(ErrorCode code) {
  if (code == ErrorCode::none || code == error_code_) return;
  error_code_ = code;
  ++counters_.faults;
  withdraw_pass();
}

void PlcGate::withdraw_pass() {
  if (image_.get("result.verdict") != static_cast<std::uint16_t>(Verdict::pass)) return;
  head_.sequence = ++sequence_;
  head_.state = ResultState::failed;
  write_head(image_, head_);
  image_.put("result.verdict", static_cast<std::uint16_t>(Verdict::not_judged));
  image_.put("result.reason_bits", bit(Reason::hardware));
  handshake_.withdraw_pass();
}

Counters PlcGate::counters() const {
  const std::lock_guard lock(mutex_);
  return counters_;
}

bool PlcGate::busy() const {
  const std::lock_guard lock(mutex_);
  return handshake_.busy();
}

StationState PlcGate::base_state() const {
  return plc_heartbeat_lost_ ? StationState::error : station_.state;
}

void PlcGate::refresh() {
  const StationState base = base_state();
  handshake_.set_station_ready(base == StationState::ready);
  const bool inspecting = base == StationState::ready && handshake_.busy();
  image_.put("station.state",
             static_cast<std::uint16_t>(inspecting ? StationState::inspecting : base));
  image_.put("station.status_bits", status_bits());
  image_.put("station.heartbeat", heartbeat_);
  image_.put("station.error_code", static_cast<std::uint16_t>(error_code_));
  image_.put("station.warning_bits",
             static_cast<std::uint16_t>(station_.warning_bits |
                                        (second_writer_ ? warning_bit::kSecondWriter : 0)));
  image_.put("station.recipe_id", station_.recipe_id);
  for (int i = 0; i < image_.map().field("station.config_hash").count; ++i) {
    image_.put("station.config_hash", hex_word(station_.config_hash, static_cast<std::size_t>(i)),
               0, i);
  }
  image_.put("station.clusters", station_.clusters);
  image_.put("station.components", station_.components);
  image_.put("station.channels", station_.channels);
  refresh_counters();
  if (settings_.show) settings_.show(outputs());
}

GpioOutputState PlcGate::outputs() const {
  const std::uint16_t bits = handshake_.status();
  const bool pass = (bits & status_bit::kPass) != 0;
  GpioOutputState state;
  state.pass = pass && !faulty();
  state.reject = ((bits & status_bit::kResultValid) != 0 && !pass) || faulty();
  state.busy = (bits & status_bit::kReady) == 0;
  return state;
}

void PlcGate::refresh_counters() {
  image_.put("counters.inspected", counters_.inspected);
  image_.put("counters.passed", counters_.passed);
  image_.put("counters.rejected", counters_.rejected);
  image_.put("counters.not_judged", counters_.not_judged);
  image_.put("counters.missed_triggers", counters_.missed_triggers);
  image_.put("counters.faults", counters_.faults);
  image_.put("counters.restarts", counters_.restarts);
  image_.put("counters.clients_refused", counters_.clients_refused);
}

std::uint16_t PlcGate::status_bits() const {
  std::uint16_t bits = handshake_.status();
  const auto set = [&bits](bool on, std::uint16_t bit) {
    if (on) bits |= bit;
  };
  set(error_code_ != ErrorCode::none || faulty(), status_bit::kError);
  set(station_.warning_bits != 0 || second_writer_, status_bit::kWarning);
  set(station_.calibration_due, status_bit::kCalibrationDue);
  set(station_.simulated, status_bit::kSimulated);
  set(station_.time_valid, status_bit::kTimeValid);
  return bits;
}

}  // namespace brdfgate
