// A USB camera made of software, for the kernel lab: USB/IP plugs it into the kernel's virtual host
// controller, where the kernel's own uvcvideo drives it like any other.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <opencv2/core.hpp>
#include <span>
#include <thread>
#include <vector>

#include "hal/modbus/unique_fd.hpp"

namespace brdfgate::lab {

/// What the host has set. UVC 1.0's units.
struct UvcSettings {
  std::uint32_t exposure_100us = 156;
  std::uint16_t gain = 16;  ///< 16 is a gain of 1
  bool operator==(const UvcSettings&) const = default;
};

/// Video class 1.0, one format (Y16), one size, a bulk endpoint; exposure time, its automatism (on
/// until switched off; a manual exposure is refused meanwhile) and gain. Plugged in for as long as
/// it lives. Needs root and the module vhci-hcd; throws std::runtime_error without.
class UvcCamera {
 public:
  UvcCamera(int width, int height);
  ~UvcCamera();
  UvcCamera(const UvcCamera&) = delete;
  UvcCamera& operator=(const UvcCamera&) = delete;

  bool streaming() const { return streaming_; }
  UvcSettings settings() const;
  /// A CV_16UC1 frame of the camera's size. False: the host takes none, or not all of it, in time.
  bool send(const cv::Mat& frame);

 private:
  struct Setup {
    std::uint8_t type, request;
    std::uint16_t value, index, length;
  };
  /// A request for bulk data that waits for a frame.
  struct Waiting {
    std::uint32_t seqnum, bytes;
  };
  using Bytes = std::vector<std::uint8_t>;

  void serve();
  void submitted(std::span<const std::uint8_t> header);
  void unlinked(std::uint32_t seqnum, std::uint32_t victim);
  void answer_unlink(std::uint32_t seqnum, std::int32_t status);
  void control(std::uint32_t seqnum, const Setup& setup, const Bytes& data);
  bool standard_request(const Setup& setup, Bytes& reply);
  bool class_request(const Setup& setup, const Bytes& data, Bytes& reply);
  bool set_control(const Setup& setup, const Bytes& data);
  bool get_control(const Setup& setup, Bytes& reply) const;
  Bytes stream_parameters() const;
  Bytes configuration() const;
  Bytes descriptor(std::uint16_t which) const;
  void answer(std::uint32_t seqnum, std::int32_t status, std::int32_t length,
              std::span<const std::uint8_t> data);

  int width_, height_;
  UniqueFd socket_;
  std::atomic<bool> streaming_ = false;
  mutable std::mutex mutex_;  ///< of all below, and of writing to the socket
  std::condition_variable asked_;
  std::deque<Waiting> waiting_;
  std::uint32_t last_submitted_ = 0;
  std::map<std::uint32_t, std::uint32_t>
      early_unlinks_;  ///< request: its withdrawal, which came first
  UvcSettings settings_;
  std::uint8_t automatism_ = 8;  ///< UVC 4.2.2.1.2: 1 manual, 8 aperture priority
  std::uint8_t frame_id_ = 0;
  std::jthread server_;
};

}  // namespace brdfgate::lab
