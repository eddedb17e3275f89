// What a Modbus server serves: the four tables of the data model (Modbus Application Protocol
// V1.1b3, 4.3), whole requests at a time. The servers of this folder know nothing of what the
// registers mean; whoever implements this does.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace brdfgate {

/// Exception codes of the Modbus Application Protocol V1.1b3, section 7.
enum class ModbusException : std::uint8_t {
  illegal_function = 0x01,
  illegal_data_address = 0x02,
  illegal_data_value = 0x03,
  server_device_failure = 0x04,
  server_device_busy = 0x06,
  gateway_path_unavailable = 0x0A,
};
/// Empty: done.
using ModbusOutcome = std::optional<ModbusException>;

/// Who asks: one TCP connection, or the master of the serial line. Never used twice.
using ModbusClient = std::uint64_t;

enum class WordTable { input, holding };
enum class BitTable { discretes, coils };

/// Called on the servers' threads: implementations lock for themselves. A read is a picture of one
/// moment; a write is applied whole or not at all. Addresses are zero-based; address + size never
/// exceeds 65536.
class RegisterSpace {
 public:
  RegisterSpace() = default;
  RegisterSpace(const RegisterSpace&) = delete;
  RegisterSpace& operator=(const RegisterSpace&) = delete;
  virtual ~RegisterSpace() = default;

  /// Fills `out`, or leaves it undefined and returns an exception.
  virtual ModbusOutcome read_words(ModbusClient client, WordTable table, std::uint16_t address,
                                   std::span<std::uint16_t> out) = 0;
  /// As above; one byte per bit, 0 or 1.
  virtual ModbusOutcome read_bits(ModbusClient client, BitTable table, std::uint16_t address,
                                  std::span<std::uint8_t> out) = 0;
  /// Holding registers.
  virtual ModbusOutcome write_words(ModbusClient client, std::uint16_t address,
                                    std::span<const std::uint16_t> values) = 0;
  /// Coils; one byte per bit, 0 or 1.
  virtual ModbusOutcome write_bits(ModbusClient client, std::uint16_t address,
                                   std::span<const std::uint8_t> values) = 0;
};

/// What a server tells beside its requests, on its own thread. Must not block.
class ServerObserver {
 public:
  ServerObserver() = default;
  ServerObserver(const ServerObserver&) = delete;
  ServerObserver& operator=(const ServerObserver&) = delete;
  virtual ~ServerObserver() = default;

  /// The server's loop went round; at least every 100 ms while it is well.
  virtual void server_alive() = 0;
  virtual void client_left(ModbusClient client) = 0;
  /// A connection was refused: not on the allow-list, or the cap is reached.
  virtual void client_refused(const std::string& address, const std::string& why) = 0;
};

}  // namespace brdfgate
