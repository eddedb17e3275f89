#include "hal/libcamera/libcamera_device.hpp"

#include <libcamera/camera.h>
#include <libcamera/camera_manager.h>
#include <libcamera/control_ids.h>
#include <libcamera/framebuffer_allocator.h>
#include <libcamera/request.h>
#include <sys/mman.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <condition_variable>
#include <cstring>
#include <ctime>
#include <deque>
#include <mutex>
#include <string>
#include <vector>

#include "hal/camera.hpp"

namespace brdfgate {
namespace {

namespace lc = libcamera;

constexpr double kMicro = 1e6;

/// The one manager that a process may have. It finds cameras as they come and go.
lc::CameraManager& manager() {
  struct Started {
    Started() : error(manager.start()) {}
    ~Started() { manager.stop(); }
    lc::CameraManager manager;
    int error;
  };
  static Started started;
  if (started.error < 0) {
    throw CameraError(CameraFault::absent, "libcamera", "CameraManager::start",
                      std::strerror(-started.error));
  }
  return started.manager;
}

std::string listed(const std::vector<std::shared_ptr<lc::Camera>>& cameras) {
  std::string out;
  for (const auto& camera : cameras)
    out += (out.empty() ? "" : ", ") + camera->id();
  return out.empty() ? "none" : out;
}

std::shared_ptr<lc::Camera> find_camera(const std::string& id) {
  const auto cameras = manager().cameras();
  if (id.empty() && cameras.size() == 1) return cameras.front();
  for (const auto& camera : cameras)
    if (camera->id() == id) return camera;
  throw CameraError(CameraFault::absent, "libcamera", "find",
                    (id.empty() ? "not exactly one camera" : "no camera " + id) +
                        "; there is: " + listed(cameras));
}

/// One mapped plane of a frame buffer.
class Mapping {
 public:
  Mapping() = default;
  explicit Mapping(const lc::FrameBuffer::Plane& plane)
      : bytes_(plane.offset + plane.length),
        offset_(plane.offset),
        at_(::mmap(nullptr, bytes_, PROT_READ, MAP_SHARED, plane.fd.get(), 0)) {}
  Mapping(Mapping&& other) noexcept
      : bytes_(other.bytes_), offset_(other.offset_), at_(std::exchange(other.at_, MAP_FAILED)) {}
  Mapping(const Mapping&) = delete;
  Mapping& operator=(const Mapping&) = delete;
  Mapping& operator=(Mapping&&) = delete;
  ~Mapping() {
    if (at_ != MAP_FAILED) ::munmap(at_, bytes_);
  }
  bool sound() const { return at_ != MAP_FAILED; }
  std::span<const std::uint8_t> filled(std::size_t used) const {
    return {static_cast<const std::uint8_t*>(at_) + offset_, std::min(used, bytes_ - offset_)};
  }

 private:
  std::size_t bytes_ = 0;
  std::size_t offset_ = 0;
  void* at_ = MAP_FAILED;
};

/// What completed, from libcamera's thread to ours.
class Completions {
 public:
  void push(lc::Request* request) {
    {
      const std::lock_guard lock(mutex_);
      done_.push_back(request);
    }
    came_.notify_one();
  }
  void disconnect() {
    {
      const std::lock_guard lock(mutex_);
      gone_ = true;
    }
    came_.notify_one();
  }
  lc::Request* wait(std::int64_t timeout_ns) {
    std::unique_lock lock(mutex_);
    came_.wait_for(lock, std::chrono::nanoseconds(timeout_ns),
                   [this] { return gone_ || !done_.empty(); });
    if (done_.empty()) return nullptr;
    lc::Request* request = done_.front();
    done_.pop_front();
    return request;
  }
  void clear() {
    const std::lock_guard lock(mutex_);
    done_.clear();
  }
  bool gone() {
    const std::lock_guard lock(mutex_);
    return gone_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable came_;
  std::deque<lc::Request*> done_;
  bool gone_ = false;
};

class LibcameraDevice final : public RequestDevice {
 public:
  LibcameraDevice(const CameraDeviceSettings& settings, const SensorFormat& sensor);
  ~LibcameraDevice() override;

