#include "hal/modbus/pdu.hpp"

#include <algorithm>
#include <array>
#include <exception>

namespace brdfgate {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Request = std::span<const std::uint8_t>;

// Quantities per request, sections 6.1 to 6.12.
constexpr std::size_t kMaxReadBits = 2000;
constexpr std::size_t kMaxReadWords = 125;
constexpr std::size_t kMaxWriteBits = 1968;
constexpr std::size_t kMaxWriteWords = 123;
constexpr std::size_t kAddresses = 65536;

/// Thrown inside this file only: leads out of nested decoding to the exception answer.
struct Refused {
  ModbusException code;
};

std::uint16_t word_at(Request request, std::size_t offset) {
  return static_cast<std::uint16_t>(request[offset] << 8 | request[offset + 1]);
}

void put_word(Bytes& out, std::uint16_t word) {
  out.push_back(static_cast<std::uint8_t>(word >> 8));
  out.push_back(static_cast<std::uint8_t>(word & 0xFF));
}

void require_size(Request request, std::size_t size) {
  if (request.size() != size) throw Refused{ModbusException::illegal_data_value};
}

void check_outcome(ModbusOutcome outcome) {
  if (outcome) throw Refused{*outcome};
}

/// Start address and quantity of a multiple read or write.
struct Range {
  std::uint16_t address;
  std::size_t count;
};
Range range_of(Request request, std::size_t most) {
  if (request.size() < 5) throw Refused{ModbusException::illegal_data_value};
  const Range range{word_at(request, 1), word_at(request, 3)};
  if (range.count < 1 || range.count > most) throw Refused{ModbusException::illegal_data_value};
  return range;
}
void check_address(const Range& range) {
  if (range.address + range.count > kAddresses) {
    throw Refused{ModbusException::illegal_data_address};
  }
}

Bytes read_bits(Request request, ModbusClient client, RegisterSpace& space, BitTable table) {
  const Range range = range_of(request, kMaxReadBits);
  require_size(request, 5);
  check_address(range);
  std::vector<std::uint8_t> bits(range.count);
  check_outcome(space.read_bits(client, table, range.address, bits));
  Bytes out{request[0], static_cast<std::uint8_t>((range.count + 7) / 8)};
  out.resize(2 + (range.count + 7) / 8);
  for (std::size_t i = 0; i < bits.size(); ++i) {
    if (bits[i] != 0) out[2 + i / 8] |= static_cast<std::uint8_t>(1u << (i % 8));
  }
  return out;
}

Bytes read_words(Request request, ModbusClient client, RegisterSpace& space, WordTable table) {
  const Range range = range_of(request, kMaxReadWords);
  require_size(request, 5);
  check_address(range);
  std::array<std::uint16_t, kMaxReadWords> words{};
  const std::span<std::uint16_t> wanted(words.data(), range.count);
  check_outcome(space.read_words(client, table, range.address, wanted));
  Bytes out{request[0], static_cast<std::uint8_t>(2 * range.count)};
  for (const std::uint16_t word : wanted)
    put_word(out, word);
  return out;
}

Bytes write_single_bit(Request request, ModbusClient client, RegisterSpace& space) {
  require_size(request, 5);
  const std::uint16_t value = word_at(request, 3);
  if (value != 0x0000 && value != 0xFF00) throw Refused{ModbusException::illegal_data_value};
  const std::array<std::uint8_t, 1> bit{static_cast<std::uint8_t>(value != 0 ? 1 : 0)};
  check_outcome(space.write_bits(client, word_at(request, 1), bit));
  return {request.begin(), request.end()};
}

Bytes write_single_word(Request request, ModbusClient client, RegisterSpace& space) {
  require_size(request, 5);
  const std::array<std::uint16_t, 1> word{word_at(request, 3)};
  check_outcome(space.write_words(client, word_at(request, 1), word));
  return {request.begin(), request.end()};
}

/// The byte count must say what follows and fit the quantity.
void check_byte_count(Request request, std::size_t expected) {
  if (request.size() < 6 || request[5] != expected) {
    throw Refused{ModbusException::illegal_data_value};
  }
  require_size(request, 6 + expected);
}

Bytes write_bits(Request request, ModbusClient client, RegisterSpace& space) {
  const Range range = range_of(request, kMaxWriteBits);
  check_byte_count(request, (range.count + 7) / 8);
  check_address(range);
  std::vector<std::uint8_t> bits(range.count);
  for (std::size_t i = 0; i < bits.size(); ++i) {
    bits[i] = static_cast<std::uint8_t>(request[6 + i / 8] >> (i % 8) & 1);
  }
  check_outcome(space.write_bits(client, range.address, bits));
  return {request.begin(), request.begin() + 5};
}

Bytes write_words(Request request, ModbusClient client, RegisterSpace& space) {
  const Range range = range_of(request, kMaxWriteWords);
  check_byte_count(request, 2 * range.count);
  check_address(range);
  std::vector<std::uint16_t> words(range.count);
  for (std::size_t i = 0; i < words.size(); ++i)
    words[i] = word_at(request, 6 + 2 * i);
  check_outcome(space.write_words(client, range.address, words));
  return {request.begin(), request.begin() + 5};
}

// Read device identification, section 6.21.
constexpr std::uint8_t kMeiReadDeviceIdentification = 14;
constexpr std::uint8_t kBasicStream = 1;
constexpr std::uint8_t kExtendedStream = 3;
constexpr std::uint8_t kIndividual = 4;
constexpr std::uint8_t kRegularWithIndividual = 0x82;  ///< conformity level
constexpr std::size_t kBasicObjects = 3;
constexpr std::size_t kObjects = 7;

std::array<const std::string*, kObjects> objects_of(const DeviceIdentification& device) {
  return {&device.vendor_name,          &device.product_code, &device.major_minor_revision,
          &device.vendor_url,           &device.product_name, &device.model_name,
          &device.user_application_name};
}

/// One object whole if it fits into what is left of the PDU; a single one is cut to fit.
bool append_object(Bytes& out, std::size_t id, std::string text) {
  const std::size_t room = kMaxPduBytes - out.size();
  const bool first = out.size() == 7;
  if (first && text.size() + 2 > room) text.resize(room - 2);
  if (text.size() + 2 > room) return false;
  out.push_back(static_cast<std::uint8_t>(id));
  out.push_back(static_cast<std::uint8_t>(text.size()));
  out.insert(out.end(), text.begin(), text.end());
  return true;
}

Bytes read_device_identification(Request request, const DeviceIdentification& device) {
  if (request.size() < 2) throw Refused{ModbusException::illegal_data_value};
  if (request[1] != kMeiReadDeviceIdentification) {
    throw Refused{ModbusException::illegal_function};
  }
  require_size(request, 4);
  const std::uint8_t code = request[2];
  if (code < kBasicStream || code > kIndividual) {
    throw Refused{ModbusException::illegal_data_value};
  }
  std::size_t first = request[3];
  std::size_t end = code == kBasicStream ? kBasicObjects : kObjects;
  if (code == kIndividual) {
    if (first >= kObjects) throw Refused{ModbusException::illegal_data_address};
    end = first + 1;
  } else if (first >= end) {
    first = 0;  // "as if object 0 were pointed out (restart at the beginning)"
  }
  static_assert(kExtendedStream < kIndividual);  // answered at our level, regular
  const auto objects = objects_of(device);
  Bytes out{request[0], request[1], code, kRegularWithIndividual, 0x00, 0x00, 0x00};
  for (std::size_t id = first; id < end; ++id) {
    if (!append_object(out, id, *objects[id])) {
      out[4] = 0xFF;  // more follows
      out[5] = static_cast<std::uint8_t>(id);
      break;
    }
    ++out[6];
  }
  return out;
}

Bytes answer(Request request, ModbusClient client, RegisterSpace& space,
             const DeviceIdentification& device) {
  switch (request[0]) {
    case 0x01:
      return read_bits(request, client, space, BitTable::coils);
    case 0x02:
      return read_bits(request, client, space, BitTable::discretes);
    case 0x03:
      return read_words(request, client, space, WordTable::holding);
    case 0x04:
      return read_words(request, client, space, WordTable::input);
    case 0x05:
      return write_single_bit(request, client, space);
    case 0x06:
      return write_single_word(request, client, space);
    case 0x0F:
      return write_bits(request, client, space);
    case 0x10:
      return write_words(request, client, space);
    case 0x2B:
      return read_device_identification(request, device);
    default:
      throw Refused{ModbusException::illegal_function};
  }
}

}  // namespace

std::vector<std::uint8_t> exception_pdu(std::uint8_t function, ModbusException code) {
  return {static_cast<std::uint8_t>(function | 0x80), static_cast<std::uint8_t>(code)};
}

std::vector<std::uint8_t> answer_pdu(std::span<const std::uint8_t> request, ModbusClient client,
                                     RegisterSpace& space, const DeviceIdentification& device) {
  const std::uint8_t function = request.empty() ? 0 : request[0];
  if (request.empty()) return exception_pdu(function, ModbusException::illegal_function);
  if (request.size() > kMaxPduBytes) {
    return exception_pdu(function, ModbusException::illegal_data_value);
  }
  try {
    return answer(request, client, space, device);
  } catch (const Refused& refused) {
    return exception_pdu(function, refused.code);
  } catch (const std::exception&) {
    return exception_pdu(function, ModbusException::server_device_failure);
  }
}

}  // namespace brdfgate
