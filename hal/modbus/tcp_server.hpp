// A Modbus TCP server on one thread and non-blocking sockets.
//
// Nobody waits for anybody: each turn of the loop takes what each connection has (at most one read
// per connection), answers the whole requests in it, and sends what the socket takes; the rest is
// kept. A connection whose answers pile up is not read until it drains. A request has its deadline
// from its first byte, an answer from the moment the peer stops taking it, a silent connection its
// idle time; keepalive and TCP_USER_TIMEOUT find peers that died without a word. Framing that is
// wrong (protocol, length) cannot be resynchronised: the connection is closed.
//
// Unit identifier (Messaging on TCP/IP Implementation Guide V1.0b, 4.4.1.2: 0xFF is recommended and
// 0 accepted for a device addressed by its IP address): the configured one, 0 and 255 are answered;
// any other gets exception 0A at once, so that a wrong setting shows without waiting.
#pragma once

#include <chrono>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "hal/modbus/pdu.hpp"
#include "hal/modbus/register_space.hpp"
#include "hal/modbus/unique_fd.hpp"

namespace brdfgate {

struct TcpServerSettings {
  std::string bind = "127.0.0.1";  ///< numeric IPv4 or IPv6 address
  int port = 1502;                 ///< 0: any free one, see TcpServer::port()
  std::vector<std::string> allow;  ///< numeric client addresses; empty: everyone
  int max_clients = 8;
  std::chrono::milliseconds request_deadline{2000};
  std::chrono::milliseconds idle_timeout{60000};
  std::uint8_t unit_id = 1;
  DeviceIdentification device;
};

class TcpServer {
 public:
  /// Listens and serves until destroyed; `space` and `observer` must outlive it. Throws InputError
  /// for an address that is none, DeviceError naming address and port when it cannot be bound.
  TcpServer(TcpServerSettings settings, RegisterSpace& space, ServerObserver& observer);
  TcpServer(const TcpServer&) = delete;
  TcpServer& operator=(const TcpServer&) = delete;
  /// Stops at once; connections are closed.
  ~TcpServer();

  int port() const { return port_; }

 private:
  using Clock = std::chrono::steady_clock;
  struct Connection;
  using Connections = std::map<ModbusClient, Connection>;

  void listen();
  void serve();
  void turn(Clock::time_point& listen_again);
  int wait_ms(Clock::time_point now) const;
  bool accept_one();
  bool may_connect(const std::string& address, std::string& why) const;
  /// False when the connection is to be closed.
  bool serve_connection(ModbusClient client, Connection& connection, short events);
  bool receive(Connection& connection) const;
  bool answer_requests(ModbusClient client, Connection& connection);
  static bool send_pending(Connection& connection);

  TcpServerSettings settings_;
  RegisterSpace& space_;
  ServerObserver& observer_;
  UniqueFd stop_;
  UniqueFd listener_;
  int port_ = 0;
  Connections connections_;
  std::jthread thread_;
};

}  // namespace brdfgate