  std::optional<RequestRange> exposure_range_s() const override {
    return range<std::int32_t>(lc::controls::ExposureTime, 1 / kMicro);
  }
  std::optional<RequestRange> gain_range() const override {
    return range<float>(lc::controls::AnalogueGain, 1);
  }
  std::optional<RequestRange> frame_duration_range_s() const override {
    return range<std::int64_t>(lc::controls::FrameDurationLimits, 1 / kMicro);
  }
  std::size_t slots() const override { return requests_.size(); }
  std::size_t stride() const override { return stride_; }
  void start() override;
  void stop() noexcept override;
  void queue(std::size_t slot, const RequestSettings& settings) override;
  std::optional<CompletedRequest> wait(std::int64_t timeout_ns) override;
  void check_alive() override {
    if (completions_.gone()) fail("the camera", "went away", CameraFault::absent);
  }
  std::int64_t now_ns() override {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1'000'000'000LL + now.tv_nsec;
  }

 private:
  template <typename Number, typename Control>
  std::optional<RequestRange> range(const Control& control, double unit) const {
    const auto it = camera_->controls().find(&control);
    if (it == camera_->controls().end()) return std::nullopt;
    return RequestRange{static_cast<double>(it->second.min().template get<Number>()) * unit,
                        static_cast<double>(it->second.max().template get<Number>()) * unit};
  }
  template <typename Control, typename Value>
  void set(lc::ControlList& list, const Control& control, const Value& value) const {
    if (camera_->controls().count(&control) != 0) list.set(control, value);
  }
  void configure(const CameraDeviceSettings& settings, const SensorFormat& sensor);
  void make_requests();
  [[noreturn]] void fail(const std::string& call, const std::string& what,
                         CameraFault fault) const {
    throw CameraError(fault, "libcamera " + camera_->id(), call, what);
  }
  void check(int result, const char* call, CameraFault fault) const {
    if (result == -ENOMEM) fault = CameraFault::out_of_memory;
    if (result == -ENODEV) fault = CameraFault::absent;
    if (result < 0) fail(call, std::strerror(-result), fault);
  }

