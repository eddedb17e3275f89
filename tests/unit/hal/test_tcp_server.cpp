#include <modbus.h>

#include <memory>

#include "catch.hpp"
#include "hal/camera.hpp"
#include "hal/modbus/mbap.hpp"
#include "hal/modbus/tcp_server.hpp"
#include "support/input_error.hpp"
#include "support/modbus_peer.hpp"

using namespace brdfgate;
using namespace brdfgate::test;
using std::chrono::milliseconds;

namespace {

struct Bench {
  PlainSpace space;
  CountingObserver observer;
  TcpServer server;

  explicit Bench(TcpServerSettings settings = {})
      : server(free_port(std::move(settings)), space, observer) {}
  static TcpServerSettings free_port(TcpServerSettings settings) {
    settings.port = 0;
    settings.device = {"Maker", "code", "1.2", "", "", "", ""};
    return settings;
  }
  RawPeer connect() const { return RawPeer(server.port()); }
};

const Bytes kReadOne = hex("00 01 00 00 00 06 01 03 00 05 00 01");
const Bytes kReadOneAnswer = hex("00 01 00 00 00 05 01 03 02 12 34");

struct ModbusFree {
  void operator()(modbus_t* handle) const {
    modbus_close(handle);
    modbus_free(handle);
  }
};
std::unique_ptr<modbus_t, ModbusFree> libmodbus_client(int port, int unit) {
  std::unique_ptr<modbus_t, ModbusFree> client(modbus_new_tcp("127.0.0.1", port));
  modbus_set_slave(client.get(), unit);
  REQUIRE(modbus_connect(client.get()) == 0);
  return client;
}

}  // namespace

TEST_CASE("Frames are found whole, split and merged") {
  const Bytes two = [] {
    Bytes bytes = kReadOne;
    bytes.insert(bytes.end(), kReadOne.begin(), kReadOne.end());
    return bytes;
  }();
  for (std::size_t n = 0; n <= two.size(); ++n) {
    const MbapFrame frame = parse_mbap(std::span(two).first(n));
    INFO(n);
    CHECK(frame.state ==
          (n < kReadOne.size() ? MbapFrame::State::incomplete : MbapFrame::State::complete));
    if (frame.state != MbapFrame::State::complete) continue;
    CHECK(frame.bytes == kReadOne.size());
    CHECK(frame.transaction == 1);
    CHECK(frame.unit == 1);
    CHECK(Bytes(frame.pdu.begin(), frame.pdu.end()) == hex("03 00 05 00 01"));
  }
}

TEST_CASE("Wrong protocol and impossible lengths are known as soon as they are there") {
  using State = MbapFrame::State;
  CHECK(parse_mbap(hex("00 01 00 01")).state == State::broken);
  CHECK(parse_mbap(hex("00 01 01 00 00 06")).state == State::broken);
  CHECK(parse_mbap(hex("00 01 00 00 00 00")).state == State::broken);
  CHECK(parse_mbap(hex("00 01 00 00 00 01")).state == State::broken);
  CHECK(parse_mbap(hex("00 01 00 00 00 FF")).state == State::broken);  // 255: one over
  CHECK(parse_mbap(hex("00 01 00 00 00 FE")).state == State::incomplete);
  CHECK(parse_mbap(hex("00 01 00 00 FF FF")).state == State::broken);
  CHECK(parse_mbap(hex("00 01 00")).state == State::incomplete);
}

TEST_CASE("A request is answered however its bytes arrive") {
  Bench bench;
  bench.space.holding[5] = 0x1234;
  RawPeer peer = bench.connect();
  SECTION("at once") {
    CHECK(peer.ask(kReadOne, 11) == kReadOneAnswer);
  }
  SECTION("byte by byte") {
    RawPeer other = bench.connect();  // its answer says that the server has been round
    for (const std::uint8_t byte : kReadOne) {
      REQUIRE(other.ask(kReadOne, 11).size() == 11);
      peer.send({byte});
    }
    CHECK(peer.receive(11) == kReadOneAnswer);
  }
  SECTION("three and a half in one packet, the rest later") {
    Bytes bytes;
    for (int i = 0; i < 4; ++i)
      bytes.insert(bytes.end(), kReadOne.begin(), kReadOne.end());
    peer.send(Bytes(bytes.begin(), bytes.end() - 6));
    CHECK(peer.receive(33).size() == 33);
    peer.send(Bytes(bytes.end() - 6, bytes.end()));
    CHECK(peer.receive(11) == kReadOneAnswer);
  }
}

