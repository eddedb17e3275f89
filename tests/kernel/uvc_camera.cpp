// Sources: USB Device Class Definition for Video Devices 1.0 (chapters in comments); USB 2.0
// chapter 9; the kernel's Documentation/usb/usbip_protocol.rst.
#include "kernel/uvc_camera.hpp"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/uio.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fstream>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <utility>

namespace brdfgate::lab {
namespace {

// USB/IP.
constexpr std::uint32_t kSubmit = 1;
constexpr std::uint32_t kUnlink = 2;
constexpr std::uint32_t kSubmitted = 3;
constexpr std::uint32_t kUnlinked = 4;
constexpr std::size_t kHeader = 48;
constexpr int kHighSpeed = 3;  // enum usb_device_speed

// The camera's entities (UVC 3.7.2) and controls (A.9).
constexpr std::uint8_t kTerminal = 1;
constexpr std::uint8_t kOutput = 2;
constexpr std::uint8_t kProcessing = 3;
constexpr std::uint8_t kControlInterface = 0;
constexpr std::uint8_t kStreamInterface = 1;
constexpr std::uint8_t kAutomatism = 0x02;
constexpr std::uint8_t kExposure = 0x04;
constexpr std::uint8_t kGain = 0x04;
constexpr std::uint8_t kProbe = 0x01;
constexpr std::uint8_t kCommit = 0x02;
// Requests (A.8).
constexpr std::uint8_t kSetCurrent = 0x01;
constexpr std::uint8_t kGetCurrent = 0x81;
constexpr std::uint8_t kGetLeast = 0x82;
constexpr std::uint8_t kGetMost = 0x83;
constexpr std::uint8_t kGetStep = 0x84;
constexpr std::uint8_t kGetLength = 0x85;
constexpr std::uint8_t kGetInfo = 0x86;
constexpr std::uint8_t kGetPreset = 0x87;

constexpr std::uint8_t kManual = 1;
constexpr std::uint8_t kBulkEndpoint = 0x81;
/// Also the largest request that uvcvideo makes of a bulk endpoint (32 packets).
constexpr std::uint32_t kPayload = 32 * 512;
constexpr std::size_t kPayloadHeader = 2;
constexpr std::uint32_t kFrameInterval = 500'000;  // in 100 ns
/// A host that has begun a frame asks for its next part at once.
constexpr std::chrono::milliseconds kPatience{500};

struct Range {
  std::uint32_t bytes, least, most, step, preset;
};
constexpr Range kExposureRange{4, 1, 10'000, 1, 156};
constexpr Range kGainRange{2, 16, 64, 1, 16};
// The step of the automatism is the set of its modes.
constexpr Range kAutomatismRange{1, 1, 8, 1 | 8, 8};

/// Little-endian fields in a row, as USB has them.
class Packed {
 public:
  Packed& u8(std::initializer_list<unsigned> values) {
    for (const unsigned value : values)
      bytes_.push_back(static_cast<std::uint8_t>(value));
    return *this;
  }
  Packed& number(std::uint32_t value, std::size_t bytes) {
    for (std::size_t i = 0; i < bytes; ++i)
      bytes_.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
    return *this;
  }
  Packed& u16(std::size_t value) { return number(static_cast<std::uint32_t>(value), 2); }
  Packed& u32(std::size_t value) { return number(static_cast<std::uint32_t>(value), 4); }
  /// Most significant byte first, as USB/IP has them.
  Packed& network(std::initializer_list<std::uint32_t> words) {
    for (const std::uint32_t word : words) {
      for (const int shift : {24, 16, 8, 0})
        bytes_.push_back(static_cast<std::uint8_t>(word >> shift));
    }
    return *this;
  }
  Packed& text(const char* characters) {
    bytes_.insert(bytes_.end(), characters, characters + std::strlen(characters));
    return *this;
  }
  Packed& append(const Packed& other) {
    bytes_.insert(bytes_.end(), other.bytes_.begin(), other.bytes_.end());
    return *this;
  }
  std::size_t size() const { return bytes_.size(); }
  const std::vector<std::uint8_t>& bytes() const { return bytes_; }

 private:
  std::vector<std::uint8_t> bytes_;
};

std::uint32_t big_endian(std::span<const std::uint8_t> header, std::size_t at) {
  std::uint32_t value = 0;
  std::memcpy(&value, header.data() + at, sizeof value);
  return ntohl(value);
}

std::uint16_t little_endian16(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint16_t>(bytes[at] | bytes[at + 1] << 8);
}

bool read_all(int fd, std::span<std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t got = ::recv(fd, bytes.data(), bytes.size(), MSG_WAITALL);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(got));
  }
  return true;
}

bool write_all(int fd, std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(sent));
  }
  return true;
}

