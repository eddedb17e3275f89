#include "hal/modbus/tcp_server.hpp"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <memory>
#include <optional>

#include "hal/camera.hpp"
#include "hal/modbus/mbap.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

using std::chrono::milliseconds;
using TimePoint = std::chrono::steady_clock::time_point;

constexpr milliseconds kLongestWait{100};  ///< the observer hears from a healthy loop this often
constexpr std::size_t kReadBytes = 4096;   ///< per connection and turn
/// Answers of a connection that wait for its socket; beyond it no more of its requests are taken.
constexpr std::size_t kPendingBytes = 16384;

// A peer whose cable was pulled is gone after 5 + 3 x 2 s.
constexpr int kKeepaliveIdle_s = 5;
constexpr int kKeepaliveInterval_s = 2;
constexpr int kKeepaliveProbes = 3;
constexpr unsigned kUserTimeout_ms = 11000;

/// Client numbers are never reused in a process, whatever the number of servers.
std::atomic<ModbusClient> next_client{1};

struct AddressInfoFree {
  void operator()(addrinfo* info) const { ::freeaddrinfo(info); }
};
using AddressInfo = std::unique_ptr<addrinfo, AddressInfoFree>;

AddressInfo resolve(const std::string& address, int port) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE | AI_NUMERICHOST | AI_NUMERICSERV;
  addrinfo* found = nullptr;
  if (::getaddrinfo(address.c_str(), std::to_string(port).c_str(), &hints, &found) != 0) {
    throw InputError("modbus tcp address", "'" + address + "'", "a numeric IPv4 or IPv6 address");
  }
  return AddressInfo(found);
}

/// One spelling per address; IPv4 mapped into IPv6 is IPv4.
std::string text_of(const sockaddr* address) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  if (address->sa_family == AF_INET) {
    sockaddr_in v4{};
    std::memcpy(&v4, address, sizeof v4);
    ::inet_ntop(AF_INET, &v4.sin_addr, text.data(), text.size());
  } else if (address->sa_family == AF_INET6) {
    sockaddr_in6 v6{};
    std::memcpy(&v6, address, sizeof v6);
    if (IN6_IS_ADDR_V4MAPPED(&v6.sin6_addr)) {
      ::inet_ntop(AF_INET, &v6.sin6_addr.s6_addr[12], text.data(), text.size());
    } else {
      ::inet_ntop(AF_INET6, &v6.sin6_addr, text.data(), text.size());
    }
  }
  return text.data();
}

std::string normalised(const std::string& address) {
  return text_of(resolve(address, 0)->ai_addr);
}

void set_option(int fd, int level, int option, int value) {
  ::setsockopt(fd, level, option, &value,
               sizeof value);  // a refusal costs promptness, not function
}

void set_up_connection(int fd) {
  set_option(fd, IPPROTO_TCP, TCP_NODELAY, 1);
  set_option(fd, SOL_SOCKET, SO_KEEPALIVE, 1);
  set_option(fd, IPPROTO_TCP, TCP_KEEPIDLE, kKeepaliveIdle_s);
  set_option(fd, IPPROTO_TCP, TCP_KEEPINTVL, kKeepaliveInterval_s);
  set_option(fd, IPPROTO_TCP, TCP_KEEPCNT, kKeepaliveProbes);
  set_option(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, static_cast<int>(kUserTimeout_ms));
}

bool would_block() {
  return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
}

}  // namespace

struct TcpServer::Connection {
  UniqueFd fd;
  std::vector<std::uint8_t> in;         ///< received, not answered yet
  std::vector<std::uint8_t> out;        ///< answers that the socket did not take yet
  TimePoint last_request;               ///< or the connection's start
  std::optional<TimePoint> first_byte;  ///< of the request that is being received
  std::optional<TimePoint> stalled;     ///< since when the peer takes nothing of `out`

  bool congested() const { return out.size() >= kPendingBytes; }

  TimePoint deadline(const TcpServerSettings& settings) const {
    TimePoint due = last_request + settings.idle_timeout;
    if (first_byte) due = std::min(due, *first_byte + settings.request_deadline);
    if (stalled) due = std::min(due, *stalled + settings.request_deadline);
    return due;
  }
};

