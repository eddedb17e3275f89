// Modbus protocol data units: decode a request, carry it out, encode the answer (Modbus Application
// Protocol Specification V1.1b3; section numbers below are its).
//
// Order of checks, as in the state diagrams of section 6: function code (01), structure and
// quantity (03), address range (02), execution (whatever the register space says; 04 when it
// throws). A request whose length does not fit its quantity or byte count is a structural fault:
// 03, "the implied length is incorrect".
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "hal/modbus/register_space.hpp"

namespace brdfgate {

inline constexpr std::size_t kMaxPduBytes = 253;  ///< section 4.1

/// Objects 0..6 of section 6.21, the basic and regular categories.
struct DeviceIdentification {
  std::string vendor_name;
  std::string product_code;
  std::string major_minor_revision;
  std::string vendor_url;
  std::string product_name;
  std::string model_name;
  std::string user_application_name;
};

/// Function codes 01, 02, 03, 04, 05, 06, 15, 16 and 43/14; anything else is exception 01.
/// @param request one PDU: function code and data, 1..253 bytes
/// @return the answer PDU, normal or exception
std::vector<std::uint8_t> answer_pdu(std::span<const std::uint8_t> request, ModbusClient client,
                                     RegisterSpace& space, const DeviceIdentification& device);

/// The exception answer to a function code.
std::vector<std::uint8_t> exception_pdu(std::uint8_t function, ModbusException code);

}  // namespace brdfgate
