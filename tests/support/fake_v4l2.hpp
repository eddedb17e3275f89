// A made-up V4L2 driver with a sensor behind it, on its own clock: nothing waits. The sensor runs
// freely while it streams, applies a control some frames after it was set, and counts the frames
// that nobody took. Faults are told to it by frame number.
#pragma once

#include <linux/videodev2.h>
#include <poll.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "hal/camera_settings.hpp"
#include "hal/v4l2/v4l2_system.hpp"

namespace brdfgate::test {

struct FakeFault {
  enum Kind { none, dropped, truncated, damaged, repeated, late, black } kind = none;
  double late_s = 0;
};

struct FakeSensor {
  const RawFormat* format = find_raw_format("Y10");
  int width = 16;
  int height = 12;
  std::size_t padding = 0;  ///< bytes behind every row
  double interval_s = 0.01;
  double readout_s = 0.004;
  int latency_frames = 2;  ///< frames begun after a control was set that still have the old one
  std::uint32_t stamp_flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC | V4L2_BUF_FLAG_TSTAMP_SRC_EOF;
  std::int64_t stamp_offset_ns = 0;  ///< another clock
  double counts_per_s = 1e4;         ///< at gain 1 and full light
  int black = 60;
  int noise = 3;  ///< counts, uniform, differs from frame to frame
};

struct FakeControl {
  std::int64_t least = 0;
  std::int64_t most = 0;
  std::int64_t step = 1;
  std::int64_t value = 0;
};

/// Packs one row of counts the way a driver delivers it; the inverse of unpack(), written anew.
inline std::vector<std::uint8_t> packed_row(const RawFormat& format,
                                            const std::vector<int>& counts) {
  std::vector<std::uint8_t> out(format.row_bytes(static_cast<int>(counts.size())));
  const int low = format.bits - 8;
  const std::size_t group = format.packing == RawPacking::csi2p10 ? 4 : 2;
  for (std::size_t x = 0; x < counts.size(); ++x) {
    const auto count = static_cast<unsigned>(counts[x]);
    switch (format.packing) {
      case RawPacking::bytes:
        out[x] = static_cast<std::uint8_t>(count);
        break;
      case RawPacking::words:
        out[2 * x] = static_cast<std::uint8_t>(count & 0xff);
        out[2 * x + 1] = static_cast<std::uint8_t>(count >> 8);
        break;
      case RawPacking::green_of_rgb:
        out[3 * x + 1] = static_cast<std::uint8_t>(count);
        break;
      default: {
        const std::size_t first = x / group * (group + 1);
        const auto i = static_cast<unsigned>(x % group);
        out[first + i] = static_cast<std::uint8_t>(count >> low);
        out[first + group] |= static_cast<std::uint8_t>((count & ((1U << low) - 1)) << (low * i));
      }
    }
  }
  return out;
}

class FakeV4l2 final : public V4l2System {
 public:
  explicit FakeV4l2(const FakeSensor& sensor = {}) : sensor_(sensor) {
    video_controls[V4L2_CID_EXPOSURE_ABSOLUTE] = {1, 600, 1, 100};
    video_controls[V4L2_CID_EXPOSURE_AUTO] = {0, 3, 1, 3};
    video_controls[V4L2_CID_GAIN] = {16, 256, 1, 16};
  }

  // What the test turns.
  bool present = true;
  bool busy = false;
  bool out_of_memory = false;
  bool exposure_sticks = false;  ///< the driver takes the control, the sensor never does
  std::uint32_t capabilities = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
  std::map<std::uint32_t, FakeControl> video_controls;
  std::map<std::uint32_t, FakeControl> sensor_controls;  ///< of /dev/v4l-subdev0
  double exposure_unit_s = 100e-6;
  std::int64_t pixel_rate = 0;
  std::function<FakeFault(std::uint32_t frame)> fault = [](std::uint32_t) { return FakeFault{}; };
  std::function<void(std::uint32_t frame)> at_frame = [](std::uint32_t) {};

  // What the test sees.
  int open_descriptors = 0;
  int mappings = 0;
  int allocations = 0;  ///< REQBUFS minus its frees
  std::uint32_t frames_made() const { return frame_; }
  std::int64_t time_ns() const { return now_; }
  void pass_time(double seconds) { advance(now_ + std::llround(1e9 * seconds)); }

  /// Switches the light on the part: 0..1 of full.
  void light(double level) { lights_.emplace_back(now_, level); }
  void unplug() {
    present = false;
    streaming_ = false;
  }