TcpServer::TcpServer(TcpServerSettings settings, RegisterSpace& space, ServerObserver& observer)
    : settings_(std::move(settings)),
      space_(space),
      observer_(observer),
      stop_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (!stop_) throw DeviceError("modbus tcp", "eventfd", std::strerror(errno));
  for (std::string& address : settings_.allow)
    address = normalised(address);
  listen();
  thread_ = std::jthread([this] { serve(); });
}

TcpServer::~TcpServer() {
  const std::uint64_t one = 1;
  // The counter of a fresh eventfd cannot be full, so the write cannot fail.
  [[maybe_unused]] const ssize_t written = ::write(stop_.get(), &one, sizeof one);
  if (thread_.joinable()) thread_.join();
}

void TcpServer::listen() {
  const AddressInfo address = resolve(settings_.bind, settings_.port);
  const std::string name =
      "modbus tcp " + settings_.bind + " port " + std::to_string(settings_.port);
  const auto require = [&](bool good, const char* call) {
    if (!good) throw DeviceError(name, call, std::strerror(errno));
  };
  listener_ = UniqueFd(
      ::socket(address->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, IPPROTO_TCP));
  require(static_cast<bool>(listener_), "socket");
  set_option(listener_.get(), SOL_SOCKET, SO_REUSEADDR, 1);
  require(::bind(listener_.get(), address->ai_addr, address->ai_addrlen) == 0, "bind");
  require(::listen(listener_.get(), SOMAXCONN) == 0, "listen");
  sockaddr_storage bound{};
  socklen_t size = sizeof bound;
  require(::getsockname(listener_.get(), reinterpret_cast<sockaddr*>(&bound), &size) == 0,
          "getsockname");
  std::uint16_t port = 0;  // at the same place in both families
  static_assert(offsetof(sockaddr_in, sin_port) == offsetof(sockaddr_in6, sin6_port));
  std::memcpy(&port, reinterpret_cast<const char*>(&bound) + offsetof(sockaddr_in, sin_port),
              sizeof port);
  port_ = ntohs(port);
}

void TcpServer::serve() {
  TimePoint listen_again{};
  for (;;) {
    std::uint64_t stop = 0;
    if (::read(stop_.get(), &stop, sizeof stop) == sizeof stop) break;
    turn(listen_again);
    observer_.server_alive();
  }
  for (const auto& [client, connection] : connections_)
    observer_.client_left(client);
  connections_.clear();
}

int TcpServer::wait_ms(Clock::time_point now) const {
  TimePoint due = now + kLongestWait;
  for (const auto& [client, connection] : connections_) {
    due = std::min(due, connection.deadline(settings_));
  }
  const auto wait = std::chrono::ceil<milliseconds>(due - now).count();
  return static_cast<int>(std::max<std::int64_t>(0, wait));
}

void TcpServer::turn(Clock::time_point& listen_again) {
  const TimePoint before = Clock::now();
  std::vector<pollfd> polled;
  polled.push_back({stop_.get(), POLLIN, 0});
  // After a failed accept (no descriptors left) the listener would be ready again at once.
  polled.push_back({before < listen_again ? -1 : listener_.get(), POLLIN, 0});
  std::vector<ModbusClient> clients;
  for (const auto& [client, connection] : connections_) {
    const int wanted =
        (connection.congested() ? 0 : POLLIN) | (connection.out.empty() ? 0 : POLLOUT);
    polled.push_back({connection.fd.get(), static_cast<short>(wanted), 0});
    clients.push_back(client);
  }
  ::poll(polled.data(), polled.size(), wait_ms(before));
  if ((polled[1].revents & POLLIN) != 0 && !accept_one()) {
    listen_again = Clock::now() + kLongestWait;
  }
  for (std::size_t i = 0; i < clients.size(); ++i) {
    const auto found = connections_.find(clients[i]);
    if (serve_connection(clients[i], found->second, polled[i + 2].revents)) continue;
    connections_.erase(found);
    observer_.client_left(clients[i]);
  }
}

