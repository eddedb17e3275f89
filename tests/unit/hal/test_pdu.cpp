#include "catch.hpp"
#include "hal/modbus/pdu.hpp"
#include "support/modbus_peer.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

const DeviceIdentification kDevice{"Maker", "code", "1.2", "", "gate", "model", ""};

std::string ask(PlainSpace& space, const std::string& request) {
  return to_hex(answer_pdu(hex(request), 7, space, kDevice));
}

/// The state behind the examples of the Modbus Application Protocol V1.1b3, whose addresses are
/// zero-based in the messages ("input register 9" is 00 08).
void fill_with_examples(PlainSpace& space) {
  const Bytes coil_bytes = hex("CD 6B 05");  // 6.1: coils 20-38
  for (std::size_t i = 0; i < 19; ++i)
    space.coils[0x13 + i] = coil_bytes[i / 8] >> (i % 8) & 1;
  const Bytes input_bytes = hex("AC DB 35");  // 6.2: discrete inputs 197-218
  for (std::size_t i = 0; i < 22; ++i) {
    space.discretes[0xC4 + i] = input_bytes[i / 8] >> (i % 8) & 1;
  }
  space.holding[0x6B] = 0x022B;  // 6.3: holding registers 108-110
  space.holding[0x6C] = 0x0000;
  space.holding[0x6D] = 0x0064;
  space.input[8] = 0x000A;  // 6.4: input register 9
}

struct Exchange {
  const char* about;
  const char* request;
  const char* answer;
};

void check_all(const std::vector<Exchange>& exchanges) {
  for (const Exchange& exchange : exchanges) {
    INFO(exchange.about << ": " << exchange.request);
    PlainSpace space;
    fill_with_examples(space);
    CHECK(ask(space, exchange.request) == exchange.answer);
  }
}

}  // namespace

TEST_CASE("The specification's own examples are answered byte by byte") {
  check_all({{"6.1 read coils", "01 00 13 00 13", "01 03 CD 6B 05"},
             {"6.2 read discrete inputs", "02 00 C4 00 16", "02 03 AC DB 35"},
             {"6.3 read holding registers", "03 00 6B 00 03", "03 06 02 2B 00 00 00 64"},
             {"6.4 read input registers", "04 00 08 00 01", "04 02 00 0A"},
             {"6.5 write single coil", "05 00 AC FF 00", "05 00 AC FF 00"},
             {"6.6 write single register", "06 00 01 00 03", "06 00 01 00 03"},
             {"6.11 write multiple coils", "0F 00 13 00 0A 02 CD 01", "0F 00 13 00 0A"},
             {"6.12 write multiple registers", "10 00 01 00 02 04 00 0A 01 02", "10 00 01 00 02"}});
}

TEST_CASE("What a write request carries arrives in the tables") {
  PlainSpace space;
  ask(space, "05 00 AC FF 00");
  CHECK(space.coils[0xAC] == 1);
  ask(space, "05 00 AC 00 00");
  CHECK(space.coils[0xAC] == 0);
  ask(space, "06 00 01 AB CD");
  CHECK(space.holding[1] == 0xABCD);
  ask(space, "0F 00 13 00 0A 02 CD 01");
  const std::vector<std::uint8_t> coils(space.coils.begin() + 0x13, space.coils.begin() + 0x1D);
  CHECK(coils == std::vector<std::uint8_t>{1, 0, 1, 1, 0, 0, 1, 1, 1, 0});
  ask(space, "10 00 01 00 02 04 00 0A 01 02");
  CHECK(space.holding[1] == 0x000A);
  CHECK(space.holding[2] == 0x0102);
}