/// The kernel's end of a socket pair becomes a cable to its first free port; ours is returned.
UniqueFd plug_in() {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    throw std::runtime_error("no socket pair");
  }
  UniqueFd ours(ends[0]);
  const UniqueFd kernels(ends[1]);
  constexpr int kDeviceId = 1 << 16 | 2;  // bus and device number on the side that exports: ours
  std::ofstream attach("/sys/devices/platform/vhci_hcd.0/attach");
  attach << 0 << ' ' << kernels.get() << ' ' << kDeviceId << ' ' << kHighSpeed << std::flush;
  if (!attach) throw std::runtime_error("cannot plug in: is vhci-hcd loaded, its port 0 free?");
  return ours;
}

/// Descriptors of the control interface after its header (UVC 3.7.2).
Packed entities() {
  Packed d;
  d.u8({18, 0x24, 0x02, kTerminal}).u16(0x0201).u8({0, 0}).u16(0).u16(0).u16(0);
  d.u8({3, 0x0a, 0, 0});  // automatism (D1) and exposure time (D3)
  d.u8({11, 0x24, 0x05, kProcessing, kTerminal}).u16(0).u8({2, 0, 0x02, 0});  // gain (D9)
  d.u8({9, 0x24, 0x03, kOutput}).u16(0x0101).u8({0, kProcessing, 0});
  return d;
}

/// The one format and size (UVC payload specification, uncompressed, 3.1).
Packed formats(std::size_t width, std::size_t height) {
  const std::size_t bytes = 2 * width * height;
  const std::size_t bits_per_s = bytes * 8 * (10'000'000 / kFrameInterval);
  Packed d;
  d.u8({27, 0x24, 0x04, 1, 1}).text("Y16 ");
  d.u8({0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71, 16, 1, 0, 0, 0, 0});
  d.u8({30, 0x24, 0x05, 1, 0}).u16(width).u16(height).u32(bits_per_s).u32(bits_per_s);
  d.u32(bytes).u32(kFrameInterval).u8({1}).u32(kFrameInterval);
  return d;
}

std::vector<std::uint8_t> text_descriptor(const std::string& text) {
  Packed d;
  d.u8({static_cast<unsigned>(2 + 2 * text.size()), 3});
  for (const char c : text)
    d.u8({static_cast<unsigned char>(c), 0});
  return d.bytes();
}

const Range* range_of(std::uint8_t entity, std::uint8_t selector) {
  if (entity == kTerminal && selector == kAutomatism) return &kAutomatismRange;
  if (entity == kTerminal && selector == kExposure) return &kExposureRange;
  if (entity == kProcessing && selector == kGain) return &kGainRange;
  return nullptr;
}

}  // namespace

UvcCamera::UvcCamera(int width, int height) : width_(width), height_(height), socket_(plug_in()) {
  server_ = std::jthread([this] { serve(); });
}

UvcCamera::~UvcCamera() {
  ::shutdown(socket_.get(), SHUT_RDWR);
}

UvcSettings UvcCamera::settings() const {
  const std::scoped_lock lock(mutex_);
  return settings_;
}

bool UvcCamera::send(const cv::Mat& frame) {
  const std::span<const std::uint8_t> bytes(frame.data, frame.total() * frame.elemSize());
  frame_id_ ^= 1;
  std::vector<std::uint8_t> payload;
  for (std::size_t at = 0; at < bytes.size();) {
    std::unique_lock lock(mutex_);
    const auto ready = [this] { return !waiting_.empty() || !streaming_; };
    if (!asked_.wait_for(lock, kPatience, ready) || !streaming_) return false;
    const Waiting request = waiting_.front();
    waiting_.pop_front();
    const std::size_t part = std::min({bytes.size() - at, request.bytes - kPayloadHeader,
                                       static_cast<std::size_t>(kPayload) - kPayloadHeader});
    const bool last = at + part == bytes.size();
    // UVC 2.4.3.2: end of header, end of frame, frame identifier.
    payload.assign({kPayloadHeader, static_cast<std::uint8_t>(0x80 | (last ? 2 : 0) | frame_id_)});
    payload.insert(payload.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at),
                   bytes.begin() + static_cast<std::ptrdiff_t>(at + part));
    answer(request.seqnum, 0, static_cast<std::int32_t>(payload.size()), payload);
    at += part;
  }
  return true;
}

