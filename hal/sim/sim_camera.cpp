#include "hal/sim/sim_camera.hpp"

#include <string>

#include "hal/camera_checks.hpp"

namespace brdfgate {
namespace {

constexpr const char* kName = "simulated camera";

}  // namespace

void SimCamera::fail(CameraFault fault, const char* call, const std::string& what) {
  armed_.clear();
  throw CameraError(fault, kName, call, what);
}

void SimCamera::probe() {
  using Kind = SimCameraFault::Kind;
  fault_ = read_camera_fault(bench_.settings().camera_fault_file);
  unplugged_ = unplugged_ && fault_.kind == Kind::unplugged;
  if (fault_.kind == Kind::absent) fail(CameraFault::absent, "open", "no such device");
  if (unplugged_) fail(CameraFault::absent, "open", "the camera went away");
  if (fault_.kind == Kind::out_of_memory) {
    fail(CameraFault::out_of_memory, "buffers", "no memory");
  }
}

void SimCamera::arm(const std::vector<ExposureRequest>& bracket, std::int64_t not_before_ns) {
  armed_.clear();
  check_requests(bracket, kName);
  probe();
  armed_.assign(bracket.begin(), bracket.end());
  bench_.advance_to(not_before_ns);
}

RawFrame SimCamera::next_frame(std::chrono::milliseconds timeout) {
  using Kind = SimCameraFault::Kind;
  if (armed_.empty()) fail(CameraFault::no_frame, "next_frame", "nothing is armed");
  if (!bench_.occupied()) {
    fail(CameraFault::no_frame, "next_frame", "no scene was placed under the camera");
  }
  const ExposureRequest request = armed_.front();
  armed_.pop_front();
  const int frame = static_cast<int>(bench_.frames_of_part());
  const bool struck = fault_.kind != Kind::none && frame >= fault_.frame;
  if (struck && fault_.kind == Kind::unplugged) {
    unplugged_ = true;
    fail(CameraFault::absent, "next_frame", "the camera went away");
  }
  const bool lost = struck && fault_.kind == Kind::lost;
  if (lost ||
      bench_.frame_time_s(request.exposure_s) > std::chrono::duration<double>(timeout).count()) {
    fail(CameraFault::no_frame, "next_frame",
         (lost ? "no frame came in " : "exposure and readout take longer than ") +
             std::to_string(timeout.count()) + " ms");
  }
  return expose(request, frame);
}

RawFrame SimCamera::expose(const ExposureRequest& request, int number) {
  using Kind = SimCameraFault::Kind;
  const bool struck = number >= fault_.frame;
  if (!(struck && fault_.kind == Kind::not_applied)) in_effect_ = request;
  RawFrame frame = bench_.expose(in_effect_.exposure_s, in_effect_.gain);
  frame.exposure_s = bench_.applied_exposure_s(request.exposure_s);
  frame.gain = request.gain;
  if (fault_.kind == Kind::black && number == fault_.frame) {
    frame.counts = cv::Scalar(bench_.settings().sensor.black_level_dn);
  }
  const bool same_size = last_counts_.size() == frame.counts.size();
  if (struck && fault_.kind == Kind::frozen && same_size) last_counts_.copyTo(frame.counts);
  // Kept for one purpose; a copy per frame would cost every simulation.
  if (fault_.kind == Kind::frozen) last_counts_ = frame.counts.clone();
  return frame;
}

}  // namespace brdfgate
