// The servers' side of the gate: reads, writes and what they set off.
#include <algorithm>
#include <utility>

#include "app/plc/plc_gate.hpp"

namespace brdfgate {
namespace {

/// The control block as bits, for the coils.
constexpr std::size_t kCommandWord = 0;

ModbusOutcome bad_address() {
  return ModbusException::illegal_data_address;
}

}  // namespace

std::size_t PlcGate::control_index(std::string_view key) const {
  return static_cast<std::size_t>(image_.map().field(key).address - kControlAddress);
}

PlcGate::ControlWords PlcGate::control_words() const {
  ControlWords words{};
  std::ranges::copy(image_.words({kControlAddress, kControlRegisters}), words.begin());
  return words;
}

void PlcGate::hear(ModbusClient client) {
  if (owner_ == client) owner_heard_ = settings_.clock();
}

ModbusOutcome PlcGate::read_words(ModbusClient client, WordTable table, std::uint16_t address,
                                  std::span<std::uint16_t> out) {
  const std::size_t end = address + out.size();
  const std::lock_guard lock(mutex_);
  hear(client);
  const std::size_t limit =
      table == WordTable::input ? std::size_t{kReadOnlyRegisters} : image_.words().size();
  if (end > limit) return bad_address();
  std::ranges::copy(image_.words().subspan(address, out.size()), out.begin());
  return {};
}

ModbusOutcome PlcGate::read_bits(ModbusClient client, BitTable table, std::uint16_t address,
                                 std::span<std::uint8_t> out) {
  const std::size_t end = address + out.size();
  const std::lock_guard lock(mutex_);
  hear(client);
  const bool coils = table == BitTable::coils;
  if (end > static_cast<std::size_t>(coils ? kCoils : kDiscretes)) return bad_address();
  const std::uint32_t bits = image_.get(coils ? "control.command_bits" : "station.status_bits");
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = static_cast<std::uint8_t>(bits >> (address + i) & 1u);
  }
  return {};
}

ModbusOutcome PlcGate::write_words(ModbusClient client, std::uint16_t address,
                                   std::span<const std::uint16_t> values) {
  const std::size_t end = address + values.size();
  if (address < kControlAddress || end > kControlAddress + kControlRegisters) {
    return bad_address();
  }
  const std::lock_guard lock(mutex_);
  ControlWords words = control_words();
  std::ranges::copy(values, words.begin() + (address - kControlAddress));
  return apply(client, words);
}

ModbusOutcome PlcGate::write_bits(ModbusClient client, std::uint16_t address,
                                  std::span<const std::uint8_t> values) {
  if (address + values.size() > static_cast<std::size_t>(kCoils)) return bad_address();
  const std::lock_guard lock(mutex_);
  ControlWords words = control_words();
  std::uint16_t& command = words[kCommandWord];
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto mask = static_cast<std::uint16_t>(1u << (address + i));
    command = static_cast<std::uint16_t>(values[i] != 0 ? command | mask : command & ~mask);
  }
  return apply(client, words);
}

bool PlcGate::owned_by_another(ModbusClient client) {
  if (!owner_ || owner_ == client) return false;
  second_writer_ = true;
  refresh();
  return true;
}

ModbusOutcome PlcGate::refuse_selection(const ControlWords& words) const {
  const auto rising = static_cast<std::uint16_t>(words[kCommandWord] & ~handshake_.command_bits());
  if ((rising & command_bit::kRecipeSelect) == 0) return {};
  const std::uint16_t recipe = words[control_index("control.recipe")];
  if (std::ranges::find(recipes_, recipe) == recipes_.end()) {
    return ModbusException::illegal_data_value;
  }
  if (handshake_.busy()) return ModbusException::server_device_busy;
  return {};
}

ModbusOutcome PlcGate::apply(ModbusClient client, const ControlWords& words) {
  if (owned_by_another(client)) return ModbusException::server_device_busy;
  if ((words[kCommandWord] & ~command_bit::kAll) != 0) return ModbusException::illegal_data_value;
  if (const ModbusOutcome refused = refuse_selection(words)) return refused;
  const SteadyTime now = settings_.clock();
  owner_ = client;
  owner_heard_ = now;
  if (words[control_index("control.plc_heartbeat")] != image_.get("control.plc_heartbeat")) {
    plc_heartbeat_armed_ = true;
    plc_heartbeat_moved_ = now;
  }
  std::ranges::copy(words, image_.words({kControlAddress, kControlRegisters}).begin());
  follow(handshake_.command(words[kCommandWord], image_.get("control.trigger_id")), now);
  return {};
}

void PlcGate::follow(const Handshake::Edges& edges, SteadyTime now) {
  if (edges.clear_error) clear_error(now);
  if (edges.recipe_select) {
    pending_.recipe = static_cast<std::uint16_t>(image_.get("control.recipe"));
  }
  if (edges.missed) ++counters_.missed_triggers;
  if (edges.accepted) begin_part(*edges.accepted, now);
  refresh();
  if (edges.clear_error || edges.recipe_select || edges.accepted) commanded_.notify_all();
}

void PlcGate::begin_part(std::uint32_t trigger_id, SteadyTime now) {
  head_ = {};
  head_.sequence = ++sequence_;
  head_.trigger_id = trigger_id;
  head_.state = ResultState::processing;
  clear_result(image_);
  write_head(image_, head_);
  triggered_ = now;
  acquired_.reset();
  pending_.trigger = trigger_id;
}

void PlcGate::clear_error(SteadyTime now) {
  error_code_ = ErrorCode::none;
  second_writer_ = false;
  plc_heartbeat_lost_ = false;
  plc_heartbeat_moved_ = now;
  pending_.error_cleared = true;
}

void PlcGate::server_alive() {
  const std::lock_guard lock(mutex_);
  ++server_turns_;
}

void PlcGate::client_left(ModbusClient client) {
  const std::lock_guard lock(mutex_);
  if (owner_ == client) owner_.reset();
}

void PlcGate::client_refused(const std::string& address, const std::string& why) {
  {
    const std::lock_guard lock(mutex_);
    ++counters_.clients_refused;
    refresh();
  }
  if (settings_.note) settings_.note("Modbus client " + address + " refused: " + why);
}

}  // namespace brdfgate
