// The PLC's view of the station: register image, handshake, counters and control ownership behind
// one lock. The Modbus servers read and write it on their threads; the daemon reports to it and
// takes its commands on its own. Nothing here waits while holding the lock, and no call of the
// daemon waits for a PLC.
//
// Fail-safe: verdict and `pass` are zero from the start until a result is completed, are cleared
// before trigger_ack can be read, and a pass that stands when the station fails is withdrawn (it
// becomes "not judged", reason hardware, result_state failed).
#pragma once

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "app/plc/counters.hpp"
#include "app/plc/handshake.hpp"
#include "app/plc/plc_bits.hpp"
#include "app/plc/register_image.hpp"
#include "app/plc/result_blocks.hpp"
#include "hal/gpio/gpio_settings.hpp"
#include "hal/modbus/register_space.hpp"
#include "model/verdict.hpp"

namespace brdfgate {

using SteadyTime = std::chrono::steady_clock::time_point;

struct PlcGateSettings {
  WordOrder word_order = WordOrder::abcd;
  std::chrono::milliseconds handshake_timeout{10000};
  /// Nobody enables, acknowledges or clears errors: the hardware line does, with every part.
  bool without_plc = false;
  std::chrono::milliseconds plc_heartbeat_timeout{0};  ///< 0: not watched
  /// An owner of the control block that asks nothing for so long has fallen silent.
  std::chrono::milliseconds owner_silence{10000};
  /// Heartbeat stops when capture, judging or server made no progress for so long.
  std::chrono::milliseconds progress_limit{3000};
  std::function<SteadyTime()> clock = [] { return std::chrono::steady_clock::now(); };
  /// Told of refused connections, on a server's thread and without the lock held. May be empty.
  std::function<void(const std::string&)> note;
  /// Told what the machine's lines have to say whenever something may have changed, and with every
  /// tick; with the lock held, so it must neither wait nor call back. May be empty.
  std::function<void(const GpioOutputState&)> show;
};

/// What the daemon knows of its station. `state` is 0 to 4; the gate makes 5 of 4 while it is busy.
struct StationStatus {
  StationState state = StationState::preoperational;
  ErrorCode error_code = ErrorCode::none;  ///< latched until the PLC clears it
  std::uint16_t warning_bits = 0;          ///< bits 0..7; bit 8 is the gate's own
  std::uint16_t recipe_id = 0;
  std::uint16_t clusters = 0;
  std::uint16_t components = 0;
  std::uint16_t channels = 3;
  std::string config_hash;  ///< SHA-256, hex
  bool calibration_due = false;
  bool simulated = false;
  bool time_valid = false;
};

struct TriggerAccepted {
  std::uint32_t trigger_id = 0;
};
struct RecipeSelected {
  std::uint16_t recipe = 0;
};
struct ErrorCleared {};
using PlcCommand = std::variant<std::monostate, TriggerAccepted, RecipeSelected, ErrorCleared>;

/// Numbers that change whenever a part of the daemon gets on with its work.
struct ProgressMarks {
  std::uint64_t capture = 0;
  std::uint64_t judging = 0;
};

/// What a tick did, for the log.
struct TickReport {
  bool handshake_released = false;
  bool plc_heartbeat_lost = false;
  bool owner_released = false;
  bool stalled = false;  ///< no heartbeat: capture, judging or server stands still
};

/// As published with a result; milliseconds, not clamped.
struct PublishedTimes {
  std::uint32_t trigger_id = 0;
  std::uint32_t result_id = 0;
  Verdict verdict = Verdict::none;  ///< as published
  std::int64_t acquisition_ms = 0;
  std::int64_t processing_ms = 0;
  std::int64_t cycle_ms = 0;
};

class PlcGate : public RegisterSpace, public ServerObserver {
 public:
  PlcGate(const RegisterMap& map, PlcGateSettings settings, const Counters& counters);

