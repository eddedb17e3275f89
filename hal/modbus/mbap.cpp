#include "hal/modbus/mbap.hpp"

namespace brdfgate {
namespace {
std::uint16_t word_at(std::span<const std::uint8_t> bytes, std::size_t offset) {
  return static_cast<std::uint16_t>(bytes[offset] << 8 | bytes[offset + 1]);
}
}  // namespace

MbapFrame parse_mbap(std::span<const std::uint8_t> bytes) {
  MbapFrame frame;
  if (bytes.size() >= 4 && word_at(bytes, 2) != 0) frame.state = MbapFrame::State::broken;
  if (bytes.size() < 6 || frame.state == MbapFrame::State::broken) return frame;
  const std::size_t length = word_at(bytes, 4);  // unit and PDU
  if (length < 2 || length > kMaxMbapFrameBytes - 6) {
    frame.state = MbapFrame::State::broken;
    return frame;
  }
  if (bytes.size() < 6 + length) return frame;
  frame.state = MbapFrame::State::complete;
  frame.transaction = word_at(bytes, 0);
  frame.unit = bytes[6];
  frame.pdu = bytes.subspan(kMbapHeaderBytes, length - 1);
  frame.bytes = 6 + length;
  return frame;
}

void append_mbap(std::vector<std::uint8_t>& out, std::uint16_t transaction, std::uint8_t unit,
                 std::span<const std::uint8_t> pdu) {
  const std::size_t length = pdu.size() + 1;
  const auto high = [](std::size_t word) { return static_cast<std::uint8_t>(word >> 8); };
  const auto low = [](std::size_t word) { return static_cast<std::uint8_t>(word & 0xFF); };
  out.insert(out.end(),
             {high(transaction), low(transaction), 0, 0, high(length), low(length), unit});
  out.insert(out.end(), pdu.begin(), pdu.end());
}

}  // namespace brdfgate