TEST_CASE("Function codes that are not served are exception 01") {
  PlainSpace space;
  for (int function = 0; function < 128; ++function) {
    const bool served = function == 1 || function == 2 || function == 3 || function == 4 ||
                        function == 5 || function == 6 || function == 15 || function == 16;
    const Bytes request{static_cast<std::uint8_t>(function), 0, 0, 0, 1};
    const Bytes answer = answer_pdu(request, 1, space, kDevice);
    INFO(function);
    const Bytes refused{static_cast<std::uint8_t>(function | 0x80), 0x01};
    if (function != 43) CHECK((answer == refused) != served);  // 43: see its MEI type below
  }
  CHECK(ask(space, "81 00 00 00 01") == "81 01");
  CHECK(ask(space, "2B 0D 01 00") == "AB 01");
}

TEST_CASE("Quantities of zero, beyond the limit or unlike the length are exception 03") {
  check_all({{"no coils", "01 00 00 00 00", "81 03"},
             {"2001 coils", "01 00 00 07 D1", "81 03"},
             {"no inputs", "02 00 00 00 00", "82 03"},
             {"126 registers", "03 00 00 00 7E", "83 03"},
             {"no registers", "04 00 00 00 00", "84 03"},
             {"65535 registers", "04 00 00 FF FF", "84 03"},
             {"function code alone", "03", "83 03"},
             {"cut after the address", "03 00 00", "83 03"},
             {"one byte too many", "03 00 00 00 01 00", "83 03"},
             {"coil value neither on nor off", "05 00 00 12 34", "85 03"},
             {"coil value FF01", "05 00 00 FF 01", "85 03"},
             {"register write cut short", "06 00 00 00", "86 03"},
             {"no coils written", "0F 00 00 00 00 00", "8F 03"},
             {"1969 coils written", "0F 00 00 07 B1 F7", "8F 03"},
             {"byte count of coils too small", "0F 00 00 00 09 01 FF", "8F 03"},
             {"coil data missing", "0F 00 00 00 09 02 FF", "8F 03"},
             {"no registers written", "10 00 00 00 00 00", "90 03"},
             {"124 registers written", "10 00 00 00 7C F8", "90 03"},
             {"byte count of registers odd", "10 00 00 00 01 01 00", "90 03"},
             {"register data missing", "10 00 00 00 02 04 00 01", "90 03"},
             {"register data too long", "10 00 00 00 01 02 00 01 00", "90 03"},
             {"identification cut short", "2B 0E 01", "AB 03"},
             {"identification code 0", "2B 0E 00 00", "AB 03"},
             {"identification code 5", "2B 0E 05 00", "AB 03"},
             {"MEI type missing", "2B", "AB 03"}});
}

TEST_CASE("The largest requests that the specification allows are served") {
  PlainSpace space;
  CHECK(answer_pdu(hex("01 00 00 07 D0"), 1, space, kDevice).size() == 2 + 250);
  CHECK(answer_pdu(hex("03 00 00 00 7D"), 1, space, kDevice).size() == 2 + 250);
  Bytes write = hex("10 00 00 00 7B F6");
  write.resize(6 + 246);
  CHECK(answer_pdu(write, 1, space, kDevice) == hex("10 00 00 00 7B"));
  Bytes coils = hex("0F 00 00 07 B0 F6");
  coils.resize(6 + 246);
  CHECK(answer_pdu(coils, 1, space, kDevice) == hex("0F 00 00 07 B0"));
}

TEST_CASE("Ranges past the end of a table or of the address space are exception 02") {
  check_all({{"end of the table", "03 07 D0 00 01", "83 02"},
             {"across its end", "04 07 CF 00 02", "84 02"},
             {"wrapping around", "03 FF FF 00 02", "83 02"},
             {"coils wrapping around", "01 FF FF 00 02", "81 02"},
             {"writes wrapping around", "10 FF FF 00 02 04 00 00 00 00", "90 02"},
             {"coil writes wrapping around", "0F FF FF 00 02 01 03", "8F 02"},
             {"single register", "06 FF FF 00 00", "86 02"},
             {"single coil", "05 FF FF FF 00", "85 02"}});
}