TEST_CASE(
    "Unit identifiers: the configured one, 0 and 255 are answered, others with exception 0A") {
  TcpServerSettings settings;
  settings.unit_id = 17;
  Bench bench(settings);
  RawPeer peer = bench.connect();
  for (const int unit : {17, 0, 255}) {
    Bytes request = kReadOne;
    request[6] = static_cast<std::uint8_t>(unit);
    const Bytes answer = peer.ask(request, 11);
    REQUIRE(answer.size() == 11);
    CHECK(answer[6] == unit);
    CHECK(answer[7] == 0x03);
  }
  CHECK(peer.ask(kReadOne, 9) == hex("00 01 00 00 00 03 01 83 0A"));
}

TEST_CASE("Broken framing closes its connection and no other") {
  Bench bench;
  RawPeer good = bench.connect();
  for (const char* bytes :
       {"00 01 00 07 00 06 01 03 00 05 00 01", "00 01 00 00 00 01 01", "FF FF FF FF FF FF FF FF",
        "47 45 54 20 2F 20 48 54 54 50 2F 31 2E 31 0D 0A"}) {
    RawPeer bad = bench.connect();
    bad.send(hex(bytes));
    CHECK(bad.closed());
    CHECK(good.ask(kReadOne, 11).size() == 11);
  }
  CHECK(bench.observer.wait_left(4));
}

TEST_CASE("A request that does not become whole in time is dropped, from its first byte on") {
  TcpServerSettings settings;
  settings.request_deadline = milliseconds(30);
  Bench bench(settings);
  RawPeer slow = bench.connect();
  RawPeer good = bench.connect();
  slow.send({0x00});
  // Further bytes do not extend the time: the other client is served meanwhile.
  const auto start = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() - start < milliseconds(25)) {
    REQUIRE(good.ask(kReadOne, 11).size() == 11);
  }
  slow.send({0x01});
  CHECK(slow.closed());
  CHECK(std::chrono::steady_clock::now() - start < milliseconds(2000));
  CHECK(good.ask(kReadOne, 11).size() == 11);
}

TEST_CASE("A silent connection is dropped after its idle time") {
  TcpServerSettings settings;
  settings.idle_timeout = milliseconds(30);
  Bench bench(settings);
  RawPeer peer = bench.connect();
  CHECK(peer.ask(kReadOne, 11).size() == 11);
  CHECK(peer.closed());
  CHECK(bench.observer.wait_left(1));
}

TEST_CASE("A client that does not take its answers delays nobody and is dropped") {
  TcpServerSettings settings;
  settings.request_deadline = milliseconds(100);
  Bench bench(settings);
  RawPeer greedy(bench.server.port(), 2048);
  RawPeer good = bench.connect();
  Bytes requests;
  const Bytes request = hex("00 01 00 00 00 06 01 03 00 00 00 7D");
  for (int i = 0; i < 500; ++i)
    requests.insert(requests.end(), request.begin(), request.end());
  for (int i = 0; i < 200; ++i)
    greedy.send_some(requests);
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 50; ++i)
    REQUIRE(good.ask(kReadOne, 11).size() == 11);
  CHECK(std::chrono::steady_clock::now() - start < milliseconds(1000));
  CHECK(bench.observer.wait_left(1));
}

TEST_CASE("A client that pipelines more than its socket holds gets every answer") {
  Bench bench;
  RawPeer peer = bench.connect();
  const Bytes request = hex("00 01 00 00 00 06 01 03 00 00 00 7D");
  constexpr std::size_t kRequests = 3000;
  Bytes requests;
  for (std::size_t i = 0; i < kRequests; ++i) {
    requests.insert(requests.end(), request.begin(), request.end());
    requests[requests.size() - 12] = static_cast<std::uint8_t>(i >> 8);
    requests[requests.size() - 11] = static_cast<std::uint8_t>(i & 0xFF);
  }
  constexpr std::size_t kAnswer = 9 + 250;
  std::size_t sent = 0;
  for (std::size_t i = 0; i < kRequests; ++i) {
    while (sent < requests.size()) {
      const std::size_t n =
          peer.send_some({requests.begin() + static_cast<std::ptrdiff_t>(sent), requests.end()});
      if (n == 0) break;
      sent += n;
    }
    const Bytes answer = peer.receive(kAnswer);
    REQUIRE(answer.size() == kAnswer);
    REQUIRE(static_cast<std::size_t>(answer[0] << 8 | answer[1]) == i);
  }
}