bool TcpServer::may_connect(const std::string& address, std::string& why) const {
  const auto& allow = settings_.allow;
  if (!allow.empty() && std::find(allow.begin(), allow.end(), address) == allow.end()) {
    why = "not on the allow-list";
  } else if (connections_.size() >= static_cast<std::size_t>(settings_.max_clients)) {
    why = "too many clients (" + std::to_string(settings_.max_clients) + ")";
  }
  return why.empty();
}

bool TcpServer::accept_one() {
  sockaddr_storage peer{};
  socklen_t size = sizeof peer;
  auto* const address = reinterpret_cast<sockaddr*>(&peer);
  UniqueFd fd(::accept4(listener_.get(), address, &size, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (!fd) return would_block() || errno == ECONNABORTED;
  const std::string name = text_of(address);
  std::string why;
  if (!may_connect(name, why)) {
    observer_.client_refused(name, why);
    return true;
  }
  set_up_connection(fd.get());
  Connection connection;
  connection.fd = std::move(fd);
  connection.last_request = Clock::now();
  connections_.emplace(next_client++, std::move(connection));
  return true;
}

bool TcpServer::serve_connection(ModbusClient client, Connection& connection, short events) {
  if ((events & (POLLERR | POLLNVAL)) != 0) return false;
  if ((events & (POLLIN | POLLHUP)) != 0 && !connection.congested() && !receive(connection)) {
    return false;
  }
  // Requests left over from a congested turn are taken up once the answers have drained.
  for (std::size_t before = 0;;) {
    if (!send_pending(connection)) return false;
    before = connection.in.size();
    if (!answer_requests(client, connection)) return false;
    if (connection.in.size() == before) break;
  }
  return Clock::now() < connection.deadline(settings_);
}

bool TcpServer::receive(Connection& connection) const {
  std::array<std::uint8_t, kReadBytes> buffer{};
  const ssize_t got = ::recv(connection.fd.get(), buffer.data(), buffer.size(), 0);
  if (got < 0) return would_block();
  if (got == 0) return false;
  if (!connection.first_byte) connection.first_byte = Clock::now();
  connection.in.insert(connection.in.end(), buffer.begin(), buffer.begin() + got);
  return true;
}

bool TcpServer::answer_requests(ModbusClient client, Connection& connection) {
  std::size_t done = 0;
  while (!connection.congested()) {
    const MbapFrame frame = parse_mbap(std::span(connection.in).subspan(done));
    if (frame.state == MbapFrame::State::broken) return false;
    if (frame.state == MbapFrame::State::incomplete) break;
    const bool ours = frame.unit == settings_.unit_id || frame.unit == 0 || frame.unit == 255;
    const std::vector<std::uint8_t> answer =
        ours ? answer_pdu(frame.pdu, client, space_, settings_.device)
             : exception_pdu(frame.pdu[0], ModbusException::gateway_path_unavailable);
    append_mbap(connection.out, frame.transaction, frame.unit, answer);
    done += frame.bytes;
    connection.last_request = Clock::now();
    connection.first_byte.reset();
  }
  connection.in.erase(connection.in.begin(),
                      connection.in.begin() + static_cast<std::ptrdiff_t>(done));
  if (connection.in.empty() || connection.congested()) {
    connection.first_byte.reset();  // what waits for a congested socket is watched by `stalled`
  } else if (!connection.first_byte) {
    connection.first_byte = Clock::now();
  }
  return true;
}

bool TcpServer::send_pending(Connection& connection) {
  if (connection.out.empty()) return true;
  const ssize_t sent =
      ::send(connection.fd.get(), connection.out.data(), connection.out.size(), MSG_NOSIGNAL);
  if (sent < 0 && !would_block()) return false;
  if (sent > 0) {
    connection.out.erase(connection.out.begin(), connection.out.begin() + sent);
    connection.stalled.reset();
  }
  if (!connection.out.empty() && !connection.stalled) connection.stalled = Clock::now();
  return true;
}

}  // namespace brdfgate
