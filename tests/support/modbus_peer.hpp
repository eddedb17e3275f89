// The other end of a Modbus connection in tests: raw bytes over TCP, and a register space that
// remembers what was asked of it.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <condition_variable>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "hal/modbus/register_space.hpp"
#include "hal/modbus/unique_fd.hpp"

namespace brdfgate::test {

using Bytes = std::vector<std::uint8_t>;

/// "00 01 ff" to bytes.
inline Bytes hex(const std::string& text) {
  Bytes out;
  std::string digits;
  for (const char c : text) {
    if (c != ' ') digits += c;
  }
  for (std::size_t i = 0; i + 1 < digits.size(); i += 2) {
    out.push_back(static_cast<std::uint8_t>(std::stoi(digits.substr(i, 2), nullptr, 16)));
  }
  return out;
}

inline std::string to_hex(const Bytes& bytes) {
  std::string out;
  for (const std::uint8_t b : bytes) {
    constexpr const char* kDigits = "0123456789ABCDEF";
    if (!out.empty()) out += ' ';
    out += kDigits[b >> 4];
    out += kDigits[b & 15];
  }
  return out;
}

/// A blocking TCP client with a deadline on every read.
class RawPeer {
 public:
  explicit RawPeer(int port, int receive_buffer = 0) : fd_(::socket(AF_INET, SOCK_STREAM, 0)) {
    if (receive_buffer > 0) {
      ::setsockopt(fd_.get(), SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    }
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(fd_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
      throw std::runtime_error("connect");
    }
  }
  void send(const Bytes& bytes) { ::send(fd_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL); }
  /// As much as the socket takes without waiting.
  std::size_t send_some(const Bytes& bytes) {
    const ssize_t n = ::send(fd_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    return n < 0 ? 0 : static_cast<std::size_t>(n);
  }
  /// `count` bytes, fewer when the connection ends or five seconds pass.
  Bytes receive(std::size_t count) {
    Bytes out;
    while (out.size() < count && readable()) {
      std::array<std::uint8_t, 4096> buffer{};
      const ssize_t got =
          ::recv(fd_.get(), buffer.data(), std::min(buffer.size(), count - out.size()), 0);
      if (got <= 0) break;
      out.insert(out.end(), buffer.begin(), buffer.begin() + got);
    }
    return out;
  }
  Bytes ask(const Bytes& frame, std::size_t answer_bytes) {
    send(frame);
    return receive(answer_bytes);
  }
  /// The server closed the connection (waits for it).
  bool closed() {
    for (std::array<std::uint8_t, 4096> buffer{}; readable();) {
      if (::recv(fd_.get(), buffer.data(), buffer.size(), 0) <= 0) return true;
    }
    return false;
  }
  void close() { fd_.reset(); }

 private:
  bool readable() const {
    pollfd polled{fd_.get(), POLLIN, 0};
    return ::poll(&polled, 1, 5000) == 1;
  }
  UniqueFd fd_;
};

/// Sixteen-bit words and bits that can be written everywhere up to an end.
class PlainSpace : public RegisterSpace {
 public:
  static constexpr std::size_t kEnd = 2000;
  std::vector<std::uint16_t> holding = std::vector<std::uint16_t>(kEnd);
  std::vector<std::uint16_t> input = std::vector<std::uint16_t>(kEnd);
  std::vector<std::uint8_t> coils = std::vector<std::uint8_t>(kEnd);
  std::vector<std::uint8_t> discretes = std::vector<std::uint8_t>(kEnd);
  bool broken = false;
  std::atomic<int> requests{0};

  ModbusOutcome read_words(ModbusClient /*client*/, WordTable table, std::uint16_t address,
                           std::span<std::uint16_t> out) override {
    return copy_out(table == WordTable::input ? input : holding, address, out);
  }
  ModbusOutcome read_bits(ModbusClient /*client*/, BitTable table, std::uint16_t address,
                          std::span<std::uint8_t> out) override {
    return copy_out(table == BitTable::coils ? coils : discretes, address, out);
  }
  ModbusOutcome write_words(ModbusClient /*client*/, std::uint16_t address,
                            std::span<const std::uint16_t> values) override {
    return copy_in(values, address, holding);
  }
  ModbusOutcome write_bits(ModbusClient /*client*/, std::uint16_t address,
                           std::span<const std::uint8_t> values) override {
    return copy_in(values, address, coils);
  }

 private:
  template <class T>
  ModbusOutcome copy_out(const std::vector<T>& from, std::size_t address, std::span<T> out) {
    ++requests;
    if (broken) throw std::runtime_error("broken");
    if (address + out.size() > from.size()) return ModbusException::illegal_data_address;
    for (std::size_t i = 0; i < out.size(); ++i)
      out[i] = from[address + i];
    return {};
  }
  template <class T>
  ModbusOutcome copy_in(std::span<const T> from, std::size_t address, std::vector<T>& to) {
    ++requests;
    if (address + from.size() > to.size()) return ModbusException::illegal_data_address;
    for (std::size_t i = 0; i < from.size(); ++i)
      to[address + i] = from[i];
    return {};
  }
};

/// Counts, and lets a test wait for, what a server tells.
class CountingObserver : public ServerObserver {
 public:
  void server_alive() override { note(alive_); }
  void client_left(ModbusClient /*client*/) override { note(left_); }
  void client_refused(const std::string& /*address*/, const std::string& why) override {
    {
      const std::lock_guard lock(mutex_);
      why_ = why;
    }
    note(refused_);
  }
  bool wait_alive(int more) { return wait(alive_, more); }
  bool wait_left(int count) { return wait(left_, count); }
  bool wait_refused(int count) { return wait(refused_, count); }
  int refused() {
    const std::lock_guard lock(mutex_);
    return refused_;
  }
  std::string why() {
    const std::lock_guard lock(mutex_);
    return why_;
  }

 private:
  void note(int& counter) {
    const std::lock_guard lock(mutex_);
    ++counter;
    changed_.notify_all();
  }
  bool wait(const int& counter, int count) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(5), [&] { return counter >= count; });
  }
  std::mutex mutex_;
  std::condition_variable changed_;
  int alive_ = 0;
  int left_ = 0;
  int refused_ = 0;
  std::string why_;
};

}  // namespace brdfgate::test