TEST_CASE("Clients beyond the cap or off the allow-list are refused and counted") {
  TcpServerSettings settings;
  SECTION("cap") {
    settings.max_clients = 2;
    Bench bench(settings);
    RawPeer first = bench.connect();
    RawPeer second = bench.connect();
    REQUIRE(first.ask(kReadOne, 11).size() == 11);
    REQUIRE(second.ask(kReadOne, 11).size() == 11);
    RawPeer third = bench.connect();
    CHECK(third.closed());
    CHECK(bench.observer.wait_refused(1));
    CHECK(contains(bench.observer.why(), "too many"));
    first.close();
    REQUIRE(bench.observer.wait_left(1));
    RawPeer fourth = bench.connect();
    CHECK(fourth.ask(kReadOne, 11).size() == 11);
  }
  SECTION("another address") {
    settings.allow = {"192.0.2.1"};
    Bench bench(settings);
    RawPeer peer = bench.connect();
    CHECK(peer.closed());
    CHECK(bench.observer.wait_refused(1));
    CHECK(contains(bench.observer.why(), "allow-list"));
  }
  SECTION("our own address, in another spelling") {
    settings.allow = {"192.0.2.1", "::ffff:127.0.0.1"};
    Bench bench(settings);
    RawPeer peer = bench.connect();
    CHECK(peer.ask(kReadOne, 11).size() == 11);
    CHECK(bench.observer.refused() == 0);
  }
}

TEST_CASE("A port in use and addresses that are none are told by name") {
  Bench bench;
  TcpServerSettings settings;
  settings.port = bench.server.port();
  std::string what;
  try {
    TcpServer second(settings, bench.space, bench.observer);
  } catch (const DeviceError& error) {
    what = error.what();
  }
  CHECK(contains(what, "127.0.0.1 port " + std::to_string(settings.port)));
  CHECK(contains(what, "bind"));
  settings.port = 0;
  settings.bind = "not.an.address";
  CHECK(contains(input_error([&] {
                   TcpServer s(settings, bench.space, bench.observer);
                   return 0;
                 }),
                 "not.an.address"));
  settings.bind = "127.0.0.1";
  settings.allow = {"10.0.0.300"};
  CHECK(contains(input_error([&] {
                   TcpServer s(settings, bench.space, bench.observer);
                   return 0;
                 }),
                 "10.0.0.300"));
}

TEST_CASE("The server stops with clients connected and frees its port") {
  PlainSpace space;
  CountingObserver observer;
  TcpServerSettings settings;
  settings.port = 0;
  auto server = std::make_unique<TcpServer>(settings, space, observer);
  settings.port = server->port();
  RawPeer peer(settings.port);
  peer.send({0x00});
  RawPeer other(settings.port);
  REQUIRE(other.ask(kReadOne, 11).size() == 11);
  server.reset();
  CHECK(peer.closed());
  CHECK(observer.wait_left(2));
  server = std::make_unique<TcpServer>(settings, space, observer);
  RawPeer again(settings.port);
  CHECK(again.ask(kReadOne, 11).size() == 11);
}

TEST_CASE("The loop reports that it is alive with nobody connected") {
  Bench bench;
  CHECK(bench.observer.wait_alive(3));
}

TEST_CASE("libmodbus's client, an independent peer, understands every answer") {
  Bench bench;
  for (std::size_t i = 0; i < 200; ++i) {
    bench.space.input[i] = static_cast<std::uint16_t>(1000 + i);
    bench.space.discretes[i] = i % 3 == 0 ? 1 : 0;
  }
  const auto client = libmodbus_client(bench.server.port(), 1);
  std::array<std::uint16_t, 125> words{};
  CHECK(modbus_read_input_registers(client.get(), 10, 125, words.data()) == 125);
  CHECK(words[124] == 1134);
  std::array<std::uint8_t, 100> bits{};
  CHECK(modbus_read_input_bits(client.get(), 0, 100, bits.data()) == 100);
  CHECK(bits[99] == 1);
  CHECK(bits[98] == 0);
  const std::array<std::uint16_t, 3> written{7, 8, 9};
  CHECK(modbus_write_registers(client.get(), 50, 3, written.data()) == 3);
  CHECK(modbus_read_registers(client.get(), 50, 3, words.data()) == 3);
  CHECK(words[2] == 9);
  CHECK(modbus_write_register(client.get(), 51, 77) == 1);
  CHECK(bench.space.holding[51] == 77);
  CHECK(modbus_write_bit(client.get(), 4, TRUE) == 1);
  CHECK(modbus_write_bits(client.get(), 5, 100, bits.data()) == 100);
  CHECK(modbus_read_bits(client.get(), 0, 100, bits.data()) == 100);
  CHECK(bits[4] == 1);
  CHECK(bits[5] == 1);
  CHECK(bits[6] == 0);
  CHECK(modbus_read_registers(client.get(), 1999, 2, words.data()) == -1);
  CHECK(errno == EMBXILADD);
  // 23: read and write in one request, which is not served.
  CHECK(modbus_write_and_read_registers(client.get(), 0, 1, written.data(), 0, 1, words.data()) ==
        -1);
  CHECK(errno == EMBXILFUN);
}