  int open(const char* path) override {
    if (!present) return -ENOENT;
    if (busy) return -EBUSY;
    const std::string name = path;
    const bool sub = name == "/dev/v4l-subdev0";
    if (!sub && name != "/dev/video0") return -ENOENT;
    ++open_descriptors;
    return sub ? kSubdevice : kVideo;
  }
  void close(int fd) override {
    if (fd == kVideo) {
      streaming_ = false;
      buffers_.clear();
      allocations = 0;
    }
    --open_descriptors;
  }
  int ioctl(int fd, unsigned long request, void* argument) override;
  void* map(int, std::size_t, std::uint32_t offset) override {
    ++mappings;
    return buffers_.at(offset / kPage)->bytes.data();
  }
  void unmap(void*, std::size_t) override { --mappings; }
  int poll(int, std::int64_t timeout_ns) override {
    if (!present) return POLLERR | POLLHUP;
    const std::int64_t deadline = now_ + timeout_ns;
    while (done_.empty() && streaming_ && present && end_ns_ <= deadline)
      advance(end_ns_);
    if (!present) return POLLERR | POLLHUP;
    if (!done_.empty()) return POLLIN;
    advance(deadline);
    return done_.empty() ? 0 : POLLIN;
  }
  std::int64_t now_ns() override {
    advance(now_ + 1000);
    return now_;
  }

 private:
  static constexpr int kVideo = 7;
  static constexpr int kSubdevice = 8;
  static constexpr std::uint32_t kPage = 4096;
  struct Buffer {
    std::vector<std::uint8_t> bytes;
    std::uint32_t sequence = 0;
    std::int64_t stamp_ns = 0;
    std::uint32_t used = 0;
    std::uint32_t flags = 0;
  };
  struct Effect {
    std::uint32_t from_frame = 0;
    double exposure_s = 0;
    double gain = 1;
  };