  std::shared_ptr<lc::Camera> camera_;
  std::unique_ptr<lc::CameraConfiguration> configuration_;
  lc::Stream* stream_ = nullptr;
  std::size_t stride_ = 0;
  std::unique_ptr<lc::FrameBufferAllocator> allocator_;
  std::vector<Mapping> mappings_;
  std::vector<std::unique_ptr<lc::Request>> requests_;
  Completions completions_;
  bool running_ = false;
};

LibcameraDevice::LibcameraDevice(const CameraDeviceSettings& settings, const SensorFormat& sensor)
    : camera_(find_camera(settings.device)) {
  check(camera_->acquire(), "Camera::acquire", CameraFault::absent);
  try {
    configure(settings, sensor);
    make_requests();
    camera_->requestCompleted.connect(this, [this](lc::Request* done) { completions_.push(done); });
    camera_->disconnected.connect(this, [this] { completions_.disconnect(); });
  } catch (...) {
    requests_.clear();
    mappings_.clear();
    allocator_.reset();
    camera_->release();
    throw;
  }
}

LibcameraDevice::~LibcameraDevice() {
  stop();
  camera_->requestCompleted.disconnect(this);
  camera_->disconnected.disconnect(this);
  requests_.clear();
  mappings_.clear();
  allocator_.reset();
  camera_->release();
}

void LibcameraDevice::configure(const CameraDeviceSettings& settings, const SensorFormat& sensor) {
  configuration_ = camera_->generateConfiguration({lc::StreamRole::Raw});
  if (!configuration_ || configuration_->empty()) {
    fail("generateConfiguration", "the camera has no raw stream", CameraFault::absent);
  }
  lc::StreamConfiguration& stream = configuration_->at(0);
  const auto wanted = lc::PixelFormat::fromString(std::string(settings.pixel_format->libcamera));
  const lc::Size size(static_cast<unsigned>(sensor.width), static_cast<unsigned>(sensor.height));
  stream.pixelFormat = wanted;
  stream.size = size;
  stream.bufferCount = static_cast<unsigned>(settings.buffers);
  const lc::CameraConfiguration::Status status = configuration_->validate();
  if (status == lc::CameraConfiguration::Invalid || !(stream.pixelFormat == wanted) ||
      !(stream.size == size)) {
    fail("validate",
         "the camera gives " + stream.size.toString() + " " + stream.pixelFormat.toString() +
             " for " + size.toString() + " " + std::string(settings.pixel_format->libcamera) +
             "; camera.sensor and camera.device.pixel_format must be a format that cam --list "
             "shows",
         CameraFault::absent);
  }
  check(camera_->configure(configuration_.get()), "Camera::configure", CameraFault::absent);
  stream_ = stream.stream();
  stride_ = stream.stride;
}

void LibcameraDevice::make_requests() {
  allocator_ = std::make_unique<lc::FrameBufferAllocator>(camera_);
  check(allocator_->allocate(stream_), "FrameBufferAllocator::allocate",
        CameraFault::out_of_memory);
  for (const auto& buffer : allocator_->buffers(stream_)) {
    mappings_.emplace_back(buffer->planes().front());
    if (!mappings_.back().sound()) fail("mmap", std::strerror(errno), CameraFault::out_of_memory);
    auto request = camera_->createRequest(requests_.size());
    if (!request) fail("createRequest", "no memory", CameraFault::out_of_memory);
    check(request->addBuffer(stream_, buffer.get()), "Request::addBuffer", CameraFault::absent);
    requests_.push_back(std::move(request));
  }
}

void LibcameraDevice::start() {
  lc::ControlList controls(lc::controls::controls);
  set(controls, lc::controls::AeEnable, false);
  set(controls, lc::controls::AwbEnable, false);
  completions_.clear();
  check(camera_->start(&controls), "Camera::start", CameraFault::no_frame);
  running_ = true;
}

void LibcameraDevice::stop() noexcept {
  if (!running_) return;
  camera_->stop();  // what was queued completes as cancelled, before it returns
  running_ = false;
  completions_.clear();
  for (const auto& request : requests_)
    request->reuse(lc::Request::ReuseBuffers);
}

void LibcameraDevice::queue(std::size_t slot, const RequestSettings& settings) {
  lc::Request& request = *requests_.at(slot);
  if (request.status() != lc::Request::RequestPending) request.reuse(lc::Request::ReuseBuffers);
  lc::ControlList& controls = request.controls();
  const auto us = [](double seconds) { return std::llround(seconds * kMicro); };
  set(controls, lc::controls::ExposureTime, static_cast<std::int32_t>(us(settings.exposure_s)));
  set(controls, lc::controls::AnalogueGain, static_cast<float>(settings.gain));
  const std::array<std::int64_t, 2> duration{us(settings.frame_duration_s),
                                             us(settings.frame_duration_s)};
  set(controls, lc::controls::FrameDurationLimits, lc::Span<const std::int64_t, 2>(duration));
  check(camera_->queueRequest(&request), "Camera::queueRequest", CameraFault::no_frame);
}

std::optional<CompletedRequest> LibcameraDevice::wait(std::int64_t timeout_ns) {
  const lc::Request* request = completions_.wait(timeout_ns);
  if (request == nullptr) {
    check_alive();
    return std::nullopt;
  }
  const lc::FrameBuffer& buffer = *request->findBuffer(stream_);
  const lc::FrameMetadata& frame = buffer.metadata();
  CompletedRequest done;
  done.slot = request->cookie();
  done.cancelled = request->status() == lc::Request::RequestCancelled;
  done.damaged = frame.status != lc::FrameMetadata::FrameSuccess;
  done.sequence = frame.sequence;
  const lc::ControlList& metadata = const_cast<lc::Request*>(request)->metadata();
  done.timestamp_ns = metadata.get(lc::controls::SensorTimestamp)
                          .value_or(static_cast<std::int64_t>(frame.timestamp));
  if (const auto us = metadata.get(lc::controls::ExposureTime)) done.exposure_s = *us / kMicro;
  if (const auto gain = metadata.get(lc::controls::AnalogueGain)) done.gain = *gain;
  if (!frame.planes().empty()) {
    done.bytes = mappings_.at(done.slot).filled(frame.planes()[0].bytesused);
  }
  return done;
}

}  // namespace

std::unique_ptr<RequestDevice> open_libcamera(const CameraDeviceSettings& settings,
                                              const SensorFormat& sensor) {
  return std::make_unique<LibcameraDevice>(settings, sensor);
}

}  // namespace brdfgate
