// The simulated camera: whole lines of exposure, no time but the bench's, faults on request.
#pragma once

#include <deque>

#include "hal/camera.hpp"
#include "hal/sim/bench.hpp"
#include "hal/sim/camera_fault.hpp"

namespace brdfgate {

class SimCamera final : public Camera {
 public:
  explicit SimCamera(SimBench& bench) : bench_(bench) {}

  SensorFormat format() const override { return bench_.settings().sensor; }
  CameraCapabilities capabilities() const override { return {}; }
  void probe() override;
  void arm(const std::vector<ExposureRequest>& bracket, std::int64_t not_before_ns) override;
  RawFrame next_frame(std::chrono::milliseconds timeout) override;
  void stop() noexcept override { armed_.clear(); }

 private:
  RawFrame expose(const ExposureRequest& request, int frame);
  [[noreturn]] void fail(CameraFault fault, const char* call, const std::string& what);

  SimBench& bench_;
  std::deque<ExposureRequest> armed_;
  SimCameraFault fault_;
  bool unplugged_ = false;
  ExposureRequest in_effect_{.exposure_s = 0.001};
  cv::Mat last_counts_;
};

}  // namespace brdfgate
