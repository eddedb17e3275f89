#include "hal/v4l2/v4l2_device.hpp"

#include <poll.h>

#include <cerrno>
#include <cmath>
#include <cstring>
#include <utility>

namespace brdfgate {
namespace {

constexpr std::uint32_t kType = V4L2_BUF_TYPE_VIDEO_CAPTURE;
/// One frame is in our hands while the driver fills the next.
constexpr std::uint32_t kLeastBuffers = 2;
constexpr double kMicro = 1e6;
/// Its low half is a driver's 0; high enough that a driver that counts backwards stays above 0.
constexpr std::uint64_t kSequenceOrigin = 1ULL << 32;

/// The device is not there (any more), whatever was asked of it.
bool is_gone(int error) {
  return error == ENODEV || error == ENXIO || error == ENOENT || error == EBADF ||
         error == ESHUTDOWN;
}

v4l2_buffer make_buffer(std::uint32_t index) {
  v4l2_buffer buffer{};
  buffer.type = kType;
  buffer.memory = V4L2_MEMORY_MMAP;
  buffer.index = index;
  return buffer;
}

std::string reason(int error) {
  switch (error) {
    case ENOENT:
      return "no such device; is the camera plugged in, and the path right?";
    case EACCES:
      return "permission denied; is this user in group video?";
    case EBUSY:
      return "another program uses the camera";
    default:
      return std::strerror(error);
  }
}

}  // namespace

V4l2Node::V4l2Node(V4l2System& system, std::string path)
    : system_(system), path_(std::move(path)), fd_(system.open(path_.c_str())) {
  if (fd_ < 0) fail(-fd_, "open", CameraFault::absent);
}

int V4l2Node::try_ioctl(unsigned long request, void* argument) const {
  return system_.ioctl(fd_, request, argument);
}

void V4l2Node::ioctl(unsigned long request, const char* name, void* argument) const {
  const int result = try_ioctl(request, argument);
  if (result < 0) fail(-result, name, CameraFault::no_frame);
}

void V4l2Node::fail(int error, const char* call, CameraFault fault) const {
  if (is_gone(error)) fault = CameraFault::absent;
  if (error == ENOMEM) fault = CameraFault::out_of_memory;
  fail(reason(error), call, fault);
}

void V4l2Node::fail(const std::string& what, const char* call, CameraFault fault) const {
  throw CameraError(fault, path_, call, what);
}

V4l2Device::V4l2Device(V4l2System& system, const CameraDeviceSettings& settings,
                       const SensorFormat& sensor)
    : node_(system, settings.device), wanted_buffers_(settings.buffers) {
  check_capabilities();
  set_format(*settings.pixel_format, sensor);
  set_frame_interval(settings.frame_interval_s);
}

V4l2Device::~V4l2Device() {
  stop();
  free_buffers();
}

void V4l2Device::check_capabilities() const {
  v4l2_capability capability{};
  const int result = node_.try_ioctl(VIDIOC_QUERYCAP, &capability);
  if (result < 0) {
    node_.fail(-result == ENOTTY || -result == EINVAL ? "not a video device" : reason(-result),
               "VIDIOC_QUERYCAP", CameraFault::absent);
  }
  const std::uint32_t can = (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0
                                ? capability.device_caps
                                : capability.capabilities;
  if ((can & V4L2_CAP_VIDEO_CAPTURE) == 0) {
    node_.fail((can & V4L2_CAP_VIDEO_CAPTURE_MPLANE) != 0
                   ? "captures into several planes only; raw formats have one"
                   : "captures no video; the node of a camera that does is needed",
               "VIDIOC_QUERYCAP", CameraFault::absent);
  }
  if ((can & V4L2_CAP_STREAMING) == 0) {
    node_.fail("has no streaming I/O", "VIDIOC_QUERYCAP", CameraFault::absent);
  }
}

void V4l2Device::set_format(const RawFormat& wanted, const SensorFormat& sensor) {
  v4l2_format format{};
  format.type = kType;
  node_.ioctl(VIDIOC_G_FMT, "VIDIOC_G_FMT", &format);
  v4l2_pix_format& pix = format.fmt.pix;
  pix.width = static_cast<std::uint32_t>(sensor.width);
  pix.height = static_cast<std::uint32_t>(sensor.height);
  pix.pixelformat = wanted.v4l2_code();
  pix.field = V4L2_FIELD_NONE;
  pix.bytesperline = 0;
  pix.sizeimage = 0;
  node_.ioctl(VIDIOC_S_FMT, "VIDIOC_S_FMT", &format);
  const auto shown = [](std::uint32_t code, std::uint32_t width, std::uint32_t height) {
    return std::to_string(width) + " x " + std::to_string(height) + " '" + fourcc_text(code) + "'";
  };
  const bool taken = pix.pixelformat == wanted.v4l2_code() &&
                     pix.width == static_cast<std::uint32_t>(sensor.width) &&
                     pix.height == static_cast<std::uint32_t>(sensor.height);
  if (!taken) {
    node_.fail("the camera gives " + shown(pix.pixelformat, pix.width, pix.height) + " for " +
                   shown(wanted.v4l2_code(), static_cast<std::uint32_t>(sensor.width),
                         static_cast<std::uint32_t>(sensor.height)) +
                   "; camera.sensor and camera.device.pixel_format must be a format that "
                   "v4l2-ctl --list-formats-ext shows",
               "VIDIOC_S_FMT", CameraFault::absent);
  }
  stride_ = std::max<std::size_t>(pix.bytesperline, wanted.row_bytes(sensor.width));
}

void V4l2Device::set_frame_interval(double interval_s) {
  v4l2_streamparm parameters{};
  parameters.type = kType;
  if (node_.try_ioctl(VIDIOC_G_PARM, &parameters) < 0) return;
  v4l2_fract& period = parameters.parm.capture.timeperframe;
  if (interval_s > 0) {
    period = {static_cast<std::uint32_t>(std::lround(interval_s * kMicro)),
              static_cast<std::uint32_t>(kMicro)};
    node_.ioctl(VIDIOC_S_PARM, "VIDIOC_S_PARM", &parameters);
  }
  if (period.denominator != 0) {
    frame_period_s_ = static_cast<double>(period.numerator) / period.denominator;
  }
}

void V4l2Device::allocate() {
  v4l2_requestbuffers request{};
  request.count = static_cast<std::uint32_t>(wanted_buffers_);
  request.type = kType;
  request.memory = V4L2_MEMORY_MMAP;
  node_.ioctl(VIDIOC_REQBUFS, "VIDIOC_REQBUFS", &request);
  if (request.count < kLeastBuffers) {
    node_.fail("the driver has memory for " + std::to_string(request.count) + " buffer(s) only",
               "VIDIOC_REQBUFS", CameraFault::out_of_memory);
  }
  for (std::uint32_t i = 0; i < request.count; ++i) {
    v4l2_buffer buffer = make_buffer(i);
    node_.ioctl(VIDIOC_QUERYBUF, "VIDIOC_QUERYBUF", &buffer);
    void* at = node_.system().map(node_.fd(), buffer.length, buffer.m.offset);
    if (at == nullptr) node_.fail(ENOMEM, "mmap", CameraFault::out_of_memory);
    buffers_.push_back({at, buffer.length});
  }
}

void V4l2Device::free_buffers() noexcept {
  for (const Mapping& mapping : buffers_)
    node_.system().unmap(mapping.at, mapping.bytes);
  buffers_.clear();
  v4l2_requestbuffers none{};
  none.type = kType;
  none.memory = V4L2_MEMORY_MMAP;
  static_cast<void>(node_.try_ioctl(VIDIOC_REQBUFS, &none));
}

void V4l2Device::queue(std::uint32_t index) {
  v4l2_buffer buffer = make_buffer(index);
  node_.ioctl(VIDIOC_QBUF, "VIDIOC_QBUF", &buffer);
}

void V4l2Device::start() {
  if (streaming_) return;
  try {
    if (buffers_.empty()) allocate();
    for (std::uint32_t i = 0; i < buffers_.size(); ++i)
      queue(i);
    int type = kType;
    node_.ioctl(VIDIOC_STREAMON, "VIDIOC_STREAMON", &type);
  } catch (...) {
    stop();
    free_buffers();
    throw;
  }
  streaming_ = true;
  last_sequence_ = kSequenceOrigin;
}

void V4l2Device::stop() noexcept {
  // Also where starting failed half-way: it takes queued buffers back.
  int type = kType;
  if (!buffers_.empty()) static_cast<void>(node_.try_ioctl(VIDIOC_STREAMOFF, &type));
  streaming_ = false;
}

std::optional<V4l2Frame> V4l2Device::dequeue() {
  v4l2_buffer buffer = make_buffer(0);
  const int result = node_.try_ioctl(VIDIOC_DQBUF, &buffer);
  if (result == -EAGAIN) return std::nullopt;
  if (result < 0) node_.fail(-result, "VIDIOC_DQBUF", CameraFault::no_frame);
  if (buffer.index >= buffers_.size()) {
    node_.fail("buffer " + std::to_string(buffer.index) + " of " + std::to_string(buffers_.size()),
               "VIDIOC_DQBUF", CameraFault::no_frame);
  }
  const Mapping& mapping = buffers_[buffer.index];
  V4l2Frame frame;
  frame.index = buffer.index;
  frame.bytes = {static_cast<const std::uint8_t*>(mapping.at),
                 std::min<std::size_t>(buffer.bytesused, mapping.bytes)};
  // The difference modulo 2^32 is right over an overflow, and negative where a driver repeats.
  const auto step =
      static_cast<std::int32_t>(buffer.sequence - static_cast<std::uint32_t>(last_sequence_));
  frame.sequence = last_sequence_ + static_cast<std::uint64_t>(static_cast<std::int64_t>(step));
  last_sequence_ = frame.sequence;
  frame.timestamp_ns =
      buffer.timestamp.tv_sec * 1'000'000'000LL + buffer.timestamp.tv_usec * 1000LL;
  frame.flags = buffer.flags;
  frame.damaged = (buffer.flags & V4L2_BUF_FLAG_ERROR) != 0;
  return frame;
}

std::optional<V4l2Frame> V4l2Device::wait(std::int64_t timeout_ns) {
  if (auto frame = dequeue()) return frame;
  const int events = node_.system().poll(node_.fd(), timeout_ns);
  if (events < 0) node_.fail(-events, "poll", CameraFault::no_frame);
  if (events == 0) return std::nullopt;
  // A stream in error answers the call below with its reason.
  if ((events & POLLIN) == 0) check_alive();
  if (auto frame = dequeue()) return frame;
  if ((events & (POLLERR | POLLHUP | POLLNVAL)) != 0) {
    node_.fail("the stream broke off", "poll", CameraFault::no_frame);
  }
  return std::nullopt;
}

void V4l2Device::requeue(const V4l2Frame& frame) {
  queue(frame.index);
}

void V4l2Device::flush() {
  // As many as there are buffers: a fast camera must not keep us here.
  for (std::size_t i = 0; i < buffers_.size(); ++i) {
    const auto frame = dequeue();
    if (!frame) return;
    requeue(*frame);
  }
}

void V4l2Device::check_alive() const {
  v4l2_capability capability{};
  const int result = node_.try_ioctl(VIDIOC_QUERYCAP, &capability);
  if (result < 0) node_.fail(-result, "VIDIOC_QUERYCAP", CameraFault::absent);
}

}  // namespace brdfgate
