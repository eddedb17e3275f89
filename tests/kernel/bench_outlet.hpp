// Where lab_bench's frames go: into a device of the kernel that the station's camera backend opens.
#pragma once

#include <linux/videodev2.h>

#include <memory>
#include <optional>
#include <string>

#include "hal/camera.hpp"
#include "hal/modbus/unique_fd.hpp"
#include "kernel/uvc_camera.hpp"

namespace brdfgate::lab {

class Outlet {
 public:
  Outlet() = default;
  Outlet(const Outlet&) = delete;
  Outlet& operator=(const Outlet&) = delete;
  virtual ~Outlet() = default;
  /// What the next frame is exposed with; empty while nobody takes frames. Once a frame.
  virtual std::optional<ExposureRequest> next_exposure() = 0;
  virtual void put(const cv::Mat& frame) = 0;
  /// The cable, where there is one.
  virtual void plug(bool in) { static_cast<void>(in); }
  /// Settings are taken and not obeyed.
  virtual void go_deaf(bool deaf) { static_cast<void>(deaf); }
};

/// A v4l2loopback node: one exposure, frames whether anybody looks or not.
class LoopbackOutlet : public Outlet {
 public:
  LoopbackOutlet(const std::string& node, const SensorFormat& sensor, double exposure_s);
  std::optional<ExposureRequest> next_exposure() override {
    return ExposureRequest{.exposure_s = exposure_s_};
  }
  void put(const cv::Mat& frame) override;

 private:
  UniqueFd fd_;
  double exposure_s_;
};

/// A USB camera. A setting is obeyed from the second frame on that begins after it, as sensors that
/// latch their registers between two frames do.
class UsbOutlet : public Outlet {
 public:
  explicit UsbOutlet(const SensorFormat& sensor);
  std::optional<ExposureRequest> next_exposure() override;
  void put(const cv::Mat& frame) override;
  void plug(bool in) override;
  void go_deaf(bool deaf) override { deaf_ = deaf; }

 private:
  int width_, height_;
  bool deaf_ = false;
  std::unique_ptr<UvcCamera> camera_;
  UvcSettings latched_;
};

}  // namespace brdfgate::lab