  // --- the daemon's side -------------------------------------------------------------------------
  void set_station(const StationStatus& status);
  /// Numbers that recipe_select accepts.
  void set_recipes(std::vector<std::uint16_t> ids);
  /// The oldest command, or monostate when `timeout` passes or wake() is called. After a recipe
  /// selection and a trigger in one request the selection comes first.
  PlcCommand wait_for_command(std::chrono::milliseconds timeout);
  /// Ends one wait_for_command() now.
  void wake();
  /// The hardware line fired. False: not ready, counted as missed.
  bool external_trigger();
  /// The last frame is in: the part may leave.
  void acquisition_done();
  /// Ends the inspection under way with a result; empty when none is (it was aborted meanwhile).
  /// While the station is in error it ends as failed, "not judged", whatever the part says.
  std::optional<PublishedTimes> publish(const PartResult& part);
  /// Ends it with verdict "not judged". `state`: aborted or failed; failed counts as a fault and
  /// latches `error`, if any.
  std::optional<PublishedTimes> abort(ReasonBits reasons, ResultState state,
                                      ErrorCode error = ErrorCode::none);
  /// At least every 100 ms.
  TickReport tick(SteadyTime now, const ProgressMarks& marks);
  Counters counters() const;
  bool busy() const;

  // --- the servers' side
  // ---------------------------------------------------------------------------
  ModbusOutcome read_words(ModbusClient client, WordTable table, std::uint16_t address,
                           std::span<std::uint16_t> out) override;
  ModbusOutcome read_bits(ModbusClient client, BitTable table, std::uint16_t address,
                          std::span<std::uint8_t> out) override;
  ModbusOutcome write_words(ModbusClient client, std::uint16_t address,
                            std::span<const std::uint16_t> values) override;
  ModbusOutcome write_bits(ModbusClient client, std::uint16_t address,
                           std::span<const std::uint8_t> values) override;
  void server_alive() override;
  void client_left(ModbusClient client) override;
  void client_refused(const std::string& address, const std::string& why) override;

 private:
  using ControlWords = std::array<std::uint16_t, kControlRegisters>;
  struct Pending {
    bool error_cleared = false;
    std::optional<std::uint16_t> recipe;
    std::optional<std::uint32_t> trigger;
    bool woken = false;
  };
  /// One thing that must move.
  struct Watched {
    std::uint64_t mark = 0;
    SteadyTime moved{};
    bool stalled(std::uint64_t now_mark, SteadyTime now, std::chrono::milliseconds limit);
  };

  // All below: with the lock held.
  ModbusOutcome apply(ModbusClient client, const ControlWords& words);
  ModbusOutcome refuse_selection(const ControlWords& words) const;
  bool owned_by_another(ModbusClient client);
  void hear(ModbusClient client);
  void follow(const Handshake::Edges& edges, SteadyTime now);
  void begin_part(std::uint32_t trigger_id, SteadyTime now);
  std::optional<PublishedTimes> finish(RegisterImage& result, ResultState state, Verdict verdict);
  void count_verdict(Verdict verdict);
  void latch_error(ErrorCode code);
  void withdraw_pass();
  void clear_error(SteadyTime now);
  bool watch_plc_heartbeat(SteadyTime now);
  bool release_silent_owner(SteadyTime now);
  bool beat(SteadyTime now, const ProgressMarks& marks);
  StationState base_state() const;
  bool faulty() const { return base_state() == StationState::error; }
  ControlWords control_words() const;
  std::size_t control_index(std::string_view key) const;
  void refresh();
  void refresh_counters();
  std::uint16_t status_bits() const;
  GpioOutputState outputs() const;

  const PlcGateSettings settings_;
  mutable std::mutex mutex_;
  std::condition_variable commanded_;
  RegisterImage image_;
  Handshake handshake_;
  StationStatus station_;
  std::vector<std::uint16_t> recipes_;
  Counters counters_;
  Pending pending_;
  std::uint32_t sequence_ = 0;
  ResultHead head_;
  SteadyTime triggered_{};
  std::optional<SteadyTime> acquired_;
  ErrorCode error_code_ = ErrorCode::none;
  bool plc_heartbeat_lost_ = false;
  bool second_writer_ = false;
  std::optional<ModbusClient> owner_;
  SteadyTime owner_heard_{};
  bool plc_heartbeat_armed_ = false;
  SteadyTime plc_heartbeat_moved_{};
  Watched capture_, judging_, server_;
  std::uint64_t server_turns_ = 0;
  std::uint16_t heartbeat_ = 0;
  SteadyTime started_{};
  SteadyTime next_beat_{};
};

}  // namespace brdfgate