void UvcCamera::serve() {
  std::array<std::uint8_t, kHeader> header{};
  while (read_all(socket_.get(), header)) {
    const std::uint32_t command = big_endian(header, 0);
    if (command == kSubmit) submitted(header);
    if (command == kUnlink) unlinked(big_endian(header, 4), big_endian(header, 20));
  }
  streaming_ = false;
  asked_.notify_all();
}

void UvcCamera::submitted(std::span<const std::uint8_t> header) {
  const std::uint32_t seqnum = big_endian(header, 4);
  const bool to_host = big_endian(header, 12) != 0;
  const std::uint32_t endpoint = big_endian(header, 16);
  const std::uint32_t length = big_endian(header, 24);
  Bytes data(to_host ? 0 : length);
  if (!read_all(socket_.get(), data)) return;
  const std::scoped_lock lock(mutex_);
  last_submitted_ = seqnum;
  if (const auto taken_back = early_unlinks_.extract(seqnum)) {
    answer_unlink(taken_back.mapped(), -ECONNRESET);
  } else if (endpoint == 0) {
    const auto setup = header.subspan(40);
    control(seqnum,
            {setup[0], setup[1], little_endian16(setup, 2), little_endian16(setup, 4),
             little_endian16(setup, 6)},
            data);
  } else {
    waiting_.push_back({seqnum, length});
    asked_.notify_all();
  }
}

void UvcCamera::unlinked(std::uint32_t seqnum, std::uint32_t victim) {
  const std::scoped_lock lock(mutex_);
  // vhci-hcd sends requests and their withdrawals from two lists, and may overtake itself.
  if (victim > last_submitted_) {
    early_unlinks_[victim] = seqnum;
    return;
  }
  const auto found = std::ranges::find(waiting_, victim, &Waiting::seqnum);
  const bool waited = found != waiting_.end();
  if (waited) waiting_.erase(found);
  answer_unlink(seqnum, waited ? -ECONNRESET : 0);
}

void UvcCamera::answer_unlink(std::uint32_t seqnum, std::int32_t status) {
  Bytes bytes =
      Packed().network({kUnlinked, seqnum, 0, 0, 0, static_cast<std::uint32_t>(status)}).bytes();
  bytes.resize(kHeader);
  write_all(socket_.get(), bytes);
}

void UvcCamera::answer(std::uint32_t seqnum, std::int32_t status, std::int32_t length,
                       std::span<const std::uint8_t> data) {
  Bytes bytes = Packed()
                    .network({kSubmitted, seqnum, 0, 0, 0, static_cast<std::uint32_t>(status),
                              static_cast<std::uint32_t>(length)})
                    .bytes();
  bytes.resize(kHeader);
  bytes.insert(bytes.end(), data.begin(), data.end());
  write_all(socket_.get(), bytes);
}

void UvcCamera::control(std::uint32_t seqnum, const Setup& setup, const Bytes& data) {
  Bytes found;
  const bool standard = (setup.type & 0x60) == 0;
  const bool good = standard ? standard_request(setup, found) : class_request(setup, data, found);
  if (!good) {
    answer(seqnum, -EPIPE, 0, {});  // a stall
    return;
  }
  if (found.size() > setup.length) found.resize(setup.length);
  const bool to_host = (setup.type & 0x80) != 0;
  answer(seqnum, 0, static_cast<std::int32_t>(to_host ? found.size() : data.size()), found);
}

bool UvcCamera::standard_request(const Setup& setup, Bytes& reply) {
  constexpr std::uint8_t kGetStatus = 0;
  constexpr std::uint8_t kClearFeature = 1;
  constexpr std::uint8_t kGetDescriptor = 6;
  constexpr std::uint8_t kGetConfiguration = 8;
  constexpr std::uint8_t kGetInterface = 10;
  switch (setup.request) {
    case kGetStatus:
      reply = {0, 0};
      return true;
    case kGetConfiguration:
      reply = {1};
      return true;
    case kGetInterface:
      reply = {0};
      return true;
    case kGetDescriptor:
      reply = descriptor(setup.value);
      return !reply.empty();
    case kClearFeature:
      // How uvcvideo ends a stream of a bulk endpoint.
      if (setup.index == kBulkEndpoint) streaming_ = false;
      asked_.notify_all();
      return true;
    default:
      return (setup.type & 0x80) == 0;  // address, configuration, interface: nothing to do
  }
}

UvcCamera::Bytes UvcCamera::descriptor(std::uint16_t which) const {
  switch (which >> 8) {
    case 1:
      return Packed()
          .u8({18, 1})
          .u16(0x0200)
          .u8({0xef, 2, 1, 64})
          .u16(0x1209)  // pid.codes, for tests
          .u16(0x0001)
          .u16(0x0100)
          .u8({1, 2, 3, 1})
          .bytes();
    case 2:
      return configuration();
    case 3: {
      static const std::array<std::string, 4> kTexts{"", "brdfgate", "lab camera", "1"};
      const std::size_t index = which & 0xff;
      if (index == 0) return {4, 3, 0x09, 0x04};  // English
      return index < kTexts.size() ? text_descriptor(kTexts[index]) : Bytes{};
    }
    default:
      return {};
  }
}