  void advance(std::int64_t to) {
    while (streaming_ && present && end_ns_ <= to) {
      now_ = std::max(now_, end_ns_);
      finish_frame();
      if (streaming_) begin_frame(std::max(begin_ns_ + ns(sensor_.interval_s), end_ns_));
    }
    now_ = std::max(now_, to);
  }
  static std::int64_t ns(double s) { return std::llround(1e9 * s); }
  const FakeControl* control(std::uint32_t id) const {
    if (const auto it = sensor_controls.find(id); it != sensor_controls.end()) return &it->second;
    const auto it = video_controls.find(id);
    return it == video_controls.end() ? nullptr : &it->second;
  }
  Effect set_now() const {
    Effect effect;
    const FakeControl* exposure = control(V4L2_CID_EXPOSURE_ABSOLUTE);
    if (exposure == nullptr) exposure = control(V4L2_CID_EXPOSURE);
    effect.exposure_s =
        exposure == nullptr ? 0.005 : static_cast<double>(exposure->value) * exposure_unit_s;
    const FakeControl* gain = control(V4L2_CID_GAIN);
    effect.gain = gain == nullptr ? 1 : static_cast<double>(gain->value) / 16;
    return effect;
  }
  void begin_frame(std::int64_t at) {
    begin_ns_ = at;
    while (effects_.size() > 1 && effects_[1].from_frame <= frame_)
      effects_.pop_front();
    const double late = fault(frame_).kind == FakeFault::late ? fault(frame_).late_s : 0;
    end_ns_ = at + ns(effects_.front().exposure_s + sensor_.readout_s + late);
  }
  double light_between(std::int64_t from, std::int64_t to) const {
    if (lights_.empty()) return 1;
    double sum = 0;
    for (std::size_t i = 0; i < lights_.size(); ++i) {
      const std::int64_t until = i + 1 < lights_.size() ? lights_[i + 1].first : to;
      const std::int64_t a = std::clamp(lights_[i].first, from, to);
      sum += lights_[i].second * static_cast<double>(std::clamp(until, from, to) - a);
    }
    return sum / static_cast<double>(to - from);
  }
  void fill(Buffer& buffer, FakeFault::Kind kind) const {
    const Effect& e = effects_.front();
    const double level = light_between(begin_ns_, begin_ns_ + ns(e.exposure_s));
    const double signal =
        kind == FakeFault::black ? 0 : sensor_.counts_per_s * e.exposure_s * e.gain * level;
    const int top = (1 << sensor_.format->bits) - 1;
    const std::size_t row = sensor_.format->row_bytes(sensor_.width);
    for (int y = 0; y < sensor_.height; ++y) {
      std::vector<int> counts;
      for (int x = 0; x < sensor_.width; ++x) {
        const auto mixed = (frame_ * 2654435761U) ^ static_cast<std::uint32_t>(y * 977 + x * 131);
        const int noise = sensor_.noise == 0
                              ? 0
                              : static_cast<int>((mixed * 40503U >> 16) %
                                                 static_cast<unsigned>(2 * sensor_.noise + 1)) -
                                    sensor_.noise;
        counts.push_back(
            std::clamp(sensor_.black + static_cast<int>(std::lround(signal)) + noise, 0, top));
      }
      const auto bytes = packed_row(*sensor_.format, counts);
      std::copy(bytes.begin(), bytes.end(),
                buffer.bytes.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(y) *
                                                                   (row + sensor_.padding)));
    }
  }
  void finish_frame() {
    const FakeFault::Kind kind = fault(frame_).kind;
    if (kind != FakeFault::dropped && !queued_.empty()) {
      const std::size_t index = queued_.front();
      queued_.pop_front();
      Buffer& buffer = *buffers_[index];
      if (kind == FakeFault::repeated) {
        buffer = last_;
      } else {
        fill(buffer, kind);
        const bool start = (sensor_.stamp_flags & V4L2_BUF_FLAG_TSTAMP_SRC_SOE) != 0;
        buffer.stamp_ns = (start ? begin_ns_ : end_ns_) + sensor_.stamp_offset_ns;
        buffer.sequence = frame_;
        buffer.used = static_cast<std::uint32_t>(buffer.bytes.size()) /
                      (kind == FakeFault::truncated ? 2 : 1);
        buffer.flags = sensor_.stamp_flags | (kind == FakeFault::damaged ? V4L2_BUF_FLAG_ERROR : 0);
        last_ = buffer;
      }
      done_.push_back(index);
    }
    ++frame_;
    at_frame(frame_);
  }
  int set_controls(std::map<std::uint32_t, FakeControl>& controls, v4l2_ext_control& value) {
    const auto it = controls.find(value.id);
    if (it == controls.end()) return -EINVAL;
    it->second.value = std::clamp<std::int64_t>(value.value, it->second.least, it->second.most);
    const std::uint32_t first_after = frame_ + (streaming_ && begin_ns_ < now_ ? 1 : 0);
    Effect effect = set_now();
    effect.from_frame =
        streaming_ ? first_after + static_cast<std::uint32_t>(sensor_.latency_frames) : 0;
    if (exposure_sticks && !effects_.empty()) effect.exposure_s = effects_.front().exposure_s;
    if (!streaming_) effects_.clear();
    effects_.push_back(effect);
    // A frame that has not begun yet takes what is in effect when it does.
    if (streaming_ && begin_ns_ >= now_) begin_frame(begin_ns_);
    return 0;
  }
  int stream_on();
  int request_buffers(v4l2_requestbuffers& request);
  int dequeue(v4l2_buffer& buffer);
  int set_format(v4l2_format& format) const;
  using Controls = std::map<std::uint32_t, FakeControl>;
  int query_control(const Controls& controls, v4l2_query_ext_ctrl& asked) const;
  int get_control(const Controls& controls, v4l2_ext_control& value) const;
  int query_buffer(v4l2_buffer& buffer) const;

  FakeSensor sensor_;
  std::int64_t now_ = 1'000'000'000'000;
  bool streaming_ = false;
  std::uint32_t frame_ = 0;
  std::int64_t begin_ns_ = 0;
  std::int64_t end_ns_ = 0;
  std::deque<Effect> effects_;
  std::vector<std::pair<std::int64_t, double>> lights_;
  std::vector<std::unique_ptr<Buffer>> buffers_;
  std::deque<std::size_t> queued_;
  std::deque<std::size_t> done_;
  Buffer last_;
};

inline int FakeV4l2::stream_on() {
  streaming_ = true;
  frame_ = 0;
  Effect effect = set_now();
  if (exposure_sticks && !effects_.empty()) effect.exposure_s = effects_.front().exposure_s;
  effects_ = {effect};
  begin_frame(now_ + ns(0.001));
  return 0;
}

inline int FakeV4l2::request_buffers(v4l2_requestbuffers& request) {
  if (request.count > 0 && out_of_memory) return -ENOMEM;
  buffers_.clear();
  queued_.clear();
  done_.clear();
  allocations = static_cast<int>(request.count);
  const std::size_t row = sensor_.format->row_bytes(sensor_.width) + sensor_.padding;
  for (std::uint32_t i = 0; i < request.count; ++i) {
    buffers_.push_back(std::make_unique<Buffer>());
    buffers_.back()->bytes.resize(row * static_cast<std::size_t>(sensor_.height));
  }
  return 0;
}