TEST_CASE("A refused write leaves everything as it was") {
  PlainSpace space;
  CHECK(ask(space, "10 07 CF 00 02 04 00 01 00 02") == "90 02");
  CHECK(space.holding == std::vector<std::uint16_t>(PlainSpace::kEnd));
}

TEST_CASE("A register space that throws is exception 04") {
  PlainSpace space;
  space.broken = true;
  CHECK(ask(space, "03 00 00 00 01") == "83 04");
}

TEST_CASE("An empty or over-long request is refused") {
  PlainSpace space;
  CHECK(to_hex(answer_pdu({}, 1, space, kDevice)) == "80 01");
  CHECK(to_hex(answer_pdu(Bytes(254, 0x03), 1, space, kDevice)) == "83 03");
}

TEST_CASE("Device identification gives the categories and single objects") {
  PlainSpace space;
  // Basic: vendor, product code, revision; conformity 82, nothing more follows, three objects.
  CHECK(ask(space, "2B 0E 01 00") ==
        "2B 0E 01 82 00 00 03 00 05 4D 61 6B 65 72 01 04 63 6F 64 65 02 03 31 2E 32");
  // Starting in the middle, and from an object that is not in the category: from the beginning.
  CHECK(ask(space, "2B 0E 01 02") == "2B 0E 01 82 00 00 01 02 03 31 2E 32");
  CHECK(ask(space, "2B 0E 01 03") == ask(space, "2B 0E 01 00"));
  const Bytes regular = answer_pdu(hex("2B 0E 02 00"), 1, space, kDevice);
  CHECK(regular[6] == 7);
  // Extended is answered at the device's own level.
  const Bytes extended = answer_pdu(hex("2B 0E 03 00"), 1, space, kDevice);
  CHECK(Bytes(extended.begin() + 3, extended.end()) == Bytes(regular.begin() + 3, regular.end()));
  CHECK(ask(space, "2B 0E 04 04") == "2B 0E 04 82 00 00 01 04 04 67 61 74 65");
  CHECK(ask(space, "2B 0E 04 07") == "AB 02");
}

TEST_CASE("Identification too long for one answer continues where the answer says") {
  PlainSpace space;
  DeviceIdentification device = kDevice;
  device.vendor_url = std::string(200, 'u');
  device.product_name = std::string(100, 'p');
  const Bytes first = answer_pdu(hex("2B 0E 02 00"), 1, space, device);
  CHECK(first.size() <= kMaxPduBytes);
  CHECK(first[4] == 0xFF);
  CHECK(first[5] == 4);
  CHECK(first[6] == 4);
  const Bytes rest = answer_pdu(hex("2B 0E 02 04"), 1, space, device);
  CHECK(rest[4] == 0x00);
  CHECK(rest[6] == 3);
  device.vendor_name = std::string(400, 'v');
  const Bytes cut = answer_pdu(hex("2B 0E 04 00"), 1, space, device);
  CHECK(cut.size() == kMaxPduBytes);
  CHECK(cut[8] == kMaxPduBytes - 9);
}

TEST_CASE("Random bytes always get an answer of a legal size") {
  PlainSpace space;
  std::uint32_t state = 12345;
  const auto next = [&state] { return state = state * 1664525u + 1013904223u; };
  for (int i = 0; i < 20000; ++i) {
    Bytes request(1 + (next() >> 16) % 24);
    for (std::uint8_t& b : request)
      b = static_cast<std::uint8_t>(next() >> 24);
    if (i % 2 == 0) request[0] = static_cast<std::uint8_t>((next() >> 16) % 17);
    const Bytes answer = answer_pdu(request, 1, space, kDevice);
    REQUIRE(answer.size() >= 2);
    REQUIRE(answer.size() <= kMaxPduBytes);
    REQUIRE((answer[0] & 0x7F) == (request[0] & 0x7F));
  }
}