UvcCamera::Bytes UvcCamera::configuration() const {
  const Packed inner = entities();
  Packed d;
  d.u8({8, 0x0b, kControlInterface, 2, 0x0e, 3, 0, 0});
  d.u8({9, 4, kControlInterface, 0, 0, 0x0e, 1, 0, 0});
  d.u8({13, 0x24, 0x01}).u16(0x0100).u16(13 + inner.size()).u32(1'000'000);
  d.u8({1, kStreamInterface}).append(inner);
  const Packed formats_of =
      formats(static_cast<std::size_t>(width_), static_cast<std::size_t>(height_));
  d.u8({9, 4, kStreamInterface, 0, 1, 0x0e, 2, 0, 0});
  d.u8({14, 0x24, 0x01, 1}).u16(14 + formats_of.size());
  d.u8({kBulkEndpoint, 0, kOutput, 0, 0, 0, 1, 0}).append(formats_of);
  d.u8({7, 5, kBulkEndpoint, 2}).u16(512).u8({0});
  return Packed().u8({9, 2}).u16(9 + d.size()).u8({2, 1, 0, 0x80, 50}).append(d).bytes();
}

bool UvcCamera::class_request(const Setup& setup, const Bytes& data, Bytes& reply) {
  if (setup.request == kSetCurrent) {
    if ((setup.index & 0xff) == kControlInterface) return set_control(setup, data);
    // The one format is what is negotiated, whatever the host would like.
    if (setup.value >> 8 == kCommit) streaming_ = true;
    return true;
  }
  if ((setup.index & 0xff) == kControlInterface) return get_control(setup, reply);
  if (setup.value >> 8 != kProbe && setup.value >> 8 != kCommit) return false;
  reply = stream_parameters();
  if (setup.request == kGetLength) reply = Packed().u16(reply.size()).bytes();
  if (setup.request == kGetInfo) reply = {3};
  return true;
}

/// UVC 4.3.1.1.
UvcCamera::Bytes UvcCamera::stream_parameters() const {
  return Packed()
      .u16(0)
      .u8({1, 1})
      .u32(kFrameInterval)
      .u16(0)
      .u16(0)
      .u16(0)
      .u16(0)
      .u16(0)
      .u32(2 * static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_))
      .u32(kPayload)
      .bytes();
}

bool UvcCamera::set_control(const Setup& setup, const Bytes& data) {
  const auto entity = static_cast<std::uint8_t>(setup.index >> 8);
  const auto selector = static_cast<std::uint8_t>(setup.value >> 8);
  const Range* range = range_of(entity, selector);
  if (range == nullptr || data.size() != range->bytes) return false;
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < data.size(); ++i)
    value |= static_cast<std::uint32_t>(data[i]) << (8 * i);
  if (value < range->least || value > range->most) return false;
  if (range == &kAutomatismRange) {
    automatism_ = static_cast<std::uint8_t>(value);
  } else if (range == &kExposureRange) {
    if (automatism_ != kManual) return false;
    settings_.exposure_100us = value;
  } else {
    settings_.gain = static_cast<std::uint16_t>(value);
  }
  return true;
}

bool UvcCamera::get_control(const Setup& setup, Bytes& reply) const {
  const auto entity = static_cast<std::uint8_t>(setup.index >> 8);
  const auto selector = static_cast<std::uint8_t>(setup.value >> 8);
  const Range* range = range_of(entity, selector);
  if (range == nullptr) return false;
  const std::uint32_t current = range == &kAutomatismRange ? automatism_
                                : range == &kExposureRange ? settings_.exposure_100us
                                                           : settings_.gain;
  const std::array<std::pair<std::uint8_t, std::uint32_t>, 5> values{{{kGetCurrent, current},
                                                                      {kGetLeast, range->least},
                                                                      {kGetMost, range->most},
                                                                      {kGetStep, range->step},
                                                                      {kGetPreset, range->preset}}};
  for (const auto& [request, value] : values) {
    if (request == setup.request) reply = Packed().number(value, range->bytes).bytes();
  }
  if (setup.request == kGetLength) reply = Packed().u16(range->bytes).bytes();
  if (setup.request == kGetInfo) reply = {3};  // can be read and set
  return !reply.empty();
}

}  // namespace brdfgate::lab