inline int FakeV4l2::dequeue(v4l2_buffer& buffer) {
  if (!streaming_) return -EINVAL;
  if (done_.empty()) return -EAGAIN;
  const std::size_t index = done_.front();
  done_.pop_front();
  const Buffer& filled = *buffers_[index];
  buffer.index = static_cast<std::uint32_t>(index);
  buffer.sequence = filled.sequence;
  buffer.bytesused = filled.used;
  buffer.flags = filled.flags;
  buffer.timestamp.tv_sec = filled.stamp_ns / 1'000'000'000;
  buffer.timestamp.tv_usec = filled.stamp_ns % 1'000'000'000 / 1000;
  return 0;
}

inline int FakeV4l2::set_format(v4l2_format& format) const {
  v4l2_pix_format& pix = format.fmt.pix;
  pix.width = static_cast<std::uint32_t>(sensor_.width);
  pix.height = static_cast<std::uint32_t>(sensor_.height);
  pix.pixelformat = sensor_.format->v4l2_code();
  pix.bytesperline =
      static_cast<std::uint32_t>(sensor_.format->row_bytes(sensor_.width) + sensor_.padding);
  pix.sizeimage = pix.bytesperline * pix.height;
  return 0;
}

inline int FakeV4l2::query_control(const Controls& controls, v4l2_query_ext_ctrl& asked) const {
  if (asked.id == V4L2_CID_PIXEL_RATE && pixel_rate > 0) return 0;
  const auto it = controls.find(asked.id);
  if (it == controls.end()) return -EINVAL;
  asked.minimum = it->second.least;
  asked.maximum = it->second.most;
  asked.step = static_cast<std::uint64_t>(it->second.step);
  asked.default_value = it->second.least;
  return 0;
}

inline int FakeV4l2::get_control(const Controls& controls, v4l2_ext_control& value) const {
  if (value.id == V4L2_CID_PIXEL_RATE) {
    value.value64 = pixel_rate;
  } else {
    value.value = static_cast<std::int32_t>(controls.at(value.id).value);
  }
  return 0;
}

inline int FakeV4l2::query_buffer(v4l2_buffer& buffer) const {
  buffer.length = static_cast<std::uint32_t>(buffers_.at(buffer.index)->bytes.size());
  buffer.m.offset = buffer.index * kPage;
  return 0;
}

inline int FakeV4l2::ioctl(int fd, unsigned long request, void* argument) {
  if (!present) return -ENODEV;
  auto& controls = fd == kSubdevice ? sensor_controls : video_controls;
  switch (request) {
    case VIDIOC_QUERYCAP:
      static_cast<v4l2_capability*>(argument)->capabilities = capabilities;
      return 0;
    case VIDIOC_G_FMT:
      return 0;
    case VIDIOC_S_FMT:
      return set_format(*static_cast<v4l2_format*>(argument));
    case VIDIOC_G_PARM:
    case VIDIOC_S_PARM:
      static_cast<v4l2_streamparm*>(argument)->parm.capture.timeperframe = {
          static_cast<std::uint32_t>(std::lround(sensor_.interval_s * 1e6)), 1000000};
      return 0;
    case VIDIOC_QUERY_EXT_CTRL:
      return query_control(controls, *static_cast<v4l2_query_ext_ctrl*>(argument));
    case VIDIOC_G_EXT_CTRLS:
      return get_control(controls, *static_cast<v4l2_ext_controls*>(argument)->controls);
    case VIDIOC_S_EXT_CTRLS:
      return set_controls(controls, *static_cast<v4l2_ext_controls*>(argument)->controls);
    case VIDIOC_REQBUFS:
      return request_buffers(*static_cast<v4l2_requestbuffers*>(argument));
    case VIDIOC_QUERYBUF:
      return query_buffer(*static_cast<v4l2_buffer*>(argument));
    case VIDIOC_QBUF:
      queued_.push_back(static_cast<v4l2_buffer*>(argument)->index);
      return 0;
    case VIDIOC_DQBUF:
      return dequeue(*static_cast<v4l2_buffer*>(argument));
    case VIDIOC_STREAMON:
      return stream_on();
    case VIDIOC_STREAMOFF:
      streaming_ = false;
      queued_.clear();
      done_.clear();
      return 0;
    default:
      return -ENOTTY;
  }
}

}  // namespace brdfgate::test
