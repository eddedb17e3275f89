// Framing of Modbus TCP: the MBAP header (Modbus Messaging on TCP/IP Implementation Guide V1.0b,
// 3.1.3). Transaction, protocol (0), length of what follows, unit; then the PDU.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace brdfgate {

inline constexpr std::size_t kMbapHeaderBytes = 7;
inline constexpr std::size_t kMaxMbapFrameBytes = 260;

struct MbapFrame {
  /// A stream that broke its framing cannot be resynchronised: the connection must be closed.
  enum class State { incomplete, complete, broken } state = State::incomplete;
  std::uint16_t transaction = 0;
  std::uint8_t unit = 0;
  std::span<const std::uint8_t> pdu;  ///< into the bytes given
  std::size_t bytes = 0;              ///< of the whole frame
};

/// The frame at the start of `bytes`. A wrong protocol or a length outside 2..254 is found as soon
/// as its bytes are there.
MbapFrame parse_mbap(std::span<const std::uint8_t> bytes);

/// Appends a frame to `out`. @pre pdu of 1..253 bytes
void append_mbap(std::vector<std::uint8_t>& out, std::uint16_t transaction, std::uint8_t unit,
                 std::span<const std::uint8_t> pdu);

}  // namespace brdfgate
